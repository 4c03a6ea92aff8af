//! How much to trace at a time.

use std::time::Duration;

/// What a slice should take: short enough that another job, a cancel or a watchdog need not wait.
const TARGET: Duration = Duration::from_millis(35);
/// Paths of the first slice, before anything has been measured.
const FIRST: f64 = 16384.0;
/// Fewest paths of a slice: on a busy machine each slice waits for a core, and if that alone took the target time,
/// slices would shrink to one tile and the waits would be all there is.
const LEAST: f64 = 4096.0;

/// Paths of the next slice, by the speed seen so far.
#[derive(Debug, Clone, Copy)]
pub struct SlicePaths(f64);

impl Default for SlicePaths {
    fn default() -> Self {
        Self(FIRST)
    }
}

impl SlicePaths {
    /// Tiles of the next slice; at least one.
    pub fn tiles(self, paths_per_tile: f64) -> u32 {
        (self.0 / paths_per_tile).max(1.0) as u32
    }

    /// From a slice that took so long: towards the target time, at most four times more or less at once.
    pub fn learn(&mut self, paths: f64, elapsed: Duration) {
        let rate = paths / elapsed.as_secs_f64().max(1e-6);
        self.0 = (rate * TARGET.as_secs_f64()).clamp(self.0 / 4.0, self.0 * 4.0).max(LEAST);
    }
}
