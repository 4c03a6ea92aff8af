//! What a finished render says about itself: as JSON on the job, as headers, as text in the picture.

use super::{DeviceInfo, NonFinite, StopReason};
use crate::compile::{CompileStats, DefaultTaken};
use crate::denoise;
use crate::scene::Warning;
use serde::Serialize;

/// Seconds that each stage of a picture took.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Stages {
    /// Reading the request's body.
    pub upload: f64,
    /// glTF to scene; 0 if the scene was there already.
    pub import: f64,
    /// Scene to trees, tables and texels; near 0 if it was compiled already.
    pub compile: f64,
    /// Waiting for a place on the device.
    pub queue: f64,
    /// Scene to device, pipelines.
    pub device_upload: f64,
    /// Slices of the device spent on this job.
    pub trace: f64,
    /// Smoothing the noise, if that was asked for.
    pub denoise: f64,
    /// Film to file, in the format of `output`.
    pub encode: f64,
}

/// Facts of a finished render.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Samples per pixel, on the average of the picture, to the nearest whole number.
    pub samples: u32,
    /// Samples of the pixels that have fewest.
    pub samples_min: u32,
    /// Samples of the pixels that have most.
    pub samples_max: u32,
    /// Whether noisy parts were to get more samples than others.
    pub adaptive: bool,
    /// Measured relative error (docs/accuracy.md); none if too few samples were taken to measure it.
    pub error: Option<f64>,
    /// The error is below this with 95 % confidence.
    pub error_bound_95: Option<f64>,
    /// What has denoised the picture after that; none: nothing has.
    pub denoised: Option<String>,
    /// Seed of every random number.
    pub seed: u32,
    /// What traced.
    pub engine: &'static str,
    /// On what.
    pub device: DeviceInfo,
    /// Why it ended.
    pub stop_reason: StopReason,
    /// Seconds per stage.
    pub seconds: Stages,
    /// Biases that the request allowed.
    pub biases: Vec<String>,
    /// What the request left open, and what was taken.
    pub defaults: Vec<DefaultTaken>,
    /// What the picture lacks.
    pub warnings: Vec<Warning>,
    /// Samples dropped because they were not finite.
    pub non_finite: NonFinite,
    /// What compiling found.
    pub scene: CompileStats,
}

impl Report {
    /// Whether the same request would give the same picture: neither a clock nor a fault has had a part in it.
    pub fn is_repeatable(&self) -> bool {
        self.stop_reason != StopReason::Deadline && !self.warnings.iter().any(|warning| warning.code == denoise::FAILED)
    }

    /// Facts that are the same whenever the same picture is made: for the file itself, whose bytes must not change.
    pub fn facts(&self) -> Vec<(String, String)> {
        let error = |value: Option<f64>| value.map_or_else(|| "unknown".to_owned(), |value| format!("{value:.6}"));
        let defaults: Vec<_> = self.defaults.iter().map(|d| format!("{}={}", d.what, d.value)).collect();
        let warnings: Vec<_> = self.warnings.iter().map(|w| format!("{} {}", w.code, w.pointer)).collect();
        [
            ("Candela-Samples", self.samples.to_string()),
            ("Candela-Samples-Range", format!("{} to {}", self.samples_min, self.samples_max)),
            ("Candela-Adaptive", self.adaptive.to_string()),
            ("Candela-Error", error(self.error)),
            ("Candela-Error-Bound-95", error(self.error_bound_95)),
            ("Candela-Denoised", self.denoised.clone().unwrap_or_else(|| "no".to_owned())),
            ("Candela-Seed", self.seed.to_string()),
            ("Candela-Engine", self.engine.to_owned()),
            ("Candela-Device", format!("{}; {}; {}", self.device.name, self.device.backend, self.device.driver)),
            ("Candela-Stop-Reason", self.stop_reason.name().to_owned()),
            ("Candela-Biases", list(&self.biases)),
            ("Candela-Defaults", list(&defaults)),
            ("Candela-Warnings", list(&warnings)),
            ("Candela-Non-Finite", (self.non_finite.nan + self.non_finite.infinite).to_string()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .to_vec()
    }

    /// Seconds per stage, for a header.
    pub fn stage_line(&self) -> String {
        let s = &self.seconds;
        let stages = [
            ("upload", s.upload),
            ("import", s.import),
            ("compile", s.compile),
            ("queue", s.queue),
            ("device_upload", s.device_upload),
            ("trace", s.trace),
            ("denoise", s.denoise),
            ("encode", s.encode),
        ];
        stages.map(|(name, seconds)| format!("{name}={seconds:.4}")).join(", ")
    }
}

fn list(items: &[String]) -> String {
    if items.is_empty() { "none".to_owned() } else { items.join("; ") }
}
