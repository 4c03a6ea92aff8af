//! Which samples to take next, independent of engine.
//!
//! The plan is a function of the film alone, so a render goes on from any film: after a lost device, or with
//! more samples asked for.

use super::plan::Round;
use super::{Settings, StopReason};
use crate::film::{Film, REPLICATES, TileSamples};
use std::cmp::Reverse;
use std::ops::ControlFlow;
use std::time::Duration;

/// Most samples per pixel of one entry of a pass: few enough that a sum of them in f32 stays exact to about 1e-6.
pub const MAX_PASS_SAMPLES: u32 = 64;

/// Samples per pixel below which a measured error is not trusted to end a render.
const MIN_SAMPLES_FOR_TARGET: u32 = 16;

/// Samples to take at once: at most as many entries as the film has tiles, each of at most [`MAX_PASS_SAMPLES`]. In an
/// order that spreads the work over the picture; entries may be taken side by side.
pub type Pass = Vec<TileSamples>;

/// The order of passes and the criteria to stop at.
///
/// First one sample in each replicate, so that a picture and its error exist after four; then every replicate in turn
/// doubles its count. Counts per replicate thus pass through powers of two, where Sobol points are best, and a round
/// of passes leaves all replicates of a tile with the same count. [`super::plan`] says which.
#[derive(Debug, Clone, Copy)]
pub struct Schedule {
    settings: Settings,
}

impl Schedule {
    /// The schedule of a render.
    pub fn new(settings: &Settings) -> Self {
        Self { settings: *settings }
    }

    /// The pass that follows what the film holds, or why the render is over. To be asked at the beginning and after each
    /// pass; measures the film's error after each round.
    pub fn next(&self, film: &Film, elapsed: Duration) -> ControlFlow<StopReason, Pass> {
        let Some(round) = Round::of(&self.settings, film) else { return ControlFlow::Break(StopReason::MaxSamples) };
        if round.is_new && self.reached_target(film) {
            return ControlFlow::Break(StopReason::TargetError);
        }
        if self.overdue(film, elapsed) {
            return ControlFlow::Break(StopReason::Deadline);
        }
        ControlFlow::Continue(pass(film, &round))
    }

    /// Whether the deadline has passed and there is something to show for it. Cheap: may be asked within a pass,
    /// which is then abandoned.
    pub fn overdue(&self, film: &Film, elapsed: Duration) -> bool {
        self.settings.deadline.is_some_and(|deadline| elapsed >= deadline) && film.samples() > 0
    }

    /// Part of `max_samples` that the film holds and `under_way` adds to it, 0 to 1.
    pub fn fraction(&self, film: &Film, under_way: &[TileSamples]) -> f64 {
        let tiles = film.tiles();
        let pixels = f64::from(film.width()) * f64::from(film.height());
        let more: u64 = under_way.iter().map(|w| u64::from(tiles.pixels(w.tile)) * u64::from(w.samples)).sum();
        (film.pixel_samples() + more) as f64 / (pixels * f64::from(self.settings.max_samples)).max(1.0)
    }

    /// The bound is asked rather than the estimate, so that a small or a lucky picture does not end too soon.
    fn reached_target(&self, film: &Film) -> bool {
        let Some(target) = self.settings.target_error else { return false };
        film.samples_range().0 >= MIN_SAMPLES_FOR_TARGET
            && film.error().is_some_and(|error| error.upper_bound_95 <= target)
    }
}

/// Takes what is due, those first that have most before them: all replicates of a tile thus keep step.
fn pass(film: &Film, round: &Round) -> Pass {
    let mut due = due(film, round);
    due.sort_by_key(|due| Reverse(due.chunks()));
    let room = film.tiles().count() as usize;
    let mut pass = Vec::new();
    for chunks in (1..=due.first().map_or(0, Due::chunks)).rev() {
        let next = due.iter().take_while(|due| due.chunks() >= chunks).map(|due| due.chunk(due.chunks() - chunks));
        pass.extend(next.take(room - pass.len()));
    }
    pass
}

/// What the round lacks, in an order that spreads it over the picture.
fn due(film: &Film, round: &Round) -> Vec<Due> {
    let tiles: Vec<u32> = film.tiles().spread().collect();
    let of = |replicate| {
        let due = move |&tile: &u32| {
            let first = film.replicate_samples(replicate, tile);
            let samples = round.goal(replicate, tile).saturating_sub(first);
            (samples > 0).then_some(Due { tile, replicate, first, samples })
        };
        tiles.iter().filter_map(due)
    };
    (0..REPLICATES as u32).flat_map(of).collect()
}

/// Samples that a tile lacks in a replicate.
#[derive(Debug, Clone, Copy)]
struct Due {
    tile: u32,
    replicate: u32,
    first: u32,
    samples: u32,
}

impl Due {
    /// Entries that they are cut into.
    fn chunks(&self) -> u32 {
        self.samples.div_ceil(MAX_PASS_SAMPLES)
    }

    /// One of the entries.
    fn chunk(&self, index: u32) -> TileSamples {
        let done = index * MAX_PASS_SAMPLES;
        let samples = (self.samples - done).min(MAX_PASS_SAMPLES);
        TileSamples { tile: self.tile, replicate: self.replicate, first: self.first + done, samples }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::RenderParams;

    fn settings(max_samples: u32) -> Settings {
        Settings::from(&RenderParams { max_samples, adaptive: false, ..RenderParams::default() })
    }

    /// Carries a schedule out on a film of constant pixels, until it ends or `most` passes are taken.
    fn carry_out(schedule: &Schedule, film: &mut Film, most: usize) -> Vec<Pass> {
        let mut passes = Vec::new();
        while passes.len() < most
            && let ControlFlow::Continue(pass) = schedule.next(film, Duration::ZERO)
        {
            assert!(pass.len() <= film.tiles().count() as usize);
            assert!(pass.iter().all(|entry| (1..=MAX_PASS_SAMPLES).contains(&entry.samples)));
            let sums = film.tiles().lanes(&pass, |entry, _| [entry.samples as f32; 4]);
            film.add(&pass, &sums);
            passes.push(pass);
        }
        passes
    }

    /// Passes over 8 x 8 pixels, which are two tiles.
    fn passes(max_samples: u32) -> Vec<Pass> {
        carry_out(&Schedule::new(&settings(max_samples)), &mut Film::new(8, 8), usize::MAX)
    }

    /// A film of constant pixels, the value given per replicate.
    fn film(samples: [u32; REPLICATES], values: [f32; REPLICATES]) -> Film {
        let mut film = Film::new(8, 8);
        film.fill(samples, |_, _, replicate, samples| [values[replicate as usize] * samples as f32; 4]);
        film
    }

    fn entries(replicate: u32, first: u32, samples: u32) -> Pass {
        [0, 1].map(|tile| TileSamples { tile, replicate, first, samples }).to_vec()
    }

    #[test]
    fn takes_exactly_the_samples_asked_for() {
        for max in (1..300).chain([511, 512, 513, 1000, 4096, 100_001]) {
            let mut film = Film::new(8, 8);
            carry_out(&Schedule::new(&settings(max)), &mut film, usize::MAX);
            assert_eq!(film.pixel_samples(), 64 * u64::from(max));
            let counts = [0, 1, 2, 3].map(|replicate| film.replicate_samples(replicate, 0));
            let spread = counts.iter().max().unwrap() - counts.iter().min().unwrap();
            assert!(spread <= 1, "{max} samples are shared as {counts:?}");
        }
    }

    #[test]
    fn begins_with_one_sample_in_each_replicate() {
        assert_eq!(passes(1_000)[..4], [0, 1, 2, 3].map(|replicate| entries(replicate, 0, 1)));
        assert_eq!(passes(3), [0, 1, 2].map(|replicate| entries(replicate, 0, 1)));
    }

    #[test]
    fn replicates_grow_through_powers_of_two() {
        let entries: Vec<TileSamples> = passes(4 * 256).concat();
        let of_one = entries.iter().filter(|e| e.replicate == 2 && e.tile == 1);
        let ends: Vec<u32> = of_one.map(|e| e.first + e.samples).collect();
        assert_eq!(ends, [1, 2, 4, 8, 16, 32, 64, 128, 192, 256]);
    }

    #[test]
    fn goes_on_from_any_film() {
        let schedule = Schedule::new(&settings(256));
        let next = |counts| schedule.next(&film(counts, [1.0; 4]), Duration::ZERO);
        assert_eq!(next([16, 16, 8, 8]), ControlFlow::Continue(entries(2, 8, 8)));
        assert_eq!(next([64; 4]), ControlFlow::Break(StopReason::MaxSamples));
        assert_eq!(next([25, 25, 25, 25]), ControlFlow::Continue(entries(0, 25, 7)));
    }

    #[test]
    fn stops_at_the_first_criterion() {
        let stop = |schedule: Schedule, film: &Film, elapsed| schedule.next(film, elapsed).break_value();
        let late = Duration::from_secs(5);
        let plain = Schedule::new(&settings(64));
        assert_eq!(stop(plain, &film([16; 4], [1.0; 4]), late), Some(StopReason::MaxSamples));
        assert_eq!(stop(plain, &film([16, 16, 16, 15], [1.0; 4]), late), None);

        let hurried = Schedule::new(&Settings { deadline: Some(Duration::from_secs(4)), ..settings(64) });
        assert_eq!(stop(hurried, &film([1, 0, 0, 0], [1.0; 4]), late), Some(StopReason::Deadline));
        assert_eq!(stop(hurried, &film([1, 0, 0, 0], [1.0; 4]), Duration::from_secs(3)), None);
        assert_eq!(stop(hurried, &Film::new(8, 8), late), None, "an empty film is not a picture");
    }

    #[test]
    fn the_target_is_asked_of_whole_rounds_only() {
        let schedule = Schedule::new(&Settings { target_error: Some(0.05), ..settings(1 << 20) });
        let stop = |counts, values| schedule.next(&film(counts, values), Duration::ZERO).break_value();
        assert_eq!(stop([8; 4], [1.0, 1.001, 0.999, 1.0]), Some(StopReason::TargetError));
        assert_eq!(stop([8; 4], [1.0, 1.5, 0.5, 1.0]), None);
        assert_eq!(stop([16, 8, 8, 8], [1.0; 4]), None);
        assert_eq!(stop([2; 4], [1.0; 4]), None);
    }
}
