//! `GET /metrics`, in the text format of OpenMetrics, which Prometheus reads.

use super::App;
use crate::jobs::{Code, Problem, State as JobState};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::{Registry, Unit};
use std::time::Duration;

/// The values of the labels of one counter.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Reply {
    method: String,
    status: u16,
}

/// The value of one label.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct StateLabel {
    state: &'static str,
}

/// What is counted of requests.
#[derive(Debug, Clone)]
pub struct Traffic {
    replies: Family<Reply, Counter>,
    seconds: Histogram,
    /// Streams of events that are open.
    pub streams: Gauge,
    /// Connections that are open.
    pub connections: Gauge,
}

impl Traffic {
    /// All at zero.
    pub fn new() -> Self {
        Self {
            replies: Family::default(),
            // 1 ms to about 17 minutes.
            seconds: Histogram::new(exponential_buckets(0.001, 4.0, 11)),
            streams: Gauge::default(),
            connections: Gauge::default(),
        }
    }

    /// A request was answered after so long.
    pub fn answered(&self, method: &str, status: u16, after: Duration) {
        // A client may invent any number of methods.
        let known = ["GET", "HEAD", "POST", "PUT", "DELETE"].contains(&method);
        let method = if known { method } else { "other" }.to_owned();
        self.replies.get_or_create(&Reply { method, status }).inc();
        self.seconds.observe(after.as_secs_f64());
    }
}

/// Counts one as long as it lives.
pub struct Counted(Gauge);

impl Counted {
    /// One more.
    pub fn by(gauge: &Gauge) -> Self {
        gauge.inc();
        Self(gauge.clone())
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.dec();
    }
}

/// `GET /metrics`
pub async fn show(State(app): State<App>) -> Result<Response, Problem> {
    let mut registry = Registry::with_prefix("candela");
    app.service.meters().register(&mut registry);
    gauges(&app, &mut registry);
    let traffic = &app.traffic;
    registry.register("http_replies", "Replies by method and status", traffic.replies.clone());
    let help = "Time until the head of a reply";
    registry.register_with_unit("http_reply", help, Unit::Seconds, traffic.seconds.clone());
    registry.register("http_event_streams", "Streams of events that are open", traffic.streams.clone());
    registry.register("http_connections", "Connections that are open", traffic.connections.clone());
    let mut text = String::new();
    encode(&mut text, &registry).map_err(|error| Problem::new(Code::Internal, error.to_string()))?;
    let kind = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    Ok(([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "no-store")], text).into_response())
}

/// How things stand now.
fn gauges(app: &App, registry: &mut Registry) {
    let jobs = Family::<StateLabel, Gauge>::default();
    for (state, count) in JobState::ALL.iter().zip(app.service.counts()) {
        jobs.get_or_create(&StateLabel { state: state.name() }).set(count as i64);
    }
    registry.register("jobs", "Jobs that are known, by state", jobs);
    let limit = app.service.limits().queue_length as i64;
    let mut single = |name: &str, help: &str, value: i64| {
        let gauge = Gauge::<i64>::default();
        gauge.set(value);
        registry.register(name, help, gauge);
    };
    let (alone, in_batches) = app.service.waiting();
    single("queue_length", "Jobs that wait, without those of batches", alone as i64);
    single("queue_limit", "Jobs that may wait, without those of batches", limit);
    single("batch_queue_length", "Jobs of batches that wait", in_batches as i64);
    single("batch_queue_limit", "Jobs of batches that may wait", app.service.limits().batch_queue_length as i64);
    single("render_memory_bytes", "Estimated memory of the renders under way", app.service.render_memory() as i64);
    single("upload_memory_bytes", "Memory of the bodies being read", app.room.used() as i64);
    if let Some(bytes) = resident_bytes() {
        single("resident_memory_bytes", "Memory of this process", bytes);
    }
}

/// Memory of this process, where the system says so (Linux).
fn resident_bytes() -> Option<i64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse::<i64>().ok().map(|kib| kib << 10)
}
