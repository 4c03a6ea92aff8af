//! How much to trace at a time.

use crate::film::{TILE_PIXELS, TileSamples};
use std::time::Duration;

/// What a slice should take: short enough that another job, a cancel or a watchdog need not wait.
const TARGET: Duration = Duration::from_millis(35);
/// Paths of the first slice, before anything has been measured: no more than what is done soon where each ray takes a millisecond.
const FIRST: f64 = 256.0;
/// Fewest paths of a slice that is done within [`SLOW`]: on a busy machine each slice waits for a core, and if that alone took the
/// target time, slices would shrink to one tile and the waits would be all there is.
const LEAST: f64 = 4096.0;
/// No waiting for a core takes so long: the paths themselves are slow.
const SLOW: Duration = Duration::from_millis(500);

/// Most entries of a slice, each a workgroup of a dispatch: WebGPU's least limit in one dimension.
const MOST_ENTRIES: usize = 65535;

/// Paths of the next slice, by the speed seen so far.
#[derive(Debug, Clone, Copy)]
pub struct SlicePaths(f64);

impl Default for SlicePaths {
    fn default() -> Self {
        Self(FIRST)
    }
}

impl SlicePaths {
    /// How many of the entries of a pass the next slice should take, at least one, and how many paths they are.
    pub fn take(self, entries: &[TileSamples]) -> (u32, f64) {
        let (mut count, mut paths) = (0, 0.0);
        for entry in entries.iter().take(MOST_ENTRIES) {
            let more = TILE_PIXELS as f64 * f64::from(entry.samples);
            if count > 0 && paths + more > self.0 {
                break;
            }
            count += 1;
            paths += more;
        }
        (count, paths)
    }

    /// From a slice that took so long: towards the target time, at most four times more or less at once.
    pub fn learn(&mut self, paths: f64, elapsed: Duration) {
        let rate = paths / elapsed.as_secs_f64().max(1e-6);
        let least = LEAST.min(rate * SLOW.as_secs_f64());
        self.0 = (rate * TARGET.as_secs_f64()).clamp(self.0 / 4.0, self.0 * 4.0).max(least);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_shrink_where_paths_are_slow_and_not_where_a_core_is_busy() {
        let mut paths = SlicePaths::default();
        paths.learn(256.0, Duration::from_secs(1));
        assert_eq!(paths.0, 128.0, "so many as take half a second, which is more than a quarter of those before");
        let mut paths = SlicePaths(LEAST);
        paths.learn(LEAST, Duration::from_millis(100));
        assert_eq!(paths.0, LEAST);
        paths.learn(LEAST, Duration::from_millis(1));
        assert_eq!(paths.0, 4.0 * LEAST, "at most four times more at once");
    }
}
