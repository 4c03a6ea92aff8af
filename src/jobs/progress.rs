//! How far a job is.

use super::outcome::Outcome;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// How far a render is.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Progress {
    /// Part of the work done, 0 to 1.
    pub fraction: f64,
    /// Samples per pixel so far.
    pub samples: u32,
    /// Measured relative error so far.
    pub error: Option<f64>,
    /// The error is below this with 95 % confidence.
    pub error_bound_95: Option<f64>,
    /// Estimate of the seconds left.
    pub eta_seconds: Option<f64>,
}

impl Progress {
    /// That of a render that has ended.
    pub fn of(outcome: &Outcome) -> Self {
        let record = &outcome.record;
        Self {
            fraction: 1.0,
            samples: record.samples,
            error: record.error,
            error_bound_95: record.error_bound_95,
            eta_seconds: Some(0.0),
        }
    }
}

/// Seconds of a span.
pub fn seconds(span: Duration) -> f64 {
    (span.as_secs_f64() * 1e6).round() / 1e6
}
