//! What the service counts of itself, for `GET /metrics`.

use super::outcome::Record;
use super::state::State;
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::{Registry, Unit};
use std::fmt::{self, Debug, Formatter};

/// The value of one label.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct StateLabel {
    state: &'static str,
}

/// The value of one label.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct StageLabel {
    stage: String,
}

/// Counters that only grow, since the process began.
pub struct Meters {
    /// Jobs that the ledger has taken.
    pub accepted: Counter,
    /// Jobs that got the result of another.
    pub cached: Counter,
    /// Films saved.
    pub saved: Counter,
    /// Devices lost.
    pub lost: Counter,
    /// Messages of webhooks that were taken.
    pub told: Counter,
    /// Attempts of webhooks that failed.
    pub untold: Counter,
    /// Samples of pixels.
    pub samples: Counter,
    ended: Family<StateLabel, Counter>,
    stages: Family<StageLabel, Histogram, fn() -> Histogram>,
}

impl Meters {
    /// All at zero.
    pub fn new() -> Self {
        Self {
            accepted: Counter::default(),
            cached: Counter::default(),
            saved: Counter::default(),
            lost: Counter::default(),
            told: Counter::default(),
            untold: Counter::default(),
            samples: Counter::default(),
            ended: Family::default(),
            // 1 ms to about 70 minutes.
            stages: Family::new_with_constructor(|| Histogram::new(exponential_buckets(0.001, 4.0, 12))),
        }
    }

    /// A job has ended.
    pub fn end(&self, state: State) {
        self.ended.get_or_create(&StateLabel { state: state.name() }).inc();
    }

    /// A render has made a picture of so many pixels.
    pub fn rendered(&self, record: &Record, pixels: u64) {
        self.samples.inc_by(u64::from(record.samples).saturating_mul(pixels));
        let stages = record.report["seconds"].as_object().into_iter().flatten();
        for (stage, seconds) in stages.filter_map(|(stage, seconds)| Some((stage, seconds.as_f64()?))) {
            self.stages.get_or_create(&StageLabel { stage: stage.clone() }).observe(seconds);
        }
    }

    /// Names them for the reply.
    pub fn register(&self, registry: &mut Registry) {
        registry.register("jobs_accepted", "Jobs that the ledger has taken", self.accepted.clone());
        registry.register("jobs_ended", "Jobs that have ended, by state", self.ended.clone());
        registry.register("jobs_cached", "Jobs that got the result of another", self.cached.clone());
        registry.register("films_saved", "Unfinished films that were saved", self.saved.clone());
        registry.register("devices_lost", "Devices that were lost during a render", self.lost.clone());
        registry.register("webhooks_taken", "Messages of webhooks that were taken", self.told.clone());
        registry.register("webhooks_failed", "Attempts of webhooks that failed", self.untold.clone());
        registry.register("pixel_samples", "Samples of pixels in finished pictures", self.samples.clone());
        registry.register_with_unit("stage", "Time per stage of a render", Unit::Seconds, self.stages.clone());
    }
}

impl Default for Meters {
    fn default() -> Self {
        Self::new()
    }
}

impl Debug for Meters {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_struct("Meters").finish_non_exhaustive()
    }
}
