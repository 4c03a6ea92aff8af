//! One job: its request, where it stands, what came of it.

use super::events::{EventKind, EventLog};
use super::problem::Problem;
use super::progress::{Progress, seconds};
use super::scenes::{StoredImage, StoredScene};
use super::state::State;
use crate::film::{Aovs, Picture};
use crate::params::{ImageFormat, RenderParams};
use crate::render::report::{Report, Stages};
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// What to render.
#[derive(Debug, Clone)]
pub struct Order {
    /// Scene.
    pub scene: Arc<StoredScene>,
    /// Picture that the environment shows, if the parameters name one.
    pub hdri: Option<Arc<StoredImage>>,
    /// All else that the picture depends on.
    pub params: RenderParams,
    /// -100 to 100: a job of higher priority gets a larger share of the device.
    pub priority: i32,
    /// Seconds spent on it before it became a job.
    pub stages: Stages,
}

/// A file with what the client needs to know of it.
#[derive(Debug, Clone)]
pub struct Encoded {
    /// The file.
    pub bytes: Arc<[u8]>,
    /// Its format.
    pub format: ImageFormat,
    /// Hash of the bytes, quoted.
    pub etag: String,
}

/// A picture of the unfinished render.
#[derive(Debug, Clone)]
pub struct Preview {
    /// Counts from 1 within the job.
    pub number: u64,
    /// The file: JPEG, or PNG where the background is transparent.
    pub file: Encoded,
}

/// What came of a render.
#[derive(Debug)]
pub struct Outcome {
    /// Scene-linear picture, from which every format is made.
    pub picture: Arc<Picture>,
    /// What is known of each pixel besides.
    pub aovs: Aovs,
    /// Its facts.
    pub report: Report,
    /// The file in the format of the request.
    pub file: Encoded,
}

/// A job. Its state changes only through [`Job::start`], [`Job::succeed`], [`Job::fail`] and [`Job::cancel`].
#[derive(Debug)]
pub struct Job {
    /// `job-...`; ids sort by age.
    pub id: String,
    /// Id of the scene.
    pub scene: String,
    /// Parameters.
    pub params: RenderParams,
    /// -100 to 100.
    pub priority: i32,
    /// When it was accepted.
    pub accepted: Instant,
    /// News.
    pub events: EventLog,
    created: SystemTime,
    live: Mutex<Live>,
}

#[derive(Debug)]
struct Live {
    state: State,
    order: Option<Order>,
    progress: Progress,
    preview: Option<Preview>,
    preview_wanted: bool,
    outcome: Option<Arc<Outcome>>,
    problem: Option<Problem>,
}

impl Job {
    /// An accepted job.
    pub fn new(id: String, order: Order) -> Self {
        let events = EventLog::new();
        events.push(EventKind::Queued, json!({ "job": id }));
        Self {
            id,
            scene: order.scene.id.clone(),
            params: order.params.clone(),
            priority: order.priority,
            accepted: Instant::now(),
            events,
            created: SystemTime::now(),
            live: Mutex::new(Live {
                state: State::Queued,
                order: Some(order),
                progress: Progress::default(),
                preview: None,
                preview_wanted: false,
                outcome: None,
                problem: None,
            }),
        }
    }

    /// Where it stands.
    pub fn state(&self) -> State {
        self.live().state
    }

    /// Whether its work can be dropped.
    pub fn is_over(&self) -> bool {
        self.state().is_over()
    }

    /// The order, once: whoever takes it does the work, and a job that is over holds no scene.
    pub fn take_order(&self) -> Option<Order> {
        self.live().order.take()
    }

    /// The device begins; false if the job is over.
    pub fn start(&self, device: &str) -> bool {
        self.change_to(State::Running, |_| (EventKind::Started, json!({ "device": device })))
    }

    /// The picture is there; false if the job is over.
    pub fn succeed(&self, outcome: Outcome) -> bool {
        let data = json!({ "result": format!("/v1/jobs/{}/result", self.id), "report": outcome.report });
        self.change_to(State::Succeeded, |live| {
            live.progress = Progress {
                fraction: 1.0,
                samples: outcome.report.samples,
                error: outcome.report.error,
                error_bound_95: outcome.report.error_bound_95,
                eta_seconds: Some(0.0),
            };
            live.outcome = Some(Arc::new(outcome));
            (EventKind::Completed, data)
        })
    }

    /// A fault ends it; false if the job is over.
    pub fn fail(&self, problem: Problem) -> bool {
        self.change_to(State::Failed, |live| {
            let data = json!(problem);
            live.problem = Some(problem);
            (EventKind::Failed, data)
        })
    }

    /// Someone ends it; false if the job is over.
    pub fn cancel(&self) -> bool {
        self.change_to(State::Cancelled, |_| (EventKind::Cancelled, json!({})))
    }

    fn change_to(&self, next: State, change: impl FnOnce(&mut Live) -> (EventKind, Value)) -> bool {
        let mut live = self.live();
        if !live.state.may_become(next) {
            return false;
        }
        live.state = next;
        if next.is_over() {
            live.order = None;
            live.preview = None;
        }
        let (kind, data) = change(&mut live);
        self.events.push(kind, data);
        true
    }

    /// Notes how far the render is.
    pub fn advance(&self, progress: Progress) {
        let mut live = self.live();
        if live.state == State::Running {
            live.progress = progress;
            self.events.push(EventKind::Progress, json!(progress));
        }
    }

    /// Shows a picture of the unfinished render.
    pub fn show(&self, file: Encoded, samples: u32) {
        let mut live = self.live();
        if live.state == State::Running {
            let number = live.preview.as_ref().map_or(1, |preview| preview.number + 1);
            let url = format!("/v1/jobs/{}/preview?n={number}", self.id);
            live.preview = Some(Preview { number, file });
            live.preview_wanted = false;
            self.events.push(EventKind::Preview, json!({ "n": number, "samples": samples, "url": url }));
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

    /// Why it failed.
    pub fn problem(&self) -> Option<Problem> {
        self.live().problem.clone()
    }

    /// Memory of the result.
    pub fn result_bytes(&self) -> u64 {
        self.outcome().map_or(0, |outcome| {
            let picture = size_of_val(outcome.picture.pixels.as_slice());
            (picture + outcome.aovs.bytes() + outcome.file.bytes.len()) as u64
        })
    }

    /// Waits until the job is over.
    pub async fn finished(&self) {
        let mut news = self.events.subscribe();
        while !self.is_over() {
            // The sender lives in `self`, so this cannot fail.
            let _ = news.changed().await;
        }
    }

    /// Everything that a client may know.
    pub fn describe(&self, queue_position: Option<usize>) -> Value {
        let live = self.live();
        let created = self.created.duration_since(UNIX_EPOCH).unwrap_or_default();
        let link = |part: &str| format!("/v1/jobs/{}{part}", self.id);
        json!({
            "id": self.id,
            "state": live.state,
            "scene": self.scene,
            "priority": self.priority,
            "created_unix": seconds(created),
            "params": self.params,
            "queue_position": queue_position,
            "progress": live.progress,
            "report": live.outcome.as_ref().map(|outcome| &outcome.report),
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
