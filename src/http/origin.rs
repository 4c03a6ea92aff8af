//! Pages of other sites must not make this server work through a visitor's browser.

use crate::jobs::{Code, Problem};
use axum::extract::Request;
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// Middleware: what changes something is refused if a browser sends it for a page of another site.
pub async fn check(request: Request, next: Next) -> Response {
    let is_reading = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    if is_reading || !is_cross_site(request.headers()) {
        return next.run(request).await;
    }
    let detail = "a browser sent this for a page of another site: call the server from its own page or from a program";
    Problem::new(Code::CrossSite, detail).into_response()
}

/// `Sec-Fetch-Site` says so, or else `Origin` names another host. Programs send neither.
fn is_cross_site(headers: &HeaderMap) -> bool {
    let text = |name: &str| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    if let Some(site) = text("sec-fetch-site") {
        return !matches!(site, "same-origin" | "none");
    }
    let Some(origin) = text(header::ORIGIN.as_str()) else { return false };
    let host = text(header::HOST.as_str()).unwrap_or_default();
    !origin.split_once("://").is_some_and(|(_, authority)| authority.eq_ignore_ascii_case(host))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cross(headers: &[(&'static str, &'static str)]) -> bool {
        let pairs = headers.iter().map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap()));
        is_cross_site(&pairs.collect())
    }

    #[test]
    fn other_sites_are_told_from_the_own_page_and_from_programs() {
        let host = ("host", "localhost:8080");
        assert!(!cross(&[host]), "a program");
        assert!(!cross(&[host, ("origin", "http://localhost:8080")]), "the page");
        assert!(
            !cross(&[host, ("sec-fetch-site", "same-origin"), ("origin", "https://proxy.example")]),
            "behind a proxy"
        );
        assert!(!cross(&[host, ("sec-fetch-site", "none")]), "the address bar");
        for origin in ["https://evil.example", "http://localhost:8081", "null", "http://localhost:8080.evil.example"] {
            assert!(cross(&[host, ("origin", origin)]), "{origin}");
        }
        assert!(cross(&[host, ("sec-fetch-site", "cross-site")]));
        assert!(cross(&[host, ("sec-fetch-site", "same-site"), ("origin", "http://localhost:8080")]));
    }
}
