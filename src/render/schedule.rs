//! Which samples to take next, independent of engine.
//!
//! The plan is a function of the film's counts alone, so a render goes on from any film: after a lost device, or with
//! more samples asked for.

use super::{Settings, StopReason};
use crate::film::{Film, REPLICATES};
use std::time::Duration;

/// Most samples per pixel of one pass: few enough that a sum of them in f32 stays exact to about 1e-6.
pub const MAX_PASS_SAMPLES: u32 = 64;

/// Samples per replicate below which a measured error is not trusted to end a render.
const MIN_SAMPLES_FOR_TARGET: u32 = 4;

/// Samples to take of every pixel, all of one replicate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pass {
    /// Replicate, below [`REPLICATES`].
    pub replicate: u32,
    /// Index of the first sample in the replicate's own sequence.
    pub first: u32,
    /// Samples per pixel, 1 to [`MAX_PASS_SAMPLES`].
    pub samples: u32,
}

/// The order of passes and the criteria to stop at.
///
/// First one sample in each replicate, so that a picture and its error exist after four; then every replicate in turn
/// doubles its count, up to [`MAX_PASS_SAMPLES`] more at a time. Counts per replicate thus pass through powers of two,
/// where Sobol points are best, and a round of passes leaves all replicates with the same count.
#[derive(Debug, Clone, Copy)]
pub struct Schedule {
    max_samples: u32,
    target_error: Option<f64>,
    deadline: Option<Duration>,
}

impl Schedule {
    /// The schedule of a render.
    pub fn new(settings: &Settings) -> Self {
        Self { max_samples: settings.max_samples, target_error: settings.target_error, deadline: settings.deadline }
    }

    /// The pass that follows what the film holds; none: it holds `max_samples`.
    pub fn next(&self, film: &Film) -> Option<Pass> {
        self.after(counts(film))
    }

    /// Why the render is over, if it is. To be asked after each pass; measures the film's error after each round.
    pub fn stop(&self, film: &Film, elapsed: Duration) -> Option<StopReason> {
        if film.samples() >= self.max_samples {
            return Some(StopReason::MaxSamples);
        }
        if self.reached_target(film) {
            return Some(StopReason::TargetError);
        }
        self.overdue(film, elapsed).then_some(StopReason::Deadline)
    }

    /// Whether the deadline has passed and there is something to show for it. Cheap: may be asked within a pass,
    /// which is then abandoned.
    pub fn overdue(&self, film: &Film, elapsed: Duration) -> bool {
        self.deadline.is_some_and(|deadline| elapsed >= deadline) && film.samples() > 0
    }

    fn after(&self, counts: [u32; REPLICATES]) -> Option<Pass> {
        let left = self.max_samples.saturating_sub(counts.iter().sum());
        let (replicate, &first) = counts.iter().enumerate().min_by_key(|&(_, count)| count)?;
        let samples = round_end(first).min(self.share(replicate)).saturating_sub(first).max(1).min(left);
        (samples > 0).then_some(Pass { replicate: replicate as u32, first, samples })
    }

    /// Part of `max_samples` that a replicate gets in the end.
    fn share(&self, replicate: usize) -> u32 {
        let replicates = REPLICATES as u32;
        self.max_samples / replicates + u32::from((replicate as u32) < self.max_samples % replicates)
    }

    /// The bound is asked rather than the estimate, so that a small or a lucky picture does not end too soon.
    fn reached_target(&self, film: &Film) -> bool {
        let Some(target) = self.target_error else { return false };
        let counts = counts(film);
        let whole_round = counts.iter().all(|&count| count == counts[0] && count >= MIN_SAMPLES_FOR_TARGET);
        whole_round && film.error().is_some_and(|error| error.upper_bound_95 <= target)
    }
}

fn counts(film: &Film) -> [u32; REPLICATES] {
    std::array::from_fn(|replicate| film.replicate_samples(replicate))
}

/// Count of a replicate at the end of the round that begins with `count`: 1, 2, 4, ... 64, 128, 192, ...
fn round_end(count: u32) -> u32 {
    let block = if count == 0 { 1 } else { (1 << count.ilog2()).min(MAX_PASS_SAMPLES) };
    (count / block).saturating_add(1).saturating_mul(block)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{EngineChoice, Mode};

    fn settings(max_samples: u32) -> Settings {
        Settings {
            engine: EngineChoice::Auto,
            mode: Mode::Path,
            max_bounces: None,
            multiple_scattering: true,
            seed: 1,
            max_samples,
            target_error: None,
            deadline: None,
        }
    }

    fn passes(max_samples: u32) -> Vec<Pass> {
        let schedule = Schedule::new(&settings(max_samples));
        let mut counts = [0; REPLICATES];
        let mut passes = Vec::new();
        while let Some(pass) = schedule.after(counts) {
            assert_eq!(pass.first, counts[pass.replicate as usize], "a replicate's sequence has no gap");
            assert!((1..=MAX_PASS_SAMPLES).contains(&pass.samples));
            counts[pass.replicate as usize] += pass.samples;
            passes.push(pass);
        }
        passes
    }

    /// A film of constant pixels, the value given per replicate.
    fn film(samples: [u32; REPLICATES], values: [f32; REPLICATES]) -> Film {
        let mut film = Film::new(8, 8);
        for replicate in 0..REPLICATES {
            let sum = values[replicate] * samples[replicate] as f32;
            film.add(replicate, samples[replicate], &[[sum, sum, sum, samples[replicate] as f32]; 64]);
        }
        film
    }

    #[test]
    fn takes_exactly_the_samples_asked_for() {
        for max in (1..300).chain([511, 512, 513, 1000, 4096, 100_001]) {
            let passes = passes(max);
            assert_eq!(passes.iter().map(|p| p.samples).sum::<u32>(), max);
            let of = |r| passes.iter().filter(|p| p.replicate == r).map(|p| p.samples).sum::<u32>();
            let counts = [of(0), of(1), of(2), of(3)];
            let spread = counts.iter().max().unwrap() - counts.iter().min().unwrap();
            assert!(spread <= 1, "{max} samples are shared as {counts:?}");
        }
    }

    #[test]
    fn begins_with_one_sample_in_each_replicate() {
        let one = |replicate| Pass { replicate, first: 0, samples: 1 };
        assert_eq!(passes(1_000)[..4], [one(0), one(1), one(2), one(3)]);
        assert_eq!(passes(3), [one(0), one(1), one(2)]);
    }

    #[test]
    fn replicates_grow_through_powers_of_two() {
        let ends: Vec<u32> = passes(4 * 256).iter().filter(|p| p.replicate == 2).map(|p| p.first + p.samples).collect();
        assert_eq!(ends, [1, 2, 4, 8, 16, 32, 64, 128, 192, 256]);
    }

    #[test]
    fn goes_on_from_any_film() {
        let schedule = Schedule::new(&settings(256));
        let resumed = schedule.next(&film([16, 16, 8, 8], [1.0; 4]));
        assert_eq!(resumed, Some(Pass { replicate: 2, first: 8, samples: 8 }));
        assert_eq!(schedule.next(&film([64; 4], [1.0; 4])), None);
        assert_eq!(schedule.next(&film([200, 20, 20, 16], [1.0; 4])), None, "never more than was asked for");
        let foreign = schedule.next(&film([200, 20, 20, 15], [1.0; 4]));
        assert_eq!(foreign, Some(Pass { replicate: 3, first: 15, samples: 1 }));
    }

    #[test]
    fn stops_at_the_first_criterion() {
        let late = Duration::from_secs(5);
        let plain = Schedule::new(&settings(64));
        assert_eq!(plain.stop(&film([16; 4], [1.0; 4]), late), Some(StopReason::MaxSamples));
        assert_eq!(plain.stop(&film([16, 16, 16, 15], [1.0; 4]), late), None);

        let hurried = Schedule::new(&Settings { deadline: Some(Duration::from_secs(4)), ..settings(64) });
        assert_eq!(hurried.stop(&film([1, 0, 0, 0], [1.0; 4]), late), Some(StopReason::Deadline));
        assert_eq!(hurried.stop(&film([1, 0, 0, 0], [1.0; 4]), Duration::from_secs(3)), None);
        assert_eq!(hurried.stop(&Film::new(8, 8), late), None, "an empty film is not a picture");
    }

    #[test]
    fn the_target_is_asked_of_whole_rounds_only() {
        let schedule = Schedule::new(&Settings { target_error: Some(0.05), ..settings(1 << 20) });
        let stop = |counts, values| schedule.stop(&film(counts, values), Duration::ZERO);
        assert_eq!(stop([8; 4], [1.0, 1.001, 0.999, 1.0]), Some(StopReason::TargetError));
        assert_eq!(stop([8; 4], [1.0, 1.5, 0.5, 1.0]), None);
        assert_eq!(stop([16, 8, 8, 8], [1.0; 4]), None);
        assert_eq!(stop([2; 4], [1.0; 4]), None);
    }
}
