//! The bar on stderr while a picture is traced.

use crate::film::ErrorEstimate;
use crate::render::Settings;
use crate::render::prepare::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::time::Duration;

const STEPS: u64 = 1000;

/// Samples, error and time left. Hidden by itself where stderr is not a terminal.
pub struct Bar {
    bar: ProgressBar,
    settings: Settings,
    /// Samples at which the error was last measured, and what it was.
    measured: (u32, Option<ErrorEstimate>),
}

impl Bar {
    /// A bar for a render with these stop criteria.
    pub fn new(settings: Settings, quiet: bool) -> Self {
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(STEPS) };
        if let Ok(style) = ProgressStyle::with_template("{bar:32} {msg}") {
            bar.set_style(style);
        }
        Self { bar, settings, measured: (0, None) }
    }

    /// Shows how far the render is.
    pub fn show(&mut self, progress: Progress<'_>) {
        let samples = progress.film.samples();
        // Measuring reads the whole film: not after each pass.
        if samples >= 2 * self.measured.0 && samples > self.measured.0 {
            self.measured = (samples, progress.film.error());
        }
        let error = self.measured.1.map_or_else(String::new, |e| format!(", error {:.2} %", 100.0 * e.relative_rms));
        let left = time_left(&self.settings, progress.fraction, progress.elapsed, self.measured);
        let left = left.map_or_else(String::new, |left| format!(", {} s left", left.as_secs_f64().ceil()));
        let done = part_done(&self.settings, progress.fraction, progress.elapsed);
        self.bar.set_position((done * STEPS as f64) as u64);
        self.bar.set_message(format!("{samples} samples{error}{left}"));
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Part of the render that is done, by samples or by the deadline, whichever comes first.
fn part_done(settings: &Settings, fraction: f64, elapsed: Duration) -> f64 {
    let of_time = settings.deadline.map_or(0.0, |deadline| elapsed.as_secs_f64() / deadline.as_secs_f64());
    fraction.max(of_time).min(1.0)
}

/// The first of the stop criteria to come: samples at the present rate, the deadline, or the target, the error falling
/// with the square root of the samples.
fn time_left(
    settings: &Settings,
    fraction: f64,
    elapsed: Duration,
    measured: (u32, Option<ErrorEstimate>),
) -> Option<Duration> {
    if fraction <= 0.0 {
        return None;
    }
    let whole = elapsed.as_secs_f64() / fraction;
    let by_error = settings.target_error.zip(measured.1).map(|(target, error)| {
        let samples = f64::from(measured.0) * (error.upper_bound_95 / target).powi(2);
        whole * samples / f64::from(settings.max_samples)
    });
    let by_time = settings.deadline.map(|deadline| deadline.as_secs_f64());
    let end = [by_error, by_time].into_iter().flatten().fold(whole, f64::min);
    Duration::try_from_secs_f64((end - elapsed.as_secs_f64()).max(0.0)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::RenderParams;

    fn left(params: &RenderParams, measured: (u32, Option<ErrorEstimate>)) -> f64 {
        let left = time_left(&Settings::from(params), 0.25, Duration::from_secs(10), measured);
        left.unwrap().as_secs_f64()
    }

    #[test]
    fn the_first_criterion_decides() {
        let plain = RenderParams { max_samples: 400, ..RenderParams::default() };
        assert!((left(&plain, (100, None)) - 30.0).abs() < 1e-9);
        let hurried = RenderParams { deadline_ms: Some(15_000), ..plain.clone() };
        assert!((left(&hurried, (100, None)) - 5.0).abs() < 1e-9);
        let aimed = RenderParams { target_error: Some(0.1), ..plain };
        let error = |e| Some(ErrorEstimate { relative_rms: e, upper_bound_95: e });
        assert!((left(&aimed, (100, error(0.1414214))) - 10.0).abs() < 1e-3, "twice the samples halve the variance");
        assert!((left(&aimed, (100, error(9.0))) - 30.0).abs() < 1e-9, "max_samples come first");
    }
}
