//! How long something takes.

use crate::film::Picture;
use crate::render::{DeviceInfo, Engine, RenderError, Work};
use std::time::Instant;

/// What is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// Seconds on the wall.
    Wall,
    /// Seconds of all processors that this process has used: what else runs on the machine hardly changes them.
    Processor,
}

impl Clock {
    /// The processors' time where a software device does the work and the system says what a process has used (Linux), else the wall's.
    pub fn of(device: &DeviceInfo) -> Self {
        if device.hardware || processor_seconds().is_none() { Self::Wall } else { Self::Processor }
    }

    /// In words, for the line above a table.
    pub fn words(self) -> &'static str {
        match self {
            Self::Wall => "wall-clock time",
            Self::Processor => "processors' time, of all cores together",
        }
    }

    /// Begins to count.
    pub fn start(self) -> Stopwatch {
        Stopwatch { clock: self, wall: Instant::now(), processor: processor_seconds().unwrap_or(0.0) }
    }
}

/// A work's picture, and the seconds from its first pass to the film on the host: uploads and pipelines are left out.
///
/// # Errors
/// A device fault.
pub fn trace(engine: &mut dyn Engine, clock: Clock, work: &Work) -> Result<(Picture, f64), RenderError> {
    let mut render = engine.begin_ready(work.clone(), None)?;
    let begun = clock.start();
    while render.step()?.is_none() {}
    let seconds = begun.seconds();
    Ok((render.film().picture(), seconds))
}

/// A clock that was started.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    clock: Clock,
    wall: Instant,
    processor: f64,
}

impl Stopwatch {
    /// Seconds since then.
    pub fn seconds(&self) -> f64 {
        match self.clock {
            Clock::Wall => self.wall.elapsed().as_secs_f64(),
            Clock::Processor => processor_seconds().map_or(f64::NAN, |now| now - self.processor),
        }
    }
}

/// Seconds that the threads of this process have run. Those that have ended do not count: engines keep theirs.
fn processor_seconds() -> Option<f64> {
    let mut nanoseconds = 0;
    for thread in std::fs::read_dir("/proc/self/task").ok()? {
        // A thread may end between the two.
        let Ok(text) = std::fs::read_to_string(thread.ok()?.path().join("schedstat")) else { continue };
        nanoseconds += text.split_whitespace().next()?.parse::<u64>().ok()?;
    }
    Some(1e-9 * nanoseconds as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_counts_and_waiting_does_not() {
        if processor_seconds().is_none() {
            eprintln!("SKIPPED: this system does not say what a process has used");
            return;
        }
        let watch = Clock::Processor.start();
        let wall = Clock::Wall.start();
        let mut sum = 0u64;
        while watch.seconds() < 0.05 && wall.seconds() < 20.0 {
            sum = (0..100_000).fold(sum, |sum, x| std::hint::black_box(sum ^ x));
        }
        assert!(watch.seconds() >= 0.05, "{} s of work, {sum}", watch.seconds());
    }
}
