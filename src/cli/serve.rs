//! `candela serve`.

use super::stop::Stops;
use super::traces::Traces;
use super::{Failure, apart};
use crate::config::{LogFormat, ServeConfig};
use crate::denoise::Denoiser;
use crate::http::{self, Access};
use crate::jobs::{EngineFactory, Service, StartError, Trial, Webhooks};
use crate::render::{ApartEngine, Engines, RenderError};
use anyhow::Context;
use std::io::{IsTerminal, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;
use tokio::net::TcpListener;
use tracing::Subscriber;
use tracing_subscriber::prelude::*;
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::{EnvFilter, Layer, fmt};

/// Serves until SIGTERM or SIGINT.
///
/// # Errors
/// No usable adapter, or the address cannot be listened on.
pub fn run(config: ServeConfig) -> Result<(), Failure> {
    if config.print_config {
        let written = std::io::stdout().write_all(config.as_environment().as_bytes());
        return written.map_err(|error| Failure::Machine(format!("standard output: {error}")));
    }
    let machine = |error: anyhow::Error| Failure::Machine(told_once(&error));
    let traces = config.otlp_endpoint.as_deref().map(Traces::to).transpose().map_err(machine)?;
    let traced = traces.as_ref().map(Traces::layer);
    tracing_subscriber::registry().with(log(config.log_format)).with(traced).init();
    let names = std::env::vars_os().filter_map(|(name, _)| name.into_string().ok());
    for (name, near) in ServeConfig::misspelt(names) {
        let hint = near.map_or_else(String::new, |near| format!(" Did you mean {near}?"));
        tracing::warn!("{name} is no setting and changes nothing (candela serve --print-config lists all).{hint}");
    }
    run_to_end(config).map_err(machine)
}

/// An error with its causes, each said once: some repeat what caused them.
fn told_once(error: &anyhow::Error) -> String {
    let (mut told, mut seen) = (Vec::new(), Vec::<String>::new());
    for cause in error.chain().map(ToString::to_string) {
        if !seen.iter().any(|before| before.contains(&cause) || cause.contains(before.as_str())) {
            told.push(cause.clone());
        }
        seen.push(cause);
    }
    told.join(": ")
}

/// The log, on standard error.
fn log<S: Subscriber + for<'a> LookupSpan<'a>>(format: LogFormat) -> impl Layer<S> {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("candela=info,warn"));
    let lines = fmt::layer().with_writer(std::io::stderr).with_ansi(std::io::stderr().is_terminal());
    let lines = match format {
        LogFormat::Text => lines.boxed(),
        LogFormat::Json => lines.json().flatten_event(true).with_current_span(false).with_span_list(true).boxed(),
    };
    lines.with_filter(filter)
}

fn run_to_end(config: ServeConfig) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Runtime::new().context("the runtime cannot start")?;
    let served = runtime.block_on(serve(config));
    // A scene may still be compiling for a job that is over already: not worth waiting for.
    runtime.shutdown_timeout(Duration::from_secs(1));
    served
}

async fn serve(config: ServeConfig) -> anyhow::Result<()> {
    let listener = TcpListener::bind(config.listen).await.with_context(|| {
        format!("cannot listen on {} (--listen 127.0.0.1:8081 takes another port, port 0 any free one)", config.listen)
    })?;
    let address = listener.local_addr()?;
    let access = Access::new(config.keys.as_deref(), config.allowed_hosts.clone())?;
    if !access.has_keys() && !address.ip().is_loopback() {
        tracing::warn!("whoever reaches {address} may use this server (--keys FILE asks for keys)");
    }
    let engines = engines(&config);
    let (webhooks, trial, denoiser) = (webhooks(&config)?, trial(&config), denoiser(&config)?);
    let started = Service::start_in(config.data.as_deref(), config.limits, engines).await;
    let service = started.map_err(|error| match (&error, &config.data) {
        (StartError::Storage(_), Some(folder)) => {
            let place = format!("--data {}", folder.display());
            anyhow::Error::new(error).context(place)
        }
        _ => error.into(),
    })?;
    if let Some(trial) = trial {
        service.try_scenes(trial);
    }
    if let Some(denoiser) = denoiser {
        service.denoise_with(denoiser);
    }
    if let Some(webhooks) = webhooks {
        service.tell_webhooks(webhooks);
    }
    match &config.data {
        Some(folder) => tracing::info!(folder = %folder.display(), "jobs and uploads are kept"),
        None => tracing::info!("jobs and uploads end with this process (--data FOLDER keeps them)"),
    }
    tracing::info!("Candela is ready: http://{}/", reachable(address));
    http::serve(listener, service, &access, asked_to_stop()?, Duration::from_secs(config.drain_seconds)).await?;
    tracing::info!("stopped");
    Ok(())
}

/// Makes the engine, again after it was lost.
fn engines(config: &ServeConfig) -> EngineFactory {
    if !config.apart {
        return Box::new(|| Ok(Box::new(Engines::new())));
    }
    let patience = Duration::from_secs(config.limits.device_seconds.max(1));
    Box::new(move || {
        Ok(Box::new(ApartEngine::start(
            apart::command("engine").map_err(|error| RenderError::NoAdapter(error.to_string()))?,
            patience,
        )?))
    })
}

/// How scenes are tried, if they are.
fn trial(config: &ServeConfig) -> Option<Trial> {
    config.apart.then(|| Trial {
        command: Box::new(|| apart::command("import")),
        patience: Duration::from_secs(config.limits.import_seconds.max(1)),
        memory: config.limits.import_memory_bytes,
    })
}

/// What denoises, if it is there; a library that was named must be.
fn denoiser(config: &ServeConfig) -> anyhow::Result<Option<Denoiser>> {
    match apart::denoiser(config.oidn.as_deref(), config.limits.denoise()) {
        Ok(denoiser) => {
            tracing::info!("pictures are denoised on request by {}", denoiser.name());
            Ok(Some(denoiser))
        }
        Err(why) => match &config.oidn {
            Some(place) => anyhow::bail!("--oidn {}: {why}", place.display()),
            None => {
                tracing::info!("pictures cannot be denoised here: {why}");
                Ok(None)
            }
        },
    }
}

/// How webhooks are signed, if they are to be sent.
fn webhooks(config: &ServeConfig) -> anyhow::Result<Option<Webhooks>> {
    let Some(file) = &config.webhook_secret else { return Ok(None) };
    let place = || format!("--webhook-secret {}", file.display());
    let secret = std::fs::read_to_string(file).with_context(place)?;
    let webhooks = Webhooks::new(&secret, &config.webhook_hosts).map_err(anyhow::Error::msg);
    webhooks.map(Some).with_context(place)
}

/// An address at which this machine itself reaches the server.
fn reachable(address: SocketAddr) -> SocketAddr {
    match address.ip() {
        ip if !ip.is_unspecified() => address,
        IpAddr::V4(_) => SocketAddr::new(Ipv4Addr::LOCALHOST.into(), address.port()),
        IpAddr::V6(_) => SocketAddr::new(Ipv6Addr::LOCALHOST.into(), address.port()),
    }
}

/// Becomes ready at SIGTERM or SIGINT.
fn asked_to_stop() -> std::io::Result<impl Future<Output = ()> + Send + 'static> {
    let mut stops = Stops::new()?;
    Ok(async move {
        stops.next().await;
        tracing::info!("shutting down: finishing the jobs under way");
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Limits;

    fn config(listen: SocketAddr) -> ServeConfig {
        ServeConfig {
            listen,
            data: None,
            keys: None,
            allowed_hosts: Vec::new(),
            webhook_secret: None,
            webhook_hosts: Vec::new(),
            drain_seconds: 0,
            apart: false,
            oidn: None,
            log_format: LogFormat::Text,
            otlp_endpoint: None,
            print_config: false,
            limits: Limits::default(),
        }
    }

    #[test]
    fn a_port_that_is_taken_is_said_before_anything_else() {
        let other = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let listen = other.local_addr().unwrap();
        let error = run_to_end(config(listen)).unwrap_err();
        let message = format!("{error:#}");
        assert!(message.contains(&listen.to_string()) && message.contains("--listen"), "{message}");
    }

    #[test]
    fn what_is_wrong_with_a_data_folder_is_said_once_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("ledger.sqlite"), "no database, but longer than the head of one ".repeat(9))
            .unwrap();
        let listen = SocketAddr::from(([127, 0, 0, 1], 0));
        let error = run_to_end(ServeConfig { data: Some(folder.path().to_owned()), ..config(listen) }).unwrap_err();
        let said = told_once(&error);
        assert!(said.contains(&*folder.path().to_string_lossy()) && said.contains("backups"), "{said}");
        assert_eq!(said.matches("cannot be read").count(), 1, "{said}");
        assert_eq!(said.matches("not a database").count(), 1, "{said}");
    }

    #[test]
    fn the_address_shown_can_be_opened() {
        let shown = |address: &str| reachable(address.parse().unwrap()).to_string();
        assert_eq!(shown("0.0.0.0:80"), "127.0.0.1:80");
        assert_eq!(shown("[::]:80"), "[::1]:80");
        assert_eq!(shown("10.1.2.3:80"), "10.1.2.3:80");
    }
}
