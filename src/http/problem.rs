//! Every reply leaves through here: faults become problem+json, and all get a request id and security headers.

use super::metrics::Traffic;
use super::{Client, caller, span};
use crate::jobs::{Code, Problem};
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde_json::json;
use std::hash::{BuildHasher, RandomState};
use std::sync::atomic::{AtomicU64, Ordering};
use tracing::Instrument;

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// What a page of this server may load: only what this server gives, and pictures that its own script made.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; font-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; \
                      frame-ancestors 'none'";

/// Headers on every reply.
const SECURITY: [(HeaderName, &str); 5] = [
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (header::REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

impl IntoResponse for Problem {
    /// Only the status and the fault as data: [`dress`] writes the body, as it knows the request's id.
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let mut response = status.into_response();
        response.extensions_mut().insert(self);
        response
    }
}

/// Middleware around everything.
pub async fn dress(State(traffic): State<Traffic>, request: Request, next: Next) -> Response {
    let id = request_id(request.headers());
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let (begun, address) = (std::time::Instant::now(), caller(&request).client);
    let (span, trace_id) = span::of(&request, &id);
    let mut response = next.run(request).instrument(span.clone()).await;
    span::answered(&span, response.status());
    let client = response.extensions().get::<Client>().map_or(address, |client| client.0.clone());
    let problem = problem_of(&response);
    if let Some(problem) = &problem {
        response = write(problem, &id, response);
    }
    let headers = response.headers_mut();
    for (name, value) in SECURITY {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if let Ok(value) = HeaderValue::from_str(&id) {
        headers.insert(REQUEST_ID, value);
    }
    let (status, took) = (response.status().as_u16(), begun.elapsed());
    traffic.answered(method.as_str(), status, took);
    let (code, ms) = (problem.as_ref().map(|problem| problem.code.as_ref()), took.as_millis() as u64);
    tracing::info!(%method, path, status, code, client, request_id = id, trace_id, ms, "request");
    response
}

/// The client's id if it is short and plain, else a new one.
fn request_id(headers: &HeaderMap) -> String {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let given = headers.get(REQUEST_ID).and_then(|value| value.to_str().ok());
    let plain = |id: &&str| (1..=64).contains(&id.len()) && id.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-');
    given.filter(plain).map_or_else(
        || format!("{:016x}", RandomState::new().hash_one(COUNT.fetch_add(1, Ordering::Relaxed))),
        str::to_owned,
    )
}

/// The fault of a reply: one of ours, or one that axum answered by itself.
fn problem_of(response: &Response) -> Option<Problem> {
    if let Some(problem) = response.extensions().get::<Problem>() {
        return Some(problem.clone());
    }
    let (code, detail) = match response.status() {
        StatusCode::NOT_FOUND => (Code::NotFound, "check the path; /openapi.json lists all of them"),
        StatusCode::METHOD_NOT_ALLOWED => (Code::MethodNotAllowed, "the header `Allow` lists the methods of this path"),
        StatusCode::PAYLOAD_TOO_LARGE => (Code::PayloadTooLarge, "the body is above the limit (GET /v1/limits)"),
        StatusCode::UNSUPPORTED_MEDIA_TYPE => (Code::UnsupportedMediaType, "check the header `Content-Type`"),
        status if status.is_client_error() => {
            (Code::BadRequest, "the request line, a header or the query is malformed")
        }
        status if status.is_server_error() => (Code::Internal, "a fault of the server; please report it"),
        _ => return None,
    };
    Some(Problem::new(code, detail))
}

/// Puts a fault into a reply, keeping headers such as `Allow`.
fn write(problem: &Problem, id: &str, response: Response) -> Response {
    let mut value = json!(problem);
    value["request_id"] = json!(id);
    let mut parts = response.into_parts().0;
    parts.headers.remove(header::CONTENT_LENGTH);
    parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
    parts.headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    if let Some(seconds) = problem.retry_after {
        parts.headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
    }
    Response::from_parts(parts, Body::from(value.to_string()))
}
