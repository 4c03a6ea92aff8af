//! The bar on stderr while a picture is traced.

use crate::film::ErrorEstimate;
use crate::render::Settings;
use crate::render::forecast::Forecast;
use crate::render::prepare::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::time::Duration;

const STEPS: u64 = 1000;

/// Samples, error and time left. Hidden by itself where stderr is not a terminal.
pub struct Bar {
    bar: ProgressBar,
    settings: Settings,
    forecast: Forecast,
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
        Self { bar, settings, forecast: Forecast::new(settings), measured: (0, None) }
    }

    /// Shows how far the render is.
    pub fn show(&mut self, progress: Progress<'_>) {
        let samples = progress.film.samples();
        // Measuring reads the whole film: not after each pass.
        if samples >= 2 * self.measured.0 && samples > self.measured.0 {
            self.measured = (samples, progress.film.error());
            if let Some(error) = self.measured.1 {
                self.forecast.look(progress.fraction, error.upper_bound_95);
            }
        }
        let error = self.measured.1.map_or_else(String::new, |e| format!(", error {:.2} %", 100.0 * e.relative_rms));
        let left = self.forecast.left(progress.fraction, progress.elapsed);
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
