//! A name of another site that resolves to this machine (DNS rebinding) must not make its page one of this server's.

use crate::jobs::{Code, Problem};
use axum::extract::{Request, State};
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::IpAddr;
use std::sync::Arc;

/// Hosts that requests may name.
#[derive(Debug, Clone)]
pub struct Hosts {
    /// In lower case.
    names: Arc<[String]>,
    /// Whether names beyond these are refused.
    is_strict: bool,
}

impl Hosts {
    /// Names besides addresses and `localhost`. Without any, a server that only this machine reaches is strict, and one that others
    /// reach answers to whatever it is called.
    pub fn new(names: &[String], is_loopback: bool) -> Self {
        let is_strict = is_loopback || !names.is_empty();
        Self { names: names.iter().map(|name| name.trim().to_ascii_lowercase()).collect(), is_strict }
    }

    /// Whether a `Host` may be answered.
    fn allows(&self, host: &str) -> bool {
        let name = without_port(host).to_ascii_lowercase();
        let name = name.strip_suffix('.').unwrap_or(&name);
        let is_address = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>().is_ok();
        let is_local = name == "localhost" || name.ends_with(".localhost");
        !self.is_strict || is_address || is_local || self.names.iter().any(|known| known == name)
    }
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) && !name.ends_with(':') => name,
        _ => host,
    }
}

/// Middleware: refuses what names another host. Programs that name none are no browsers.
pub async fn check(State(hosts): State<Hosts>, request: Request, next: Next) -> Response {
    let header = request.headers().get(header::HOST).map(|value| value.to_str().unwrap_or("\u{fffd}"));
    let named = request.uri().host().into_iter().chain(header);
    let stranger = named.map(str::to_owned).find(|host| !hosts.allows(host));
    let Some(host) = stranger else { return next.run(request).await };
    let host: String = host.chars().take(100).collect();
    let detail = format!(
        "this server is not `{host}`: call it by its address or `localhost`, or start it with --allowed-hosts {host}"
    );
    Problem::new(Code::HostNotAllowed, detail).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_others_are_refused_on_a_server_of_this_machine() {
        let hosts = Hosts::new(&["Render.example".to_owned()], true);
        for host in [
            "localhost:8080",
            "LOCALHOST",
            "127.0.0.1:8080",
            "[::1]:8080",
            "[::1]",
            "10.0.0.1",
            "render.example:80",
            "a.localhost",
            "localhost.",
        ] {
            assert!(hosts.allows(host), "{host}");
        }
        for host in [
            "evil.example",
            "evil.example:8080",
            "localhost.evil.example",
            "127.0.0.1.evil.example",
            "",
            "a",
            "\u{fffd}",
        ] {
            assert!(!hosts.allows(host), "{host}");
        }
        assert!(Hosts::new(&[], false).allows("anything.example"));
        assert!(!Hosts::new(&["b".to_owned()], false).allows("anything.example"));
    }
}
