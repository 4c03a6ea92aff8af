//! A small engine of known behaviour: every step adds one sample per pixel, drawn from a hash.

use candela::film::{Film, TILE_PIXELS, TileSamples};
use candela::jobs::EngineFactory;
use candela::render::{DeviceInfo, Engine, Engines, NonFinite, Render, RenderError, StopReason, Work};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Time that what a cold render needs is in the making.
pub const COLD: Duration = Duration::from_secs(2);

/// Time that one step takes.
const STEP: Duration = Duration::from_millis(2);

/// What a render of a certain seed does wrong.
#[derive(Clone, Copy, PartialEq)]
pub enum Fault {
    /// Nothing.
    None,
    /// Panics at its third step.
    Panic,
    /// Finds the device lost at its third step, as often as the counter says.
    Lost,
    /// Does not fit.
    TooLarge,
    /// Is not ready for [`COLD`].
    Cold,
}

/// Seed of the renders that go wrong, so that others on the same server go well.
pub const FAULTY_SEED: u32 = 666;

/// The engine that tests use when any will do.
pub fn any() -> EngineFactory {
    match std::env::var("CANDELA_TEST_ENGINE").as_deref() {
        Ok("test") => faulty(Fault::None, 0),
        _ => Box::new(|| Ok(Box::new(Engines::new()))),
    }
}

/// An engine on which renders of [`FAULTY_SEED`] go wrong; `losses`: how often the device is lost in all.
pub fn faulty(fault: Fault, losses: u32) -> EngineFactory {
    let (losses_at_first, losses) = (losses, Arc::new(AtomicU32::new(losses)));
    Box::new(move || {
        let info = DeviceInfo {
            engine: "gpu",
            name: "test".to_owned(),
            backend: "none".to_owned(),
            driver: "none".to_owned(),
            hardware: false,
        };
        Ok(Box::new(TestEngine { info, fault, losses: Arc::clone(&losses), losses_at_first }))
    })
}

struct TestEngine {
    info: DeviceInfo,
    fault: Fault,
    losses: Arc<AtomicU32>,
    losses_at_first: u32,
}

impl Engine for TestEngine {
    fn begin(&mut self, work: Work, film: Option<Film>) -> Result<Box<dyn Render>, RenderError> {
        let fault = if work.settings.seed == FAULTY_SEED { self.fault } else { Fault::None };
        if fault == Fault::TooLarge {
            return Err(RenderError::TooLarge("a buffer of 3 GiB".to_owned()));
        }
        // Whoever begins anew after a loss must hand on what had been made.
        let before = self.losses.load(Ordering::SeqCst);
        if fault == Fault::Lost && before < self.losses_at_first && film.is_none() {
            return Err(RenderError::TooLarge("the film is missing".to_owned()));
        }
        let film = film.unwrap_or_else(|| Film::split(work.view.width, work.view.height, &work.lighting.groups));
        let (info, losses, begun) = (self.info.clone(), Arc::clone(&self.losses), Instant::now());
        Ok(Box::new(TestRender { info, film, work, fault, losses, begun }))
    }
}

struct TestRender {
    info: DeviceInfo,
    film: Film,
    work: Work,
    fault: Fault,
    losses: Arc<AtomicU32>,
    begun: Instant,
}

impl TestRender {
    fn go_wrong(&self) -> Result<(), RenderError> {
        if self.film.samples() != 2 {
            return Ok(());
        }
        let lose = |left: u32| left.checked_sub(1);
        match self.fault {
            Fault::Panic => panic!("as the test wants it"),
            Fault::Lost if self.losses.fetch_update(Ordering::SeqCst, Ordering::SeqCst, lose).is_ok() => {
                Err(RenderError::DeviceLost("as the test wants it".to_owned()))
            }
            _ => Ok(()),
        }
    }
}

impl Render for TestRender {
    fn device(&self) -> &DeviceInfo {
        &self.info
    }

    fn is_ready(&self) -> bool {
        self.fault != Fault::Cold || self.begun.elapsed() >= COLD
    }

    fn step(&mut self) -> Result<Option<StopReason>, RenderError> {
        self.go_wrong()?;
        std::thread::sleep(STEP);
        if !self.is_ready() {
            return Ok(None);
        }
        let sample = self.film.samples();
        let draw = |x: u32, y: u32| {
            let pixel = u64::from(y) * u64::from(self.film.width()) + u64::from(x);
            let mut hash = DefaultHasher::new();
            (self.work.settings.seed, pixel, sample).hash(&mut hash);
            let value = (hash.finish() >> 40) as f32 / (1_u64 << 24) as f32;
            [value, value * 0.5, 0.25, 1.0]
        };
        let replicate = sample % candela::film::REPLICATES as u32;
        let entry =
            |tile| TileSamples { tile, replicate, first: self.film.replicate_samples(replicate, tile), samples: 1 };
        let work: Vec<_> = self.film.tiles().spread().map(entry).collect();
        let sums = self.film.tiles().lanes(&work, |_, (x, y)| draw(x, y));
        // All light is of the first group.
        let groups = self.film.groups();
        let split = sums.chunks(TILE_PIXELS).flat_map(|lanes| {
            let others = std::iter::repeat_n([0.0; 4], TILE_PIXELS * groups.saturating_sub(1));
            lanes.iter().chain(lanes.iter().take(TILE_PIXELS * groups)).copied().chain(others)
        });
        self.film.add_split(&work, &split.collect::<Vec<_>>());
        Ok((self.film.samples() >= self.work.settings.max_samples).then_some(StopReason::MaxSamples))
    }

    fn film(&self) -> &Film {
        &self.film
    }

    fn into_film(self: Box<Self>) -> Film {
        self.film
    }

    fn progress(&self) -> f64 {
        f64::from(self.film.samples()) / f64::from(self.work.settings.max_samples)
    }

    fn non_finite(&self) -> NonFinite {
        NonFinite::default()
    }
}
