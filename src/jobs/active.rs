//! A render under way: what it tells, shows and saves of itself between its slices.

use super::finish;
use super::memory::Claim;
use super::progress::{Progress, seconds};
use super::saved::{self, Origin};
use super::worker::{Ready, Shared};
use crate::params::{ImageFormat, Mode};
use crate::render::forecast::Forecast;
use crate::render::{NonFinite, Render};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tracing::Span;

/// Shortest time between two previews, and between two progress events, of one job.
const PREVIEW_PERIOD: Duration = Duration::from_millis(500);

/// Part of the time that previews may take: 1 in 10.
const PREVIEW_SHARE: u32 = 10;

/// Part of the time that saving unfinished films may take: 1 in 20.
const SAVING_SHARE: u32 = 20;

/// Time between two looks at a render that is not ready, while others are.
const REST: Duration = Duration::from_millis(20);

/// A render under way.
pub(super) struct Active {
    pub ready: Ready,
    pub render: Box<dyn Render>,
    pub claim: Claim,
    pub expected: Duration,
    pub forecast: Forecast,
    pub started: Instant,
    pub last_slice: Instant,
    pub attained: Duration,
    pub next_news: Instant,
    /// Whether a preview is being encoded.
    pub drawing: Arc<AtomicBool>,
    pub losses: u32,
    /// Ends with the render.
    _span: Span,
    /// Of the film that was saved last, or that the render began with.
    pub saved_samples: u64,
    pub next_save: Instant,
    /// Milliseconds that the last saving took; [`SAVING`] while one is under way.
    pub saving: Arc<AtomicU64>,
}

/// A film is being saved.
const SAVING: u64 = u64::MAX;

/// What went into a render before this process, or this device, began it.
#[derive(Default)]
pub(super) struct Before {
    pub attained: Duration,
    pub spent: Duration,
}

impl Active {
    /// Begun just now, or gone on with.
    pub fn new(
        ready: Ready,
        render: Box<dyn Render>,
        claim: Claim,
        expected: Duration,
        before: &Before,
        shared: &Shared,
    ) -> Self {
        let now = Instant::now();
        Self {
            forecast: Forecast::new(ready.prepared.work.settings),
            saved_samples: render.film().pixel_samples(),
            _span: tracing::info_span!(parent: &ready.job.span(), "trace", device = render.device().name),
            ready,
            render,
            claim,
            expected,
            // As if this process had traced all along: the limits on time hold.
            started: now.checked_sub(before.spent).unwrap_or(now),
            last_slice: now,
            attained: before.attained,
            next_news: now,
            drawing: Arc::default(),
            losses: 0,
            next_save: now + shared.save_period.unwrap_or_default(),
            saving: Arc::default(),
        }
    }

    /// Whether the film is small enough to be saved.
    pub fn fits(&self, limit: u64) -> bool {
        saved::bytes(self.render.film()) <= limit
    }

    /// The film as it is stored; none if it has nothing new, or samples had to be dropped: it does not say how many.
    pub fn to_save(&self) -> Option<bytes::Bytes> {
        let film = self.render.film();
        // A preview is made anew sooner than it is read back.
        let is_preview = self.ready.prepared.work.settings.mode == Mode::Preview;
        if is_preview || film.pixel_samples() <= self.saved_samples || self.render.non_finite() != NonFinite::default()
        {
            return None;
        }
        saved::to_bytes(film, Origin::of(self.render.device()), self.attained, self.started.elapsed()).ok()
    }

    /// Saves the film now and then.
    pub fn save_if_due(&mut self, shared: &Arc<Shared>) {
        let Some(period) = shared.save_period else { return };
        let took = self.saving.load(Ordering::Acquire);
        if took == SAVING || Instant::now() < self.next_save || !self.fits(shared.save_bytes) {
            return;
        }
        let Some(bytes) = self.to_save() else { return };
        self.saved_samples = self.render.film().pixel_samples();
        self.saving.store(SAVING, Ordering::Release);
        self.next_save = Instant::now() + period.max(Duration::from_millis(took) * SAVING_SHARE);
        let (shared, saving, job) = (Arc::clone(shared), Arc::clone(&self.saving), Arc::clone(&self.ready.job));
        let runtime = shared.runtime.clone();
        runtime.spawn(async move {
            let begun = Instant::now();
            if shared.storage.save_film(job.spec.number, bytes).await.is_ok() {
                shared.meters.saved.inc();
                shared.tidy.notify_one();
            }
            saving.store(begun.elapsed().as_millis() as u64, Ordering::Release);
        });
    }

    /// Whether others come first: until it is ready it looks around now and then.
    pub fn rests(&self) -> bool {
        !self.render.is_ready() && self.last_slice.elapsed() < REST
    }

    /// Counts a slice that has just ended. Until the render is ready its time is that of the upload, and does not count against
    /// what the request allows.
    pub fn count(&mut self, begun: Instant, was_ready: bool) {
        let now = Instant::now();
        if was_ready {
            self.attained += now - begun;
        } else {
            let since = now - self.last_slice;
            self.ready.stages.device_upload += seconds(since);
            self.started += since;
        }
        self.last_slice = now;
    }

    /// Whether the wall time that the request or the server allows is over. A render with no sample yet goes on.
    pub fn is_late(&self, render_time: Duration) -> bool {
        let allowed =
            self.ready.prepared.work.settings.deadline.map_or(render_time, |deadline| deadline.min(render_time));
        self.started.elapsed() >= allowed && self.render.film().samples() > 0
    }

    /// Tells those who listen how far the render is, and shows it to those who look.
    pub fn tell(&mut self, runtime: &tokio::runtime::Handle) {
        let begun = Instant::now();
        if begun < self.next_news {
            return;
        }
        let job = &self.ready.job;
        let film = self.render.film();
        let fraction = self.render.progress().clamp(0.0, 1.0);
        let samples = film.samples();
        let error = film.error();
        if let Some(error) = error {
            self.forecast.look(fraction, error.upper_bound_95);
        }
        let left = self.forecast.left(fraction, self.started.elapsed()).unwrap_or(self.expected);
        job.advance(Progress {
            fraction,
            samples,
            error: error.map(|error| error.relative_rms),
            error_bound_95: error.map(|error| error.upper_bound_95),
            eta_seconds: Some(seconds(left)),
        });
        if samples > 0 && job.wants_preview() && !self.drawing.swap(true, Ordering::AcqRel) {
            let picture = film.picture();
            let (job, drawing) = (Arc::clone(job), Arc::clone(&self.drawing));
            runtime.spawn_blocking(move || {
                let mut params = job.spec.params.clone();
                params.output.bits = 8;
                let format = if params.output.transparent { ImageFormat::Png } else { ImageFormat::Jpeg };
                if let Ok(file) = finish::encode(&picture, &params, format, &[]) {
                    job.show(file, samples);
                }
                drawing.store(false, Ordering::Release);
            });
        }
        // A first picture soon, then fewer; and never so many that they slow the render down.
        let period = if samples > 0 { PREVIEW_PERIOD } else { Duration::from_millis(50) };
        self.next_news = begun + period.max(begun.elapsed() * PREVIEW_SHARE);
    }
}
