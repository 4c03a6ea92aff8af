//! The thread that owns the device: it picks whose turn it is, traces one slice, and looks around again.

use super::active::{Active, Before};
use super::finish::{self, Ended};
use super::job::Job;
use super::memory::{Budget, Claim};
use super::meters::Meters;
use super::problem::{Code, Problem};
use super::progress::seconds;
use super::saved::{Origin, SavedFilm};
use super::share::{self, Pace};
use super::storage::Storage;
use super::table::Table;
use crate::denoise::Denoiser;
use crate::film::Film;
use crate::params::Mode;
use crate::render::prepare::Prepared;
use crate::render::report::Stages;
use crate::render::{Engine, Render, RenderError, StopReason, Work};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use tokio::sync::{Notify, oneshot, watch};

/// Makes an engine, on the thread that will own it; again after the device was lost.
pub type EngineFactory = Box<dyn Fn() -> Result<Box<dyn Engine>, RenderError> + Send>;

/// How often the device may be lost while it is one job's turn, and that job be tried again: the second time the job is taken for
/// the cause. A loss may be its driver's or an operator's; a scene that costs each engine that it meets keeps all others waiting.
const LOSSES: u32 = 1;

/// What the worker is told.
pub(super) enum Message {
    /// A job is compiled.
    Ready(Box<Ready>),
    /// The server ends: save what has been made, answer, and do no more.
    Suspend(oneshot::Sender<()>),
}

/// A compiled job that waits for a place.
pub(super) struct Ready {
    pub job: Arc<Job>,
    pub prepared: Prepared,
    /// What an earlier process had made of it.
    pub saved: Option<SavedFilm>,
    pub stages: Stages,
    /// Since when it could have had a place.
    pub since: Instant,
    /// Host memory that it needs.
    pub bytes: u64,
}

/// What the worker shares with the rest of the service.
pub(super) struct Shared {
    pub table: Arc<Table>,
    pub budget: Budget,
    pub meters: Arc<Meters>,
    pub places: usize,
    pub render_time: Duration,
    /// Time between two savings of an unfinished film; none: films are not saved.
    pub save_period: Option<Duration>,
    /// Films above so many bytes are not saved.
    pub save_bytes: u64,
    pub storage: Arc<Storage>,
    pub denoiser: Arc<OnceLock<Denoiser>>,
    /// To be told when jobs are over, so that old ones leave.
    pub tidy: Arc<Notify>,
    pub runtime: tokio::runtime::Handle,
    /// Becomes true when the service is over.
    pub closed: watch::Receiver<bool>,
}

pub(super) struct Worker {
    shared: Arc<Shared>,
    factory: EngineFactory,
    engine: Option<Box<dyn Engine>>,
    waiting: Vec<Ready>,
    active: Vec<Active>,
    pace: Pace,
    suspended: bool,
}

impl Worker {
    /// A worker with its first engine.
    pub fn new(shared: Arc<Shared>, factory: EngineFactory) -> Result<Self, RenderError> {
        let engine = Some(factory()?);
        Ok(Self {
            shared,
            factory,
            engine,
            waiting: Vec::new(),
            active: Vec::new(),
            pace: Pace::default(),
            suspended: false,
        })
    }

    /// Works until the other end of `inbox` is gone.
    pub fn run(mut self, inbox: &Receiver<Message>) {
        while self.receive(inbox) {
            self.drop_what_is_over();
            self.admit();
            if let Some(turn) = self.whose_turn() {
                self.slice(turn);
            }
        }
    }

    /// Takes what has arrived; waits if there is nothing to do. False: the service is gone.
    fn receive(&mut self, inbox: &Receiver<Message>) -> bool {
        if self.active.is_empty() {
            // Waiting jobs may wait for memory that ending ones still hold: look again soon.
            let patience = if self.waiting.is_empty() { Duration::from_secs(3600) } else { Duration::from_millis(5) };
            match inbox.recv_timeout(patience) {
                Ok(message) => self.take(message),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return false,
            }
        }
        inbox.try_iter().for_each(|message| self.take(message));
        true
    }

    fn take(&mut self, message: Message) {
        match message {
            Message::Ready(ready) if !self.suspended => self.waiting.push(*ready),
            Message::Ready(_) => {}
            Message::Suspend(done) => {
                self.suspend();
                let _ = done.send(());
            }
        }
    }

    /// Saves the films of all renders under way and lets go of them: another process will go on.
    fn suspend(&mut self) {
        self.suspended = true;
        self.waiting.clear();
        for active in std::mem::take(&mut self.active) {
            let is_saved = self.shared.save_period.is_some() && active.fits(self.shared.save_bytes);
            if let Some(film) = active.to_save().filter(|_| is_saved) {
                let saved = self.shared.storage.save_film(active.ready.job.spec.number, film);
                // Without its film the job begins anew, to the same picture.
                let _ = self.shared.runtime.block_on(saved);
            }
            discard(active);
        }
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
        // The client with the fewest renders under way comes first.
        let rank = |ready: &Ready| {
            let (expected, waited) = (self.expect(&ready.prepared.work), ready.since.elapsed());
            let weight = share::weight(ready.job.spec.priority);
            (self.renders_of(&ready.job.spec.client), share::queue_rank(expected, waited, weight))
        };
        let candidates = self.waiting.iter().enumerate();
        candidates
            .filter(|(_, ready)| !only_short || self.expect(&ready.prepared.work) <= share::SHORT)
            .map(|(index, ready)| (index, rank(ready)))
            .min_by(|(_, a), (_, b)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))
            .map(|(index, _)| index)
    }

    fn renders_of(&self, client: &str) -> usize {
        self.active.iter().filter(|active| active.ready.job.spec.client == client).count()
    }

    fn expect(&self, work: &Work) -> Duration {
        self.pace.expect(pixel_samples(work, work.settings.max_samples), work.settings.deadline)
    }

    fn begin(&mut self, mut ready: Ready, claim: Claim) {
        let expected = self.expect(&ready.prepared.work);
        let now = Instant::now();
        ready.stages.queue = (seconds(ready.job.accepted.elapsed()) - ready.stages.compile).max(0.0);
        let saved = ready.saved.take();
        let mut begun = self.go_on(&ready.prepared.work, saved);
        if let Err(Fault::Render(RenderError::DeviceLost(_))) = begun {
            // It may have been lost since it was used last.
            self.recover(None);
            begun = self.go_on(&ready.prepared.work, None);
        }
        match begun {
            Ok((render, before)) => {
                ready.stages.device_upload = seconds(now.elapsed());
                if ready.job.start(&render.device().name) {
                    self.active.push(Active::new(ready, render, claim, expected, &before, &self.shared));
                }
            }
            Err(Fault::Render(RenderError::DeviceLost(why))) => {
                self.fail(&ready.job, too_costly(&why));
                self.recover(None);
            }
            Err(fault) => self.fail(&ready.job, fault.into()),
        }
    }

    /// Begins a render with what was saved of it, if that is of this device and version.
    fn go_on(&mut self, work: &Work, saved: Option<SavedFilm>) -> Result<(Box<dyn Render>, Before), Fault> {
        let Some(saved) = saved else { return Ok((self.engine_begin(work, None)?, Before::default())) };
        let (width, height) = (work.view.width, work.view.height);
        let SavedFilm { film, origin, attained, spent } = saved;
        if (film.width(), film.height()) == (width, height) {
            let left = work.settings.deadline.map(|deadline| deadline.saturating_sub(attained));
            let mut rest = work.clone();
            rest.settings.deadline = left;
            let render = self.engine_begin(&rest, Some(film))?;
            if Origin::of(render.device()) == origin {
                return Ok((render, Before { attained, spent }));
            }
            let _ = guarded(|| {
                drop(render);
                Ok(())
            });
        }
        Ok((self.engine_begin(work, None)?, Before::default()))
    }

    fn engine_begin(&mut self, work: &Work, film: Option<Film>) -> Result<Box<dyn Render>, Fault> {
        let engine = match &mut self.engine {
            Some(engine) => engine,
            missing => missing.insert((self.factory)().map_err(Fault::NoEngine)?),
        };
        let begun = guarded(|| engine.begin(work.clone(), film));
        if let Err(Fault::Render(RenderError::DeviceLost(_))) = begun {
            self.engine = None;
        }
        begun
    }

    fn whose_turn(&self) -> Option<usize> {
        let rank = |active: &Active| {
            let spec = &active.ready.job.spec;
            let weight = share::weight(spec.priority) * share::part(self.renders_of(&spec.client));
            share::slice_rank(active.attained, active.last_slice.elapsed(), weight)
        };
        let ranked = self.active.iter().enumerate().map(|(index, active)| (index, (active.rests(), rank(active))));
        ranked.min_by(|(_, a), (_, b)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))).map(|(index, _)| index)
    }

    fn slice(&mut self, turn: usize) {
        let active = &mut self.active[turn];
        let (begun, was_ready) = (Instant::now(), active.render.is_ready());
        let stepped = guarded(|| active.render.step());
        active.count(begun, was_ready);
        match stepped {
            Ok(None) if active.is_late(self.shared.render_time) => self.end(turn, StopReason::Deadline),
            Ok(None) => {
                active.tell(&self.shared.runtime);
                active.save_if_due(&self.shared);
            }
            Ok(Some(reason)) => self.end(turn, reason),
            Err(Fault::Render(RenderError::DeviceLost(why))) => self.recover(Some((turn, &why))),
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
        let Active { ready, mut render, claim, attained, started, .. } = active;
        let samples = render.film().samples();
        if ready.prepared.work.settings.mode != Mode::Preview {
            self.pace.learn(pixel_samples(&ready.prepared.work, samples), attained);
        }
        let (non_finite, device, guides) = (render.non_finite(), render.device().clone(), render.take_guides());
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
            guides,
            reason,
            device,
            stages,
            non_finite,
            cut_by_server: cut,
            claim,
        };
        let shared = Arc::clone(&self.shared);
        self.shared.runtime.spawn_blocking(move || finish::finish(ended, &shared));
    }

    /// The device is lost, and with it every render: makes a new one and goes on from the films. `turn`: the render that met
    /// the loss, and how; if it does so again, it is taken for the cause.
    fn recover(&mut self, turn: Option<(usize, &str)>) {
        self.engine = None;
        self.shared.meters.lost.inc();
        for (place, mut active) in std::mem::take(&mut self.active).into_iter().enumerate() {
            let met = turn.filter(|(turn, _)| *turn == place).map(|(_, why)| why);
            active.losses += u32::from(met.is_some());
            let Ok(film) = guarded(|| Ok(active.render.into_film())) else {
                self.fail(&active.ready.job, Fault::Panic.into());
                continue;
            };
            if let Some(why) = met.filter(|_| active.losses > LOSSES) {
                self.fail(&active.ready.job, too_costly(why));
                continue;
            }
            let again = self.engine_begin(&active.ready.prepared.work, Some(film));
            match again {
                Ok(render) => {
                    active.render = render;
                    self.active.push(active);
                }
                Err(fault) => self.fail(&active.ready.job, fault.into()),
            }
        }
    }

    fn fail(&self, job: &Job, problem: Problem) {
        if job.fail(problem) {
            self.shared.tidy.notify_one();
        }
    }
}

/// Why a render could not go on.
enum Fault {
    Render(RenderError),
    /// There is nothing to render on.
    NoEngine(RenderError),
    Panic,
}

/// What is said of a job that costs one engine after the other.
fn too_costly(why: &str) -> Problem {
    let times = LOSSES + 1;
    let detail = format!(
        "what renders was lost {times} times while it was this job's turn, the last time so: {why}. The job is taken for the cause and not \
         tried again; other jobs go on. Make the scene simpler (many triangles or spheres in one place cost most), or the picture smaller"
    );
    Problem::new(Code::RenderFailed, detail)
}

impl From<Fault> for Problem {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Render(error @ RenderError::TooLarge(_)) => Self::new(Code::RenderTooLarge, error.to_string()),
            Fault::Render(error) | Fault::NoEngine(error) => {
                Self::new(Code::DeviceUnavailable, error.to_string()).retry_after(10)
            }
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
