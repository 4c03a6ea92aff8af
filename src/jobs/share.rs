//! Who gets the device next: pure arithmetic, so that fairness can be tested without a device.

use std::time::Duration;

/// A job expected to need the device no longer than this may use the place kept for short ones.
pub const SHORT: Duration = Duration::from_secs(5);

/// A render under way gets a slice at least this often, even if smaller ones keep coming.
const PATIENCE: Duration = Duration::from_secs(1);

/// Share of a job, relative to one of priority 0: doubles every 25 steps.
pub fn weight(priority: i32) -> f64 {
    (f64::from(priority) / 25.0).exp2()
}

/// Part of a client's share that each of its renders under way gets: clients are served evenly, however many jobs each has.
pub fn part(renders_of_client: usize) -> f64 {
    1.0 / renders_of_client.max(1) as f64
}

/// Rank of a render under way; the lowest gets the next slice. Least attained service first (what has had
/// little of the device is likely to end soon), but before all who has waited too long.
pub fn slice_rank(attained: Duration, since_last_slice: Duration, weight: f64) -> f64 {
    if since_last_slice > PATIENCE { -since_last_slice.as_secs_f64() } else { attained.as_secs_f64() / weight }
}

/// Rank of a job that waits for a place; the lowest comes first. Shortest expected time first, less what it waited.
pub fn queue_rank(expected: Duration, waited: Duration, weight: f64) -> f64 {
    expected.as_secs_f64() / weight - waited.as_secs_f64()
}

/// Guess of the device time that a job needs.
#[derive(Debug, Clone, Copy)]
pub struct Pace {
    /// Pixel samples per second, of late.
    rate: f64,
}

impl Default for Pace {
    /// What a software rasteriser does; the first slices correct it.
    fn default() -> Self {
        Self { rate: 1e6 }
    }
}

impl Pace {
    /// Learns from a render that ended.
    pub fn learn(&mut self, pixel_samples: f64, time: Duration) {
        if time > Duration::ZERO && pixel_samples > 0.0 {
            self.rate += 0.25 * (pixel_samples / time.as_secs_f64() - self.rate);
        }
    }

    /// Device time of so many samples, at most `deadline`.
    pub fn expect(&self, pixel_samples: f64, deadline: Option<Duration>) -> Duration {
        let guess = Duration::try_from_secs_f64(pixel_samples / self.rate).unwrap_or(Duration::MAX);
        deadline.map_or(guess, |deadline| guess.min(deadline))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLICE: Duration = Duration::from_millis(50);

    /// Slices that each of the jobs (attained so far, weight) gets out of `count`.
    fn deal(jobs: &[(Duration, f64)], count: u32) -> Vec<u32> {
        let mut state: Vec<_> = jobs.iter().map(|&(attained, weight)| (attained, Duration::ZERO, weight, 0)).collect();
        for now in (0..count).map(|n| SLICE * n) {
            let rank = |j: &(Duration, Duration, f64, u32)| slice_rank(j.0, now - j.1, j.2);
            let next = state.iter_mut().min_by(|a, b| rank(a).total_cmp(&rank(b))).unwrap();
            next.0 += SLICE;
            next.1 = now + SLICE;
            next.3 += 1;
        }
        state.iter().map(|job| job.3).collect()
    }

    #[test]
    fn equals_share_equally() {
        let slices = deal(&[(Duration::ZERO, 1.0), (Duration::ZERO, 1.0)], 100);
        assert!(slices[0].abs_diff(slices[1]) <= 1, "{slices:?}");
    }

    #[test]
    fn a_newcomer_overtakes_a_long_render_that_still_advances() {
        let slices = deal(&[(Duration::from_secs(60), 1.0), (Duration::ZERO, 1.0)], 200);
        assert!((5..20).contains(&slices[0]), "{slices:?}");
    }

    #[test]
    fn fifty_steps_of_priority_are_four_times_the_share() {
        let slices = deal(&[(Duration::ZERO, weight(0)), (Duration::ZERO, weight(50))], 500);
        let ratio = f64::from(slices[1]) / f64::from(slices[0]);
        assert!((3.5..4.5).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_client_with_three_renders_gets_as_much_as_a_client_with_one() {
        let many = (Duration::ZERO, weight(0) * part(3));
        let slices = deal(&[(Duration::ZERO, weight(0) * part(1)), many, many, many], 600);
        let others = slices[1] + slices[2] + slices[3];
        assert!(slices[0].abs_diff(others) < 30, "{slices:?}");
    }

    #[test]
    fn a_short_job_comes_first_until_a_long_one_has_waited() {
        let (short, long) = (Duration::from_secs(1), Duration::from_secs(60));
        assert!(queue_rank(short, Duration::ZERO, 1.0) < queue_rank(long, Duration::from_secs(10), 1.0));
        assert!(queue_rank(short, Duration::ZERO, 1.0) > queue_rank(long, Duration::from_secs(61), 1.0));
    }

    #[test]
    fn the_pace_follows_what_is_seen() {
        let mut pace = Pace::default();
        for _ in 0..50 {
            pace.learn(1e8, Duration::from_secs(1));
        }
        let expected = pace.expect(2e8, None).as_secs_f64();
        assert!((1.9..2.1).contains(&expected), "{expected}");
        assert_eq!(pace.expect(1e12, Some(Duration::from_secs(3))), Duration::from_secs(3));
    }
}
