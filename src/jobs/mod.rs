//! The service without HTTP: scenes, images, a bounded queue of jobs, and one thread that owns the device.
//!
//! A job goes `submit -> compile (blocking pool) -> worker (device, in slices) -> finish (blocking pool)`;
//! its state changes only through [`Job`], as [`State`] allows. Each change goes to the [`ledger`] before any client
//! hears of it; files lie in [`blobs`]. Without a data folder both are memory, and all else is the same.

mod active;
mod batch;
mod blobs;
mod compile;
mod describe;
mod events;
mod finish;
mod forget;
mod index;
mod job;
mod ledger;
mod library;
mod manifest;
mod memory;
mod meters;
mod outcome;
mod problem;
mod progress;
mod results;
mod resume;
mod saved;
mod scenes;
mod share;
mod state;
mod storage;
mod store;
mod submit;
mod table;
mod tidy;
mod trial;
mod usage;
mod webhooks;
mod worker;

pub use crate::render::report::{Report, Stages};
pub use batch::{Batch, BatchSpec, BatchSubmission, describe_item};
pub use events::{Event, EventKind, EventLog};
pub use job::{Job, Order};
pub use ledger::SceneRow;
pub use library::Images;
pub use manifest::{Item, ManifestError, Webhook, from_lines, from_matrix, no_params, read as read_manifest};
pub use memory::film_bytes;
pub use meters::Meters;
pub use outcome::{Encoded, Outcome, Preview, Record};
pub use problem::{Code, Problem};
pub use progress::Progress;
pub use scenes::{StoredImage, StoredScene};
pub use state::State;
pub use storage::{StorageError, audit_folder};
pub use store::{Store, Stored};
pub use submit::{Asked, Submission};
pub use trial::Trial;
pub use webhooks::Webhooks;
pub use worker::EngineFactory;

use crate::config::Limits;
use crate::denoise::Denoiser;
use crate::render::RenderError;
use memory::Budget;
use saved::SavedFilm;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock, mpsc};
use std::time::Duration;
use storage::Storage;
use table::Table;
use tokio::sync::{Notify, Semaphore, oneshot, watch};
use usage::Usage;
use worker::{Message, Shared, Worker};

/// Seconds after which a client that found the queue full should try again.
const RETRY_SECONDS: u32 = 2;

/// Jobs of batches that are compiled or traced at a time, per render that shares the device: one is traced, one gets ready.
const FED: usize = 2;

/// Memory that decoding takes per pixel of an environment picture: four f32 as read, three as kept, and the sampling table.
const HDRI_PIXEL_BYTES: u64 = 16 + 12 + 24;

/// Why a service cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// There is nothing to render on.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The data folder is at fault.
    #[error("the data folder cannot be used: {0}")]
    Storage(#[from] StorageError),
}

/// The render service. Cloning gives another handle to the same service; the device's thread ends with the last one.
#[derive(Clone)]
pub struct Service {
    core: Arc<Core>,
}

struct Core {
    limits: Limits,
    storage: Arc<Storage>,
    scenes: Store<StoredScene>,
    images: Store<StoredImage>,
    table: Arc<Table>,
    meters: Arc<Meters>,
    budget: Budget,
    worker: mpsc::Sender<Message>,
    usage: Usage,
    /// Places for jobs of batches that are being compiled or traced.
    feeding: Arc<Semaphore>,
    /// Places for imports and compilations, which use all cores.
    desks: Semaphore,
    /// MiB of memory for uploads that are being imported.
    import_memory: Arc<Semaphore>,
    tidy: Arc<Notify>,
    draining: AtomicBool,
    closed: watch::Sender<bool>,
    webhooks: OnceLock<Webhooks>,
    trial: OnceLock<Trial>,
    denoiser: Arc<OnceLock<Denoiser>>,
}

impl Service {
    /// A service that keeps everything in memory. Must be called within a tokio runtime.
    pub async fn start(limits: Limits, factory: EngineFactory) -> Result<Self, StartError> {
        Self::start_in(None, limits, factory).await
    }

    /// A service that keeps its data in a folder, and goes on with the jobs it finds there: waits for the first engine.
    pub async fn start_in(folder: Option<&Path>, limits: Limits, factory: EngineFactory) -> Result<Self, StartError> {
        let (storage, found) = Storage::open(folder).await?;
        let storage = Arc::new(storage);
        let meters = Arc::new(Meters::new());
        let (mut jobs, mut unfinished) = (Vec::new(), Vec::new());
        for restored in found.jobs {
            let film = restored.film.clone();
            let job = Arc::new(Job::restored(restored, storage.ledger.clone(), Arc::clone(&meters)));
            if !job.is_over() {
                unfinished.push((Arc::clone(&job), film));
            }
            jobs.push(job);
        }
        let batches = gather(found.batches, &jobs);
        let table = Arc::new(Table::new(limits.queue_length, jobs, batches, found.next));
        let tidy = Arc::new(Notify::new());
        let budget = Budget::new(limits.render_memory_bytes);
        let closed = watch::Sender::new(false);
        let denoiser = Arc::<OnceLock<_>>::default();
        let shared = Arc::new(Shared {
            denoiser: Arc::clone(&denoiser),
            table: Arc::clone(&table),
            budget: budget.clone(),
            meters: Arc::clone(&meters),
            places: limits.active_renders.max(1),
            render_time: Duration::from_secs(limits.render_seconds),
            save_period: storage.is_durable().then(|| Duration::from_millis(limits.save_film_ms)),
            save_bytes: limits.save_film_bytes,
            storage: Arc::clone(&storage),
            tidy: Arc::clone(&tidy),
            runtime: tokio::runtime::Handle::current(),
            closed: closed.subscribe(),
        });
        let worker = start_worker(shared, factory).await?;
        let desks = std::thread::available_parallelism().map_or(2, |cores| cores.get().max(2));
        let service = Self {
            core: Arc::new(Core {
                scenes: Store::new(limits.stored_scene_bytes),
                images: Store::new(limits.stored_image_bytes),
                storage,
                table,
                meters,
                budget,
                worker,
                usage: Usage::new(found.usage, ledger::now()),
                feeding: Arc::new(Semaphore::new(FED * limits.active_renders.max(1))),
                desks: Semaphore::new(desks),
                import_memory: Arc::new(Semaphore::new(mebibytes(limits.import_memory_bytes) as usize)),
                tidy,
                draining: AtomicBool::new(false),
                closed,
                webhooks: OnceLock::new(),
                trial: OnceLock::new(),
                denoiser,
                limits,
            }),
        };
        service.resume(unfinished);
        service.core.tidy.notify_one();
        tokio::spawn(tidy::keep_tidy(Arc::downgrade(&service.core)));
        Ok(service)
    }

    /// Bounds.
    pub fn limits(&self) -> &Limits {
        &self.core.limits
    }

    /// Tells of the ends of jobs from now on, and of those that an earlier process has left.
    pub fn tell_webhooks(&self, webhooks: Webhooks) {
        if self.core.webhooks.set(webhooks.clone()).is_ok() {
            tokio::spawn(webhooks::deliver(Arc::downgrade(&self.core), webhooks));
        }
    }

    /// Has scenes read by a process of its own first, from now on.
    pub fn try_scenes(&self, trial: Trial) {
        // The first one stays.
        let _ = self.core.trial.set(trial);
    }

    /// Has pictures denoised whose requests ask for it, from now on.
    pub fn denoise_with(&self, denoiser: Denoiser) {
        // The first one stays.
        let _ = self.core.denoiser.set(denoiser);
    }

    /// What denoises here, if there is something that can.
    pub fn denoiser(&self) -> Option<&Denoiser> {
        self.core.denoiser.get()
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

    /// Compiles a job and hands it to the worker.
    async fn compile(self, job: Arc<Job>, order: Order, saved: Option<SavedFilm>) {
        let limits = &self.core.limits;
        let (limit, save_bytes) = (limits.job_memory_bytes, limits.save_film_bytes);
        let copied = if self.core.storage.is_durable() { save_bytes } else { 0 };
        let at_hand = order.scene.is_compiled(&order.params);
        let compiling = {
            let job = Arc::clone(&job);
            move || compile::compile(job, &order, saved, limit, copied)
        };
        let result = if at_hand {
            tokio::task::spawn_blocking(compiling).await.unwrap_or_else(|_| Err(internal("this scene")))
        } else {
            self.at_desk(compiling).await
        };
        self.core.scenes.trim();
        match result {
            Ok(ready) => {
                if self.core.worker.send(Message::Ready(Box::new(ready))).is_err() {
                    self.fail(&job, internal("the device's thread"));
                }
            }
            Err(problem) => self.fail(&job, problem),
        }
    }

    fn fail(&self, job: &Job, problem: Problem) {
        if job.fail(problem) {
            self.core.tidy.notify_one();
        }
    }

    /// Looks a job up. What it says of itself then is in the ledger.
    pub async fn job(&self, id: &str) -> Result<Arc<Job>, Problem> {
        let detail = || format!("there is no job `{id}`; finished jobs are forgotten after a while (GET /v1/limits)");
        let job = self.core.table.get(id).ok_or_else(|| Problem::new(Code::JobNotFound, detail()))?;
        job.settled().await?;
        Ok(job)
    }

    /// Up to `count` jobs older than `before`, newest first, and whether there are more.
    pub async fn jobs(&self, before: Option<&Job>, count: usize) -> Result<(Vec<Arc<Job>>, bool), Problem> {
        let (jobs, more) = self.core.table.page(before, count);
        for job in &jobs {
            job.settled().await?;
        }
        Ok((jobs, more))
    }

    /// Everything that a client may know of a job.
    pub fn describe(&self, job: &Job) -> serde_json::Value {
        job.describe(self.core.table.position(job))
    }

    /// Cancels a job: at once as far as clients see; the device drops it after its slice. One that is over stays as it is.
    pub async fn cancel(&self, job: &Job) -> Result<(), Problem> {
        self.cancel_soon(job);
        Ok(job.settled().await?)
    }

    /// Cancels a job for which nobody waits any more.
    pub fn cancel_soon(&self, job: &Job) {
        if job.cancel() {
            self.core.tidy.notify_one();
        }
    }

    /// Whether new jobs are refused.
    pub fn is_draining(&self) -> bool {
        self.core.draining.load(Ordering::Acquire)
    }

    /// Whether the storage cannot be written at present (a full disk, say).
    pub fn is_stuck(&self) -> bool {
        self.core.storage.ledger.is_stuck()
    }

    /// Refuses new jobs, waits until the present ones are over (at most `patience`), and ends what listens. What is left
    /// then goes on when the next process opens the data folder; without one, or without a client to wait for it, it fails.
    /// Says whether there were any jobs.
    pub async fn drain(&self, patience: Duration) -> bool {
        self.core.draining.store(true, Ordering::Release);
        let under_way = self.core.table.under_way();
        let all_over = async {
            for job in &under_way {
                job.finished().await;
            }
        };
        if tokio::time::timeout(patience, all_over).await.is_err() {
            let goes_on = |job: &Job| self.core.storage.is_durable() && !job.spec.attended;
            for job in under_way.iter().filter(|job| !goes_on(job)) {
                self.fail(job, Problem::new(Code::ShuttingDown, "the server shut down before the job was done"));
                // Whoever waits for it hears of it all the same.
                let _ = job.settled().await;
            }
            let (done, suspended) = oneshot::channel();
            if self.core.worker.send(Message::Suspend(done)).is_ok() {
                let _ = suspended.await;
            }
        }
        self.core.closed.send_replace(true);
        !under_way.is_empty()
    }

    /// Lets go of the data folder. The service is of no use afterwards.
    pub async fn close(&self) {
        self.core.storage.ledger.close().await;
    }

    /// Becomes true when the service is over.
    pub fn closed(&self) -> watch::Receiver<bool> {
        self.core.closed.subscribe()
    }

    /// What is counted.
    pub fn meters(&self) -> &Meters {
        &self.core.meters
    }

    /// Estimated bytes of the renders under way.
    pub fn render_memory(&self) -> u64 {
        self.core.budget.used()
    }

    /// Jobs that wait: those that were asked for one by one, and those of batches.
    pub fn waiting(&self) -> (usize, usize) {
        self.core.table.waiting()
    }

    /// Number of jobs by state, in the order of [`State::ALL`].
    pub fn counts(&self) -> [usize; State::ALL.len()] {
        self.core.table.counts()
    }
}

/// Batches with their jobs, each in the order of its manifest.
fn gather(batches: Vec<BatchSpec>, jobs: &[Arc<Job>]) -> Vec<Batch> {
    let mut by_batch = BTreeMap::<i64, Vec<Arc<Job>>>::new();
    for job in jobs {
        if let Some(place) = &job.spec.place {
            by_batch.entry(place.batch).or_default().push(Arc::clone(job));
        }
    }
    let batch = |spec: BatchSpec| {
        let mut jobs = by_batch.remove(&spec.number).unwrap_or_default();
        jobs.sort_by_key(|job| job.spec.place.as_ref().map(|place| place.item));
        Batch { spec: Arc::new(spec), jobs }
    };
    batches.into_iter().map(batch).collect()
}

async fn start_worker(shared: Arc<Shared>, factory: EngineFactory) -> Result<mpsc::Sender<Message>, RenderError> {
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
    Ok(worker)
}

/// Bytes in whole MiB, at least one.
fn mebibytes(bytes: u64) -> u32 {
    u32::try_from(bytes.div_ceil(1 << 20)).unwrap_or(u32::MAX).clamp(1, u32::MAX >> 4)
}

fn internal(what: &str) -> Problem {
    Problem::new(Code::Internal, format!("a fault of the server, met in {what}; please report it"))
}
