//! How many samples each tile should hold: in the end, and when the present round is done.

use super::Settings;
use crate::film::{Film, MOST, PILOT, REPLICATES, STEPS};

/// Samples per replicate up to which counts double; from there on they grow in finer steps.
const DOUBLING: u32 = 64;

/// The round that a film is in.
#[derive(Debug, Clone)]
pub struct Round {
    /// What each tile should hold in each replicate (by replicate, then tile).
    goals: Vec<u32>,
    tiles: u32,
    /// Whether nothing of this round has been taken yet, so that the film holds whole rounds.
    pub is_new: bool,
}

impl Round {
    /// The round that follows what the film holds; none: it holds all that was asked for.
    pub fn of(settings: &Settings, film: &Film) -> Option<Self> {
        match film.rates() {
            Some(rates) if settings.adaptive => Allotment::new(settings, film, rates).round(film),
            _ => uniform(settings.max_samples, film),
        }
    }

    /// Samples per pixel that a tile should have in a replicate when the round is done.
    pub fn goal(&self, replicate: u32, tile: u32) -> u32 {
        self.goals[(replicate * self.tiles + tile) as usize]
    }
}

/// Replicates and tiles, in the order of goals. Tiles without pixels want nothing.
fn cells(film: &Film) -> impl Iterator<Item = (u32, u32)> {
    let tiles = film.tiles().count();
    (0..REPLICATES as u32).flat_map(move |replicate| (0..tiles).map(move |tile| (replicate, tile)))
}

/// The part of so many samples that a replicate gets.
fn share(samples: u32, replicate: u32) -> u32 {
    let replicates = REPLICATES as u32;
    samples / replicates + u32::from(replicate < samples % replicates)
}

/// First one sample in each replicate, then each replicate doubles its count, up to 64 more at a time.
fn uniform(max_samples: u32, film: &Film) -> Option<Round> {
    let tiles = film.tiles();
    let held = |(replicate, tile)| (film.replicate_samples(replicate, tile), share(max_samples, replicate));
    let with_pixels = || cells(film).filter(|&(_, tile)| tiles.pixels(tile) > 0).map(held);
    let least = with_pixels().filter(|(count, share)| count < share).map(|(count, _)| count).min()?;
    let goal = |(replicate, tile)| {
        if tiles.pixels(tile) > 0 { share(max_samples, replicate).min(round_end(least)) } else { 0 }
    };
    let is_new = with_pixels().all(|(count, _)| count == least);
    Some(Round { goals: cells(film).map(goal).collect(), tiles: tiles.count(), is_new })
}

/// Count at the end of the round that begins with `count`: 1, 2, 4, ... 64, 128, 192, ...
fn round_end(count: u32) -> u32 {
    let block = if count == 0 { 1 } else { (1 << count.ilog2()).min(DOUBLING) };
    (count / block).saturating_add(1).saturating_mul(block)
}

/// Samples by rates: at level `k` a tile of rate `2^(a / 4)` has about `PILOT 2^((k + a) / 4)` in each replicate, rounded to
/// what Sobol points like.
struct Allotment<'a> {
    rates: &'a [i8],
    /// Samples in all replicates that each tile has in the end.
    ends: Vec<u32>,
}

impl<'a> Allotment<'a> {
    fn new(settings: &Settings, film: &Film, rates: &'a [i8]) -> Self {
        let mut ends = vec![0; rates.len()];
        for color in 0..2 {
            allot(film, rates, color, settings.max_samples, &mut ends);
        }
        Self { rates, ends }
    }

    fn round(&self, film: &Film) -> Option<Round> {
        let missing = |&(replicate, tile): &(u32, u32)| {
            film.replicate_samples(replicate, tile) < share(self.ends[tile as usize], replicate)
        };
        let level_of = |(replicate, tile): (u32, u32)| {
            steps_beyond(film.replicate_samples(replicate, tile)) - i32::from(self.rates[tile as usize])
        };
        let level = cells(film).filter(missing).map(level_of).min()?;
        let goals = |level| move |(replicate, tile)| self.goal(replicate, tile, level);
        let held = cells(film).map(|(replicate, tile)| film.replicate_samples(replicate, tile));
        let is_new = cells(film).map(goals(level - 1)).eq(held);
        Some(Round { goals: cells(film).map(goals(level)).collect(), tiles: film.tiles().count(), is_new })
    }

    fn goal(&self, replicate: u32, tile: u32, level: i32) -> u32 {
        let tile = tile as usize;
        count_at(level + i32::from(self.rates[tile])).min(share(self.ends[tile], replicate))
    }
}

/// Shares the samples of all tiles of a colour among them: the highest level that can be paid in full, then as much as is
/// left of the next, evenly. In all `max_samples` per pixel, less fewer than one more sample of one tile.
fn allot(film: &Film, rates: &[i8], color: u32, max_samples: u32, ends: &mut [u32]) {
    let of_color = || film.tiles().spread().filter(|tile| tile % 2 == color);
    let pixels = |tile: u32| u64::from(film.tiles().pixels(tile));
    // Pixels by rate.
    let mut crowd = [0; 2 * MOST as usize + 1];
    for tile in of_color() {
        crowd[(i32::from(rates[tile as usize]) + MOST) as usize] += pixels(tile);
    }
    let cost = |level: i32| {
        let rates = (level - MOST..).zip(&crowd);
        rates.map(|(steps, &pixels)| u64::from(count_at(steps)) * pixels).sum::<u64>() * REPLICATES as u64
    };
    let budget = u64::from(max_samples) * of_color().map(pixels).sum::<u64>();
    // At the lowest level no tile is beyond the pilot, which has been paid.
    let level = (-MOST..COUNTS.len() as i32).find(|level| cost(level + 1) > budget).unwrap_or(-MOST);
    let (low, high) = (cost(level), cost(level + 1));
    let part = budget.saturating_sub(low) as f64 / (high - low).max(1) as f64;
    let mut left = budget;
    for tile in of_color() {
        let steps = level + i32::from(rates[tile as usize]);
        let [low, high] = [steps, steps + 1].map(|steps| REPLICATES as u32 * count_at(steps));
        ends[tile as usize] = low + (part * f64::from(high - low)).floor() as u32;
        left = left.saturating_sub(u64::from(ends[tile as usize]) * pixels(tile));
    }
    for tile in of_color() {
        let steps = level + i32::from(rates[tile as usize]);
        if count_at(steps + 1) > count_at(steps) && left >= pixels(tile) {
            ends[tile as usize] += 1;
            left -= pixels(tile);
        }
    }
}

/// Samples per replicate after so many steps from the pilot, four to an octave: powers of two up to 64, then quarters of
/// octaves (64, 80, 96, 112, 128, 160, ...).
fn count_at(steps: i32) -> u32 {
    COUNTS[steps.clamp(0, COUNTS.len() as i32 - 1) as usize]
}

/// The first number of steps at which there are more than `count` samples.
fn steps_beyond(count: u32) -> i32 {
    COUNTS.partition_point(|&other| other <= count) as i32
}

/// By steps, up to a quarter of what 32 bits can count.
const COUNTS: [u32; 112] = counts();

const fn counts() -> [u32; 112] {
    // Steps at which counts begin to grow more finely.
    let fine = (STEPS as u32 * (DOUBLING / PILOT).ilog2()) as usize;
    let mut counts = [0; 112];
    let mut steps = 0;
    while steps < counts.len() {
        counts[steps] = if steps < fine {
            PILOT << ((steps + 2) / 4)
        } else {
            (DOUBLING / 4 * (4 + (steps - fine) as u32 % 4)) << ((steps - fine) / 4)
        };
        steps += 1;
    }
    counts
}
