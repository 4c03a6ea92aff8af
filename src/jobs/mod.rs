//! The service without HTTP: scenes, images, a bounded queue of jobs, and one thread that owns the device.
//!
//! A job goes `submit -> compile (blocking pool) -> worker (device, in slices) -> finish (blocking pool)`;
//! its state changes only through [`Job`], as [`State`] allows.

mod compile;
mod describe;
mod events;
mod finish;
mod job;
mod memory;
mod problem;
mod progress;
mod scenes;
mod share;
mod state;
mod store;
mod table;
mod worker;

pub use crate::render::report::{Report, Stages};
pub use events::{Event, EventKind, EventLog};
pub use job::{Encoded, Job, Order, Outcome, Preview};
pub use memory::film_bytes;
pub use problem::{Code, Problem};
pub use progress::Progress;
pub use scenes::{StoredImage, StoredScene};
pub use state::State;
pub use store::{Store, Stored};
pub use worker::EngineFactory;

use crate::compile::decode_hdri;
use crate::config::Limits;
use crate::film::Aov;
use crate::params::{EnvironmentChoice, FieldError, ImageFormat, RenderParams};
use crate::render::RenderError;
use crate::scene::{self, Package};
use memory::Budget;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;
use table::Table;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot, watch};
use worker::{Ready, Shared, Worker};

/// Seconds after which a client that found the queue full should try again.
const RETRY_SECONDS: u32 = 2;

/// Memory that decoding takes per pixel of an environment picture: four f32 as read, three as kept, and the sampling table.
const HDRI_PIXEL_BYTES: u64 = 16 + 12 + 24;

/// The render service. Cloning gives another handle to the same service; the device's thread ends with the last one.
#[derive(Clone)]
pub struct Service {
    core: Arc<Core>,
}

struct Core {
    limits: Limits,
    scenes: Store<StoredScene>,
    images: Store<StoredImage>,
    table: Arc<Table>,
    worker: mpsc::Sender<Ready>,
    /// Places for imports and compilations, which use all cores.
    desks: Semaphore,
    /// MiB of memory for uploads that are being imported.
    import_memory: Arc<Semaphore>,
    draining: AtomicBool,
    closed: watch::Sender<bool>,
}

impl Service {
    /// Starts the device's thread and waits for its engine. Must be called within a tokio runtime.
    pub async fn start(limits: Limits, factory: EngineFactory) -> Result<Self, RenderError> {
        let table = Arc::new(Table::new(limits.queue_length, limits.kept_jobs, limits.kept_result_bytes));
        let shared = Arc::new(Shared {
            table: Arc::clone(&table),
            budget: Budget::new(limits.render_memory_bytes),
            places: limits.active_renders.max(1),
            render_time: Duration::from_secs(limits.render_seconds),
            runtime: tokio::runtime::Handle::current(),
        });
        let (worker, inbox) = mpsc::channel();
        let (started, start) = oneshot::channel();
        std::thread::spawn(move || match Worker::new(shared, factory) {
            Ok(worker) => {
                if started.send(Ok(())).is_ok() {
                    worker.run(&inbox);
                }
            }
            Err(error) => {
                let _ = started.send(Err(error));
            }
        });
        start.await.unwrap_or_else(|_| Err(RenderError::NoAdapter("the engine failed to start".into())))?;
        let desks = std::thread::available_parallelism().map_or(2, |cores| cores.get().max(2));
        Ok(Self {
            core: Arc::new(Core {
                scenes: Store::new(limits.stored_scene_bytes),
                images: Store::new(limits.stored_image_bytes),
                table,
                worker,
                desks: Semaphore::new(desks),
                import_memory: Arc::new(Semaphore::new(mebibytes(limits.import_memory_bytes) as usize)),
                draining: AtomicBool::new(false),
                closed: watch::Sender::new(false),
                limits,
            }),
        })
    }

    /// Bounds.
    pub fn limits(&self) -> &Limits {
        &self.core.limits
    }

    /// Scenes that are kept.
    pub fn scenes(&self) -> &Store<StoredScene> {
        &self.core.scenes
    }

    /// Images that are kept.
    pub fn images(&self) -> &Store<StoredImage> {
        &self.core.images
    }

    /// Imports the files (name, bytes) of a glTF, unless they are kept already. Says whether the scene is new.
    pub async fn add_scene(&self, parts: Vec<(String, Vec<u8>)>) -> Result<(Arc<StoredScene>, bool), Problem> {
        let limits = self.core.limits.scene();
        let upload_bytes = parts.iter().map(|(_, bytes)| bytes.len() as u64).sum();
        let memory = self.import_memory(limits.import_memory(upload_bytes, Package::is_packed(&parts))).await;
        let service = self.clone();
        self.at_desk(move || {
            // Held until the work has ended, whether or not anybody still waits for it.
            let _memory = memory;
            let package = Package::from_parts(parts, &limits)?;
            let id = package.id();
            if let Some(present) = service.core.scenes.get(&id) {
                return Ok((present, false));
            }
            let scene = scene::import(&package, &limits)?;
            Ok(service.core.scenes.insert(StoredScene::new(id, scene, upload_bytes)))
        })
        .await
    }

    /// Decodes an environment picture, unless it is kept already. `pointer` names it in errors.
    pub async fn add_image(&self, bytes: Vec<u8>, pointer: &'static str) -> Result<(Arc<StoredImage>, bool), Problem> {
        let limit = self.core.limits.environment_pixels;
        let memory = self.import_memory(bytes.len() as u64 + limit.saturating_mul(HDRI_PIXEL_BYTES)).await;
        let service = self.clone();
        self.at_desk(move || {
            let _memory = memory;
            let id = scenes::content_id(&bytes);
            if let Some(present) = service.core.images.get(&id) {
                return Ok((present, false));
            }
            let hdri = decode_hdri(&bytes, limit).map_err(|error| {
                let fault = FieldError { pointer: pointer.to_owned(), detail: error.to_string() };
                Problem::fields(Code::InvalidImage, vec![fault])
            })?;
            let image = StoredImage { id, upload_bytes: bytes.len() as u64, hdri: Arc::new(hdri) };
            Ok(service.core.images.insert(image))
        })
        .await
    }

    /// Waits until so much memory is free for an import; what is over the whole limit has to be alone.
    async fn import_memory(&self, bytes: u64) -> Option<OwnedSemaphorePermit> {
        let whole = mebibytes(self.core.limits.import_memory_bytes);
        // The semaphore is never closed.
        Arc::clone(&self.core.import_memory).acquire_many_owned(mebibytes(bytes).min(whole)).await.ok()
    }

    /// Runs work that needs a core for long, when there is a place for it. Its panic becomes a problem.
    async fn at_desk<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        // The semaphore is never closed.
        let _place = self.core.desks.acquire().await;
        tokio::task::spawn_blocking(work).await.unwrap_or_else(|_| Err(internal("this input")))
    }

    /// Accepts a job, or refuses it at once.
    pub fn submit(&self, order: Order) -> Result<Arc<Job>, Problem> {
        if self.is_draining() {
            let detail = "the server is shutting down and takes no new jobs";
            return Err(Problem::new(Code::ShuttingDown, detail).retry_after(RETRY_SECONDS));
        }
        self.check(&order)?;
        let job = self.core.table.accept(order).ok_or_else(|| {
            let detail = format!("{} jobs are waiting already; try again later", self.core.limits.queue_length);
            Problem::new(Code::QueueFull, detail).retry_after(RETRY_SECONDS)
        })?;
        tokio::spawn(self.clone().compile(Arc::clone(&job)));
        Ok(job)
    }

    /// Whether the order is valid and within the limits.
    fn check(&self, order: &Order) -> Result<(), Problem> {
        let params = &order.params;
        let invalid = |faults| Problem::fields(Code::InvalidParams, faults);
        params.validate(&self.core.limits.params()).map_err(invalid)?;
        if !(-100..=100).contains(&order.priority) {
            let detail = format!("must lie between -100 and 100, and is {}", order.priority);
            return Err(invalid(vec![FieldError { pointer: "/priority".to_owned(), detail }]));
        }
        let (bytes, limit) = (film_bytes(params.width, params.height), self.core.limits.job_memory_bytes);
        if bytes > limit {
            let detail = format!("the picture needs {bytes} bytes of memory, more than the {limit} allowed here");
            let fault = FieldError { pointer: "/params/width".to_owned(), detail };
            return Err(Problem::fields(Code::LimitExceeded, vec![fault]));
        }
        Ok(())
    }

    /// Compiles a job and hands it to the worker.
    async fn compile(self, job: Arc<Job>) {
        let Some(order) = job.take_order() else { return };
        let limit = self.core.limits.job_memory_bytes;
        let at_hand = order.scene.is_compiled(order.params.scene, order.params.variant.as_deref());
        let compiling = {
            let job = Arc::clone(&job);
            move || compile::compile(job, &order, limit)
        };
        let result = if at_hand {
            tokio::task::spawn_blocking(compiling).await.unwrap_or_else(|_| Err(internal("this scene")))
        } else {
            self.at_desk(compiling).await
        };
        self.core.scenes.trim();
        let faulty = match result {
            Ok(ready) => self.core.worker.send(ready).is_err().then(|| internal("the device's thread")),
            Err(problem) => Some(problem),
        };
        if faulty.is_some_and(|problem| job.fail(problem)) {
            self.core.table.retire(&job);
        }
    }

    /// Looks a job up.
    pub fn job(&self, id: &str) -> Result<Arc<Job>, Problem> {
        let detail = || format!("there is no job `{id}`; finished jobs are forgotten after a while (GET /v1/limits)");
        self.core.table.get(id).ok_or_else(|| Problem::new(Code::JobNotFound, detail()))
    }

    /// Up to `count` jobs older than `before`, newest first, and whether there are more.
    pub fn jobs(&self, before: Option<&str>, count: usize) -> (Vec<Arc<Job>>, bool) {
        self.core.table.page(before, count)
    }

    /// Everything that a client may know of a job.
    pub fn describe(&self, job: &Job) -> serde_json::Value {
        job.describe(self.core.table.position(job))
    }

    /// Cancels a job: at once as far as clients see; the device drops it after its slice. Doing so again is fine.
    pub fn cancel(&self, job: &Job) -> Result<(), Problem> {
        if job.cancel() {
            self.core.table.retire(job);
        }
        match job.state() {
            State::Cancelled => Ok(()),
            state => {
                let detail = format!("the job has {} and cannot be cancelled any more", state.name());
                Err(Problem::new(Code::JobOver, detail))
            }
        }
    }

    /// The picture of a job in a format.
    pub async fn result(&self, job: &Job, format: ImageFormat) -> Result<Encoded, Problem> {
        let outcome = job.outcome().ok_or_else(|| no_result(job))?;
        if outcome.file.format == format {
            return Ok(outcome.file.clone());
        }
        let params = job.params.clone();
        self.at_desk(move || finish::encode(&outcome.picture, &params, format, &outcome.report.facts())).await
    }

    /// What is known of each pixel of a job's picture, as EXR.
    pub async fn aov(&self, job: &Job, aov: Aov) -> Result<Encoded, Problem> {
        let outcome = job.outcome().ok_or_else(|| no_result(job))?;
        self.at_desk(move || finish::encode_aov(&outcome, aov)).await
    }

    /// Whether new jobs are refused.
    pub fn is_draining(&self) -> bool {
        self.core.draining.load(Ordering::Acquire)
    }

    /// Refuses new jobs, waits until the present ones are over (at most `patience`), fails the rest, and
    /// ends what listens. Says whether there were any.
    pub async fn drain(&self, patience: Duration) -> bool {
        self.core.draining.store(true, Ordering::Release);
        let under_way = self.core.table.under_way();
        let all_over = async {
            for job in &under_way {
                job.finished().await;
            }
        };
        if tokio::time::timeout(patience, all_over).await.is_err() {
            for job in &under_way {
                if job.fail(Problem::new(Code::ShuttingDown, "the server shut down before the job was done")) {
                    self.core.table.retire(job);
                }
            }
        }
        self.core.closed.send_replace(true);
        !under_way.is_empty()
    }

    /// Becomes true when the service is over.
    pub fn closed(&self) -> watch::Receiver<bool> {
        self.core.closed.subscribe()
    }

    /// Parameters with the environment's picture looked up, if they name one that is kept.
    pub fn stored_hdri(&self, params: &RenderParams) -> Result<Option<Arc<StoredImage>>, Problem> {
        let Some(name) = hdri_name(params) else { return Ok(None) };
        let found = self.core.images.get(name).map(Some);
        found.ok_or_else(|| {
            let detail = format!(
                "there is no image `{name}`: name a file part of the same form, or an id that POST /v1/images gave"
            );
            let fault = FieldError { pointer: "/params/environment/hdri".to_owned(), detail };
            Problem::fields(Code::InvalidParams, vec![fault])
        })
    }
}

/// What the parameters call the picture of the environment.
pub fn hdri_name(params: &RenderParams) -> Option<&str> {
    match &params.environment {
        EnvironmentChoice::Given(environment) => environment.hdri.as_deref(),
        EnvironmentChoice::Auto | EnvironmentChoice::None => None,
    }
}

fn no_result(job: &Job) -> Problem {
    match job.state() {
        State::Failed => {
            let reason = job.problem().map(|problem| problem.detail).unwrap_or_default();
            Problem::new(Code::JobFailed, format!("the job failed and has no result: {reason}"))
        }
        State::Cancelled => Problem::new(Code::JobCancelled, "the job was cancelled and has no result"),
        _ => Problem::new(Code::NotFinished, "the job is still under way; wait for `completed` in its events"),
    }
}

/// Bytes in whole MiB, at least one.
fn mebibytes(bytes: u64) -> u32 {
    u32::try_from(bytes.div_ceil(1 << 20)).unwrap_or(u32::MAX).clamp(1, u32::MAX >> 4)
}

fn internal(what: &str) -> Problem {
    Problem::new(Code::Internal, format!("a fault of the server, met in {what}; please report it"))
}
