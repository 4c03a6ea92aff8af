//! The span of a request: what happens on its behalf says so in the log, and in traces where these are told.

use axum::extract::Request;
use axum::http::StatusCode;
use opentelemetry::Context;
use opentelemetry::propagation::TextMapPropagator;
use opentelemetry::trace::{Status, TraceContextExt};
use opentelemetry_http::HeaderExtractor;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use tracing::Span;
use tracing::field::Empty;
use tracing_opentelemetry::OpenTelemetrySpanExt;

/// Of a request, within the trace that its `traceparent` names (W3C Trace Context), and the id of its trace, if it has one.
pub fn of(request: &Request, id: &str) -> (Span, Option<String>) {
    let span = tracing::info_span!("request", request_id = id, trace_id = Empty);
    let parent = TraceContextPropagator::new().extract(&HeaderExtractor(request.headers()));
    // Where no traces are told there is no parent to set.
    let _ = span.set_parent(parent.clone());
    let trace = trace_id(&span.context()).or_else(|| trace_id(&parent));
    span.record("trace_id", trace.as_deref());
    span.set_attribute("http.request.method", request.method().to_string());
    span.set_attribute("url.path", request.uri().path().to_owned());
    (span, trace)
}

fn trace_id(context: &Context) -> Option<String> {
    let span = context.span();
    let span = span.span_context();
    span.is_valid().then(|| span.trace_id().to_string())
}

/// Notes how it was answered.
pub fn answered(span: &Span, status: StatusCode) {
    span.set_attribute("http.response.status_code", i64::from(status.as_u16()));
    if status.is_server_error() {
        span.set_status(Status::error(status.to_string()));
    }
}
