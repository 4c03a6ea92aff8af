//! The header `Prefer: wait=N` (RFC 7240): replies that wait for an end.

use super::App;
use axum::http::{HeaderMap, HeaderValue};
use axum::response::Response;
use std::time::Duration;

/// How long a client would wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience(Duration);

impl Patience {
    /// What the headers say, at most the server's limit.
    pub fn of(app: &App, headers: &HeaderMap) -> Option<Self> {
        wait(headers, Duration::from_secs(app.service.limits().wait_seconds)).map(Self)
    }

    /// Waits for an end; false if it does not come in time, or the service is over before.
    pub async fn wait_for(self, app: &App, end: impl Future<Output = ()>) -> bool {
        let mut closed = app.service.closed();
        tokio::select! {
            in_time = tokio::time::timeout(self.0, end) => in_time.is_ok(),
            _ = closed.wait_for(|closed| *closed) => false,
        }
    }

    /// Notes in a reply how long it would have waited.
    pub fn note(self, mut reply: Response) -> Response {
        if let Ok(applied) = HeaderValue::try_from(format!("wait={}", self.0.as_secs())) {
            reply.headers_mut().insert("preference-applied", applied);
        }
        reply
    }
}

fn wait(headers: &HeaderMap, longest: Duration) -> Option<Duration> {
    let lines = headers.get_all("prefer").iter().filter_map(|value| value.to_str().ok());
    let mut preferences = lines.flat_map(|line| line.split([',', ';'])).map(str::trim);
    let seconds = preferences.find_map(|preference| {
        let (name, value) = preference.split_once('=')?;
        name.trim().eq_ignore_ascii_case("wait").then(|| value.trim())?.trim_matches('"').parse().ok()
    })?;
    Some(Duration::from_secs(seconds).min(longest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waiting_is_bounded() {
        let mut headers = HeaderMap::new();
        assert_eq!(wait(&headers, Duration::from_secs(9)), None);
        headers.insert("prefer", "respond-async, wait=30".parse().unwrap());
        assert_eq!(wait(&headers, Duration::from_secs(9)), Some(Duration::from_secs(9)));
        for two in ["wait=2", "Wait = 2", "respond-async; WAIT=\"2\""] {
            headers.insert("prefer", two.parse().unwrap());
            assert_eq!(wait(&headers, Duration::from_secs(9)), Some(Duration::from_secs(2)), "{two}");
        }
    }
}
