//! The thread that owns the device: it picks whose turn it is, traces one slice, and looks around again.

use super::finish::{self, Ended};
use super::job::Job;
use super::memory::{Budget, Claim};
use super::problem::{Code, Problem};
use super::progress::{Progress, seconds};
use super::share::{self, Pace};
use super::table::Table;
use crate::film::Film;
use crate::params::{ImageFormat, Mode};
use crate::render::forecast::Forecast;
use crate::render::prepare::Prepared;
use crate::render::report::Stages;
use crate::render::{Engine, Render, RenderError, StopReason, Work};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Makes an engine, on the thread that will own it; again after the device was lost.
pub type EngineFactory = Box<dyn Fn() -> Result<Box<dyn Engine>, RenderError> + Send>;

/// Shortest time between two previews, and between two progress events, of one job.
const PREVIEW_PERIOD: Duration = Duration::from_millis(500);

/// Part of the time that previews may take: 1 in 10.
const PREVIEW_SHARE: u32 = 10;

/// How often one job may meet a lost device.
const LOSSES: u32 = 3;

/// A compiled job that waits for a place.
pub(super) struct Ready {
    pub job: Arc<Job>,
    pub prepared: Prepared,
    pub stages: Stages,
    /// Since when it could have had a place.
    pub since: Instant,
    /// Host memory that it needs.
    pub bytes: u64,
}

/// A render under way.
struct Active {
    ready: Ready,
    render: Box<dyn Render>,
    claim: Claim,
    expected: Duration,
    forecast: Forecast,
    started: Instant,
    last_slice: Instant,
    attained: Duration,
    next_news: Instant,
    /// Whether a preview is being encoded.
    drawing: Arc<AtomicBool>,
    losses: u32,
}

/// What the worker shares with the rest of the service.
pub(super) struct Shared {
    pub table: Arc<Table>,
    pub budget: Budget,
    pub places: usize,
    pub render_time: Duration,
    pub runtime: tokio::runtime::Handle,
}

pub(super) struct Worker {
    shared: Arc<Shared>,
    factory: EngineFactory,
    engine: Option<Box<dyn Engine>>,
    waiting: Vec<Ready>,
    active: Vec<Active>,
    pace: Pace,
}

impl Worker {
    /// A worker with its first engine.
    pub fn new(shared: Arc<Shared>, factory: EngineFactory) -> Result<Self, RenderError> {
        let engine = Some(factory()?);
        Ok(Self { shared, factory, engine, waiting: Vec::new(), active: Vec::new(), pace: Pace::default() })
    }

    /// Works until the other end of `inbox` is gone.
    pub fn run(mut self, inbox: &Receiver<Ready>) {
        while self.receive(inbox) {
            self.drop_what_is_over();
            self.admit();
            if let Some(turn) = self.whose_turn() {
                self.slice(turn);
            }
        }
    }

    /// Takes what has arrived; waits if there is nothing to do. False: the service is gone.
    fn receive(&mut self, inbox: &Receiver<Ready>) -> bool {
        if self.active.is_empty() {
            // Waiting jobs may wait for memory that ending ones still hold: look again soon.
            let patience = if self.waiting.is_empty() { Duration::from_secs(3600) } else { Duration::from_millis(5) };
            match inbox.recv_timeout(patience) {
                Ok(ready) => self.waiting.push(ready),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return false,
            }
        }
        self.waiting.extend(inbox.try_iter());
        true
    }

    fn drop_what_is_over(&mut self) {
        self.waiting.retain(|ready| !ready.job.is_over());
        let (over, active) =
            std::mem::take(&mut self.active).into_iter().partition(|active| active.ready.job.is_over());
        self.active = active;
        Vec::into_iter(over).for_each(discard);
    }

    /// Gives places to waiting jobs, in order of rank.
    fn admit(&mut self) {
        while let Some(next) = self.next_in_line() {
            let bytes = self.waiting[next].bytes;
            let Some(claim) = self.shared.budget.claim(bytes) else { return };
            let ready = self.waiting.swap_remove(next);
            self.begin(ready, claim);
        }
    }

    fn next_in_line(&self) -> Option<usize> {
        let only_short = self.active.len() >= self.shared.places;
        if self.active.len() > self.shared.places {
            return None;
        }
        let rank = |ready: &Ready| {
            share::queue_rank(
                self.expect(&ready.prepared.work),
                ready.since.elapsed(),
                share::weight(ready.job.priority),
            )
        };
        let candidates = self.waiting.iter().enumerate();
        candidates
            .filter(|(_, ready)| !only_short || self.expect(&ready.prepared.work) <= share::SHORT)
            .min_by(|(_, a), (_, b)| rank(a).total_cmp(&rank(b)))
            .map(|(index, _)| index)
    }

    fn expect(&self, work: &Work) -> Duration {
        self.pace.expect(pixel_samples(work, work.settings.max_samples), work.settings.deadline)
    }

    fn begin(&mut self, ready: Ready, claim: Claim) {
        let expected = self.expect(&ready.prepared.work);
        let now = Instant::now();
        let mut ready = ready;
        ready.stages.queue = (seconds(ready.job.accepted.elapsed()) - ready.stages.compile).max(0.0);
        match self.engine_begin(&ready.prepared.work, None) {
            Ok(render) => {
                ready.stages.device_upload = seconds(now.elapsed());
                if ready.job.start(&render.device().name) {
                    let started = Instant::now();
                    let forecast = Forecast::new(ready.prepared.work.settings);
                    self.active.push(Active {
                        forecast,
                        ready,
                        render,
                        claim,
                        expected,
                        started,
                        last_slice: started,
                        attained: Duration::ZERO,
                        next_news: started,
                        drawing: Arc::default(),
                        losses: 0,
                    });
                }
            }
            Err(Fault::Render(RenderError::DeviceLost(detail))) => {
                self.fail(&ready.job, Problem::new(Code::DeviceUnavailable, detail));
                self.recover();
            }
            Err(fault) => self.fail(&ready.job, fault.into()),
        }
    }

    fn engine_begin(&mut self, work: &Work, film: Option<Film>) -> Result<Box<dyn Render>, Fault> {
        let engine = match &mut self.engine {
            Some(engine) => engine,
            missing => missing.insert((self.factory)().map_err(Fault::Render)?),
        };
        let begun = guarded(|| engine.begin(work.clone(), film));
        if let Err(Fault::Render(RenderError::DeviceLost(_))) = begun {
            self.engine = None;
        }
        begun
    }

    fn whose_turn(&self) -> Option<usize> {
        let rank = |active: &Active| {
            let weight = share::weight(active.ready.job.priority);
            share::slice_rank(active.attained, active.last_slice.elapsed(), weight)
        };
        let ranked = self.active.iter().enumerate().map(|(index, active)| (index, rank(active)));
        ranked.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
    }

    fn slice(&mut self, turn: usize) {
        let active = &mut self.active[turn];
        let begun = Instant::now();
        let stepped = guarded(|| active.render.step());
        active.last_slice = Instant::now();
        active.attained += active.last_slice - begun;
        match stepped {
            Ok(None) if active.is_late(self.shared.render_time) => self.end(turn, StopReason::Deadline),
            Ok(None) => active.tell(&self.shared.runtime),
            Ok(Some(reason)) => self.end(turn, reason),
            Err(Fault::Render(RenderError::DeviceLost(_))) => self.recover(),
            Err(fault) => {
                let active = self.active.swap_remove(turn);
                self.fail(&active.ready.job, fault.into());
                discard(active);
            }
        }
    }

    /// Hands the film over to be made into a file, elsewhere.
    fn end(&mut self, turn: usize, reason: StopReason) {
        let active = self.active.swap_remove(turn);
        let Active { ready, render, claim, attained, started, .. } = active;
        let samples = render.film().samples();
        if ready.prepared.work.settings.mode != Mode::Preview {
            self.pace.learn(pixel_samples(&ready.prepared.work, samples), attained);
        }
        let (non_finite, device) = (render.non_finite(), render.device().clone());
        let Ok(film) = guarded(|| Ok(render.into_film())) else {
            return self.fail(&ready.job, Fault::Panic.into());
        };
        let mut stages = ready.stages;
        stages.trace = seconds(attained);
        let cut = reason == StopReason::Deadline && started.elapsed() >= self.shared.render_time;
        let ended = Ended {
            job: ready.job,
            prepared: ready.prepared,
            film,
            reason,
            device,
            stages,
            non_finite,
            cut_by_server: cut,
            claim,
        };
        let table = Arc::clone(&self.shared.table);
        self.shared.runtime.spawn_blocking(move || finish::finish(ended, &table));
    }

    /// The device is lost, and with it every render: makes a new one and goes on from the films.
    fn recover(&mut self) {
        self.engine = None;
        for mut active in std::mem::take(&mut self.active) {
            active.losses += 1;
            let Ok(film) = guarded(|| Ok(active.render.into_film())) else {
                self.fail(&active.ready.job, Fault::Panic.into());
                continue;
            };
            let again = if active.losses > LOSSES {
                Err(Fault::Render(RenderError::DeviceLost(format!("lost {LOSSES} times during this job"))))
            } else {
                self.engine_begin(&active.ready.prepared.work, Some(film))
            };
            match again {
                Ok(render) => self.active.push(Active { render, ..active }),
                Err(fault) => self.fail(&active.ready.job, fault.into()),
            }
        }
    }

    fn fail(&self, job: &Job, problem: Problem) {
        if job.fail(problem) {
            self.shared.table.retire(job);
        }
    }
}

impl Active {
    /// Whether the wall time that the request or the server allows is over. A render with no sample yet goes on.
    fn is_late(&self, render_time: Duration) -> bool {
        let allowed =
            self.ready.prepared.work.settings.deadline.map_or(render_time, |deadline| deadline.min(render_time));
        self.started.elapsed() >= allowed && self.render.film().samples() > 0
    }

    /// Tells those who listen how far the render is, and shows it to those who look.
    fn tell(&mut self, runtime: &tokio::runtime::Handle) {
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
                let mut params = job.params.clone();
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

/// Why a render could not go on.
enum Fault {
    Render(RenderError),
    Panic,
}

impl From<Fault> for Problem {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Render(error @ RenderError::TooLarge(_)) => Self::new(Code::RenderTooLarge, error.to_string()),
            Fault::Render(error) => Self::new(Code::DeviceUnavailable, error.to_string()).retry_after(10),
            Fault::Panic => Self::new(Code::Internal, "the render failed by a fault of the server; other jobs go on"),
        }
    }
}

/// Runs a part of an engine so that its panic ends one job only.
fn guarded<T>(part: impl FnOnce() -> Result<T, RenderError>) -> Result<T, Fault> {
    catch_unwind(AssertUnwindSafe(part)).map_err(|_| Fault::Panic)?.map_err(Fault::Render)
}

/// Drops a render that nobody wants, which may itself panic after it has failed.
fn discard(active: Active) {
    let _ = guarded(|| {
        drop(active);
        Ok(())
    });
}

fn pixel_samples(work: &Work, samples: u32) -> f64 {
    f64::from(work.view.width) * f64::from(work.view.height) * f64::from(samples)
}
