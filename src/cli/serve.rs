//! `candela serve`.

use super::Failure;
use crate::config::ServeConfig;
use crate::http;
use crate::jobs::Service;
use crate::render::Engines;
use anyhow::Context;
use std::io::IsTerminal;
use std::time::Duration;
use tokio::net::TcpListener;
use tracing_subscriber::EnvFilter;

/// Serves until SIGTERM or SIGINT.
///
/// # Errors
/// No usable adapter, or the address cannot be listened on.
pub fn run(config: ServeConfig) -> Result<(), Failure> {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("candela=info,warn"));
    let colours = std::io::stderr().is_terminal();
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).with_ansi(colours).init();
    run_to_end(config).map_err(|error| Failure::Machine(format!("{error:#}")))
}

fn run_to_end(config: ServeConfig) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Runtime::new().context("the runtime cannot start")?;
    let served = runtime.block_on(serve(config));
    // A scene may still be compiling for a job that is over already: not worth waiting for.
    runtime.shutdown_timeout(Duration::from_secs(1));
    served
}

async fn serve(config: ServeConfig) -> anyhow::Result<()> {
    let listener =
        TcpListener::bind(config.listen).await.with_context(|| format!("cannot listen on {}", config.listen))?;
    let address = listener.local_addr()?;
    let service = Service::start(config.limits, Box::new(|| Ok(Box::new(Engines::new())))).await?;
    tracing::info!("listening on http://{address}");
    http::serve(listener, service, asked_to_stop()?, Duration::from_secs(config.drain_seconds)).await?;
    tracing::info!("stopped");
    Ok(())
}

/// Becomes ready at SIGTERM or SIGINT (elsewhere than on Unix: Ctrl-C).
fn asked_to_stop() -> std::io::Result<impl Future<Output = ()> + Send + 'static> {
    #[cfg(unix)]
    let mut terminate = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate())?;
    Ok(async move {
        #[cfg(unix)]
        tokio::select! {
            _ = terminate.recv() => {}
            _ = tokio::signal::ctrl_c() => {}
        }
        #[cfg(not(unix))]
        let _ = tokio::signal::ctrl_c().await;
        tracing::info!("shutting down: finishing the jobs under way");
    })
}
