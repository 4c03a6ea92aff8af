//! One job: its request, where it stands, what came of it.

use super::events::{Event, EventKind, EventLog};
use super::ledger::{Change, Ledger, LedgerError, Restored, Standing};
use super::meters::Meters;
use super::outcome::{Encoded, Outcome, Preview};
use super::problem::Problem;
use super::progress::{Progress, seconds};
use super::scenes::{StoredImage, StoredScene};
use super::state::State;
use crate::params::RenderParams;
use crate::render::report::Stages;
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tracing::Span;
use tracing::field::Empty;

/// What to render.
#[derive(Debug, Clone)]
pub struct Order {
    /// Scene.
    pub scene: Arc<StoredScene>,
    /// Picture that the environment shows, if the parameters name one.
    pub hdri: Option<Arc<StoredImage>>,
    /// Pictures that spheres and overrides name; the parameters name them by id.
    pub maps: Vec<Arc<StoredImage>>,
    /// Profiles of its lights.
    pub profiles: Vec<Arc<StoredImage>>,
    /// All else that the picture depends on.
    pub params: RenderParams,
    /// -100 to 100: a job of higher priority gets a larger share of the device.
    pub priority: i32,
    /// Seconds spent on it before it became a job.
    pub stages: Stages,
}

/// Where a job stands in a batch.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Number of the batch.
    pub batch: i64,
    /// Counts from 0.
    pub item: u32,
    /// Of its file.
    pub name: String,
}

/// What a job is, for as long as it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Spec {
    /// Counts the jobs of this ledger.
    pub number: i64,
    /// The client's, or `job-...`.
    pub id: String,
    /// The client's `Idempotency-Key`; if it has an API key, behind that one's name and a space.
    pub key: Option<String>,
    /// When it was accepted: milliseconds since 1970.
    pub created: i64,
    /// Id of the scene.
    pub scene: String,
    /// Id of the environment's picture.
    pub image: Option<String>,
    /// Parameters.
    pub params: RenderParams,
    /// -100 to 100.
    pub priority: i32,
    /// Who sent it: clients share the device evenly.
    pub client: String,
    /// Whether it ends with the request that waits for it.
    pub attended: bool,
    /// What the picture depends on, hashed.
    pub content: String,
    /// Of a job that was asked for together with others.
    pub place: Option<Place>,
    /// Address that is told of its end.
    pub webhook: Option<String>,
}

/// An event on its way to the ledger. If it never gets there, nobody is to wait for it.
struct Pending {
    id: u64,
    log: Arc<EventLog>,
    is_written: bool,
}

impl Pending {
    fn written(mut self) {
        self.is_written = true;
        self.log.publish(self.id);
    }
}

impl Drop for Pending {
    fn drop(&mut self) {
        if !self.is_written {
            self.log.close();
        }
    }
}

/// A job. Its state changes only through [`Job::start`], [`Job::succeed`], [`Job::fail`], [`Job::cancel`] and
/// [`Job::requeue`]. Each change goes to the ledger in the same order; [`Job::settled`] waits for it.
#[derive(Debug)]
pub struct Job {
    /// What it is.
    pub spec: Arc<Spec>,
    /// Since when this process knows it.
    pub accepted: Instant,
    /// News.
    pub events: Arc<EventLog>,
    ledger: Ledger,
    meters: Arc<Meters>,
    live: Mutex<Live>,
}

#[derive(Debug)]
struct Live {
    state: State,
    progress: Progress,
    preview: Option<Preview>,
    /// Number of the newest preview that there ever was.
    previews: u64,
    preview_wanted: bool,
    outcome: Option<Arc<Outcome>>,
    problem: Option<Problem>,
    /// Of all that happens to it, until it is over.
    span: Span,
}

impl Live {
    fn new(state: State) -> Self {
        Self {
            state,
            progress: Progress::default(),
            preview: None,
            previews: 0,
            preview_wanted: false,
            outcome: None,
            problem: None,
            span: Span::none(),
        }
    }

    /// One that has work before it.
    fn at_work(state: State, spec: &Spec) -> Self {
        let Spec { id, client, scene, params, .. } = spec;
        let (width, height) = (params.width, params.height);
        let span = tracing::info_span!("job", job = %id, %client, %scene, width, height, state = Empty, code = Empty);
        Self { span, ..Self::new(state) }
    }
}

impl Job {
    /// A job that is to be accepted: the ledger has to take the change.
    pub fn new(spec: Spec, ledger: Ledger, meters: Arc<Meters>) -> (Self, Change) {
        let (job, queued) = Self::create(spec, ledger, meters);
        let change = Change::Job(Arc::clone(&job.spec), queued);
        (job, change)
    }

    /// The same with its first event, for a change that takes several jobs.
    pub fn create(spec: Spec, ledger: Ledger, meters: Arc<Meters>) -> (Self, Event) {
        let events = EventLog::new([], 0);
        let queued = events.push(EventKind::Queued, json!({ "job": spec.id }));
        let spec = Arc::new(spec);
        let (accepted, live) = (Instant::now(), Mutex::new(Live::at_work(State::Queued, &spec)));
        (Self { spec, accepted, events: Arc::new(events), ledger, meters, live }, queued)
    }

    /// A job of the ledger.
    pub fn restored(restored: Restored, ledger: Ledger, meters: Arc<Meters>) -> Self {
        let Restored { spec, state, outcome, problem, mut events, last_event, film: _ } = restored;
        let mut live = if state.is_over() { Live::new(state) } else { Live::at_work(state, &spec) };
        // The pictures of an unfinished render were those of the process before.
        let previews = events.extract_if(.., |event| event.kind == EventKind::Preview);
        live.previews = previews.filter_map(|event| event.data["n"].as_u64()).max().unwrap_or_default();
        let progress = events.iter().rev().find(|event| event.kind == EventKind::Progress);
        live.progress = match &outcome {
            Some(outcome) => Progress::of(outcome),
            None => progress.and_then(|event| serde_json::from_value(event.data.clone()).ok()).unwrap_or_default(),
        };
        live.outcome = outcome.map(Arc::new);
        live.problem = problem;
        Self {
            spec: Arc::new(spec),
            accepted: Instant::now(),
            events: Arc::new(EventLog::new(events, last_event)),
            ledger,
            meters,
            live: Mutex::new(live),
        }
    }

    /// What its work is a part of, in the log and in traces; none once it is over.
    pub fn span(&self) -> Span {
        self.live().span.clone()
    }

    /// Where it stands.
    pub fn state(&self) -> State {
        self.live().state
    }

    /// Whether its work can be dropped.
    pub fn is_over(&self) -> bool {
        self.state().is_over()
    }

    /// The device begins; false if the job is over.
    pub fn start(&self, device: &str) -> bool {
        self.change_to(State::Running, |_| (EventKind::Started, json!({ "device": device }), Standing::Running))
    }

    /// The work has to begin anew, or from the film that was saved: the server has restarted.
    pub fn requeue(&self) -> bool {
        self.change_to(State::Queued, |_| {
            (EventKind::Queued, json!({ "job": self.spec.id, "again": true }), Standing::Queued)
        })
    }

    /// The picture is there; false if the job is over. `cached`: it had been made for another job.
    pub fn succeed(&self, outcome: Arc<Outcome>, cached: bool) -> bool {
        let result = format!("/v1/jobs/{}/result", self.spec.id);
        let data = json!({ "result": result, "report": outcome.record.report, "cached": cached });
        self.change_to(State::Succeeded, |live| {
            live.progress = Progress::of(&outcome);
            live.outcome = Some(Arc::clone(&outcome));
            (EventKind::Completed, data, Standing::Succeeded(outcome))
        })
    }

    /// A fault ends it; false if the job is over.
    pub fn fail(&self, problem: Problem) -> bool {
        self.change_to(State::Failed, |live| {
            live.problem = Some(problem.clone());
            (EventKind::Failed, json!(problem), Standing::Failed(problem))
        })
    }

    /// Someone ends it; false if the job is over.
    pub fn cancel(&self) -> bool {
        self.change_to(State::Cancelled, |_| (EventKind::Cancelled, json!({}), Standing::Cancelled))
    }

    fn change_to(&self, next: State, change: impl FnOnce(&mut Live) -> (EventKind, Value, Standing)) -> bool {
        let mut live = self.live();
        if !live.state.may_become(next) {
            return false;
        }
        live.state = next;
        let (kind, data, standing) = change(&mut live);
        if next.is_over() {
            live.preview = None;
            self.meters.end(next);
            self.audit(&live);
            live.span = Span::none();
        }
        // Still under the lock, so that the ledger has the changes in their order.
        self.tell(kind, data, Some(standing));
        true
    }

    /// The line of a job that is over, for whoever has to know who asked for what.
    fn audit(&self, live: &Live) {
        let Spec { id, client, scene, params, .. } = self.spec.as_ref();
        let (width, height) = (params.width, params.height);
        let samples = live.outcome.as_ref().map_or(live.progress.samples, |outcome| outcome.record.samples);
        let code = live.problem.as_ref().map_or("", |problem| problem.code.as_ref());
        let (state, ms) = (live.state.name(), self.accepted.elapsed().as_millis() as u64);
        tracing::info!(parent: &live.span, job = %id, %client, %scene, width, height, samples, state, code, ms, "job over");
        live.span.record("state", state).record("code", code);
    }

    /// Notes an event, which is published once the ledger has it.
    fn tell(&self, kind: EventKind, data: Value, standing: Option<Standing>) {
        let event = self.events.push(kind, data);
        let pending = Pending { id: event.id, log: Arc::clone(&self.events), is_written: false };
        self.ledger.record(Change::Event { job: self.spec.number, event, standing }, move || pending.written());
    }

    /// Notes how far the render is.
    pub fn advance(&self, progress: Progress) {
        let mut live = self.live();
        if live.state == State::Running {
            live.progress = progress;
            self.tell(EventKind::Progress, json!(progress), None);
        }
    }

    /// Shows a picture of the unfinished render.
    pub fn show(&self, file: Encoded, samples: u32) {
        let mut live = self.live();
        if live.state == State::Running {
            live.previews += 1;
            let number = live.previews;
            let url = format!("/v1/jobs/{}/preview?n={number}", self.spec.id);
            live.preview = Some(Preview { number, file });
            live.preview_wanted = false;
            self.tell(EventKind::Preview, json!({ "n": number, "samples": samples, "url": url }), None);
        }
    }

    /// The newest picture of the unfinished render; asking for it has the next one made.
    pub fn preview(&self) -> Option<Preview> {
        let mut live = self.live();
        live.preview_wanted = true;
        live.preview.clone()
    }

    /// Whether someone would look at a preview now.
    pub fn wants_preview(&self) -> bool {
        self.events.has_audience() || self.live().preview_wanted
    }

    /// What came of it.
    pub fn outcome(&self) -> Option<Arc<Outcome>> {
        self.live().outcome.clone()
    }

    /// Its linear picture has left; its file has not.
    pub fn lose_picture(&self) {
        let mut live = self.live();
        if let Some(outcome) = &mut live.outcome {
            Arc::make_mut(outcome).picture = None;
        }
    }

    /// Why it failed.
    pub fn problem(&self) -> Option<Problem> {
        self.live().problem.clone()
    }

    /// Waits until the ledger has all that has happened so far: what is told then is true after a restart too.
    ///
    /// # Errors
    /// The ledger cannot be written at present.
    pub async fn settled(&self) -> Result<(), LedgerError> {
        self.ledger.unless_stuck(self.events.settled()).await
    }

    /// Waits until the job is over and the ledger knows.
    pub async fn finished(&self) {
        let mut news = self.events.subscribe();
        while !self.is_over() {
            // The sender lives in `self`, so this cannot fail.
            let _ = news.changed().await;
        }
        self.events.settled().await;
    }

    /// Everything that a client may know.
    pub fn describe(&self, queue_position: Option<usize>) -> Value {
        let (live, spec) = (self.live(), &self.spec);
        let created = Duration::from_millis(spec.created.unsigned_abs());
        let link = |part: &str| format!("/v1/jobs/{}{part}", spec.id);
        json!({
            "id": spec.id,
            "state": live.state,
            "scene": spec.scene,
            "priority": spec.priority,
            "created_unix": seconds(created),
            "params": spec.params,
            "queue_position": queue_position,
            "progress": live.progress,
            "report": live.outcome.as_ref().map(|outcome| &outcome.record.report),
            "linear_picture": live.outcome.as_ref().is_some_and(|outcome| outcome.picture.is_some()),
            "problem": live.problem,
            "links": {
                "self": link(""),
                "events": link("/events"),
                "preview": link("/preview"),
                "result": link("/result"),
                "cancel": link("/cancel"),
            },
        })
    }

    fn live(&self) -> MutexGuard<'_, Live> {
        self.live.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
