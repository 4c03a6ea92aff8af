//! The span of a request: what happens on its behalf says so in the log, and in traces where these are told.

use axum::extract::Request;
use axum::http::StatusCode;
use opentelemetry::global;
use opentelemetry::trace::Status;
use opentelemetry_http::HeaderExtractor;
use tracing::Span;
use tracing_opentelemetry::OpenTelemetrySpanExt;

/// Of a request, within the trace that its `traceparent` names (W3C Trace Context).
pub fn of(request: &Request, id: &str) -> Span {
    let span = tracing::info_span!("request", request_id = id);
    let parent = global::get_text_map_propagator(|context| context.extract(&HeaderExtractor(request.headers())));
    // Where no traces are told there is no parent to set.
    let _ = span.set_parent(parent);
    span.set_attribute("http.request.method", request.method().to_string());
    span.set_attribute("url.path", request.uri().path().to_owned());
    span
}

/// Notes how it was answered.
pub fn answered(span: &Span, status: StatusCode) {
    span.set_attribute("http.response.status_code", i64::from(status.as_u16()));
    if status.is_server_error() {
        span.set_status(Status::error(status.to_string()));
    }
}
