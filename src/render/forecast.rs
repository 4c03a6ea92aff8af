//! When a render will end, from what has been seen of it.

use super::Settings;
use std::time::Duration;

/// Power of the samples by which an error falls while nothing has been seen of it: that of independent samples.
const USUAL_DECAY: f64 = 0.5;

/// Bounds on the power that is believed: noise in two looks may suggest anything.
const DECAYS: (f64, f64) = (0.25, 1.5);

/// Growth of the samples between two looks from which the decay is taken.
const BASE: f64 = 2.0;

/// Looks at a render under way.
#[derive(Debug, Clone)]
pub struct Forecast {
    settings: Settings,
    /// (part of `max_samples`, bound on the error), oldest first, each at least a tenth further than the one before.
    looks: Vec<(f64, f64)>,
}

impl Forecast {
    /// Nothing seen yet.
    pub fn new(settings: Settings) -> Self {
        Self { settings, looks: Vec::new() }
    }

    /// Notes the 95 % bound on the error when `fraction` of `max_samples` were done.
    pub fn look(&mut self, fraction: f64, bound: f64) {
        if self.looks.last().is_some_and(|&(last, _)| fraction < 1.1 * last) {
            self.looks.pop();
        }
        if fraction > 0.0 && bound > 0.0 {
            self.looks.push((fraction, bound));
        }
    }

    /// Time until the first of the stop criteria: `max_samples` at the speed so far, the deadline, or the target, the error
    /// falling on as it did. None: nothing is done yet.
    pub fn left(&self, fraction: f64, elapsed: Duration) -> Option<Duration> {
        if fraction <= 0.0 {
            return None;
        }
        let elapsed = elapsed.as_secs_f64();
        let whole = elapsed / fraction;
        let by_target = self.fraction_at_target().map(|fraction| whole * fraction);
        let by_time = self.settings.deadline.map(|deadline| deadline.as_secs_f64());
        let end = [by_target, by_time].into_iter().flatten().fold(whole, f64::min);
        Duration::try_from_secs_f64((end - elapsed).max(0.0)).ok()
    }

    /// Part of `max_samples` at which the target will be reached.
    fn fraction_at_target(&self) -> Option<f64> {
        let (&(fraction, bound), target) = self.looks.last().zip(self.settings.target_error)?;
        Some(fraction * (bound / target).powf(1.0 / self.decay()))
    }

    /// Power of the samples by which the error falls.
    fn decay(&self) -> f64 {
        let Some(&(fraction, bound)) = self.looks.last() else { return USUAL_DECAY };
        let Some(&(before, bound_before)) = self.looks.iter().rev().find(|look| look.0 * BASE <= fraction) else {
            return USUAL_DECAY;
        };
        ((bound_before / bound).ln() / (fraction / before).ln()).clamp(DECAYS.0, DECAYS.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::RenderParams;

    /// Seconds left at a quarter of the samples after ten seconds.
    fn left(params: &RenderParams, looks: &[(f64, f64)]) -> f64 {
        let mut forecast = Forecast::new(Settings::from(params));
        looks.iter().for_each(|&(fraction, bound)| forecast.look(fraction, bound));
        forecast.left(0.25, Duration::from_secs(10)).unwrap().as_secs_f64()
    }

    #[test]
    fn the_first_criterion_decides() {
        let plain = RenderParams::default();
        assert!((left(&plain, &[]) - 30.0).abs() < 1e-9);
        let hurried = RenderParams { deadline_ms: Some(15_000), ..plain.clone() };
        assert!((left(&hurried, &[(0.25, 0.1)]) - 5.0).abs() < 1e-9);
        let aimed = RenderParams { target_error: Some(0.1), ..plain };
        assert!(
            (left(&aimed, &[(0.25, 0.1 * 2f64.sqrt())]) - 10.0).abs() < 1e-9,
            "twice the samples halve the variance"
        );
        assert!((left(&aimed, &[(0.25, 9.0)]) - 30.0).abs() < 1e-9, "max_samples come first");
        assert_eq!(left(&aimed, &[(0.25, 0.05)]), 0.0);
    }

    #[test]
    fn the_error_falls_on_as_it_did() {
        let aimed = RenderParams { target_error: Some(0.1), ..RenderParams::default() };
        // As one over the samples: twice as many are enough, in ten seconds more.
        let looks = [(0.0625, 0.8), (0.125, 0.4), (0.25, 0.2)];
        assert!((left(&aimed, &looks) - 10.0).abs() < 1e-9);
        // Looks that are too close to each other, or that saw it rise, are no ground for hope or despair.
        assert!((left(&aimed, &[(0.24, 1.0), (0.25, 0.14142135623730953)]) - 10.0).abs() < 1e-6);
        assert!((left(&aimed, &[(0.125, 0.01), (0.25, 0.11)]) - (10.0 * 1.1f64.powi(4) - 10.0)).abs() < 1e-9);
    }

    #[test]
    fn nothing_done_is_no_forecast() {
        let forecast = Forecast::new(Settings::from(&RenderParams::default()));
        assert_eq!(forecast.left(0.0, Duration::from_secs(1)), None);
    }
}
