//! Batches: jobs that are asked for together. All are in the ledger before anyone hears of the batch; the device gets
//! them a few at a time, so that a thousand cost no more memory than those under way.

use super::Service;
use super::job::{Job, Place, Spec};
use super::ledger::{Leaving, LedgerError, now};
use super::manifest::Item;
use super::problem::{Code, Problem};
use super::scenes::content_id;
use super::state::State;
use super::submit::content;
use super::table::Admission;
use crate::params::{FieldError, RenderParams};
use serde_json::{Value, json};
use std::collections::HashSet;
use std::sync::Arc;
use tokio::sync::OwnedSemaphorePermit;

/// Seconds after which a client that found no room for its batch should try again.
const BATCH_RETRY_SECONDS: u32 = 30;

/// What a batch is, for as long as it is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BatchSpec {
    /// Counts the batches of this ledger.
    pub number: i64,
    /// `batch-...`
    pub id: String,
    /// The client's `Idempotency-Key`, as of a job.
    pub key: Option<String>,
    /// When it was accepted: milliseconds since 1970.
    pub created: i64,
    /// Who sent it.
    pub client: String,
    /// What all its jobs ask for, hashed.
    pub content: String,
}

/// A batch.
#[derive(Debug)]
pub struct Batch {
    /// What it is.
    pub spec: Arc<BatchSpec>,
    /// Its jobs, in the order of the manifest.
    pub jobs: Vec<Arc<Job>>,
}

/// A manifest, and how it was given.
#[derive(Debug, Clone)]
pub struct BatchSubmission {
    /// At least one.
    pub items: Vec<Item>,
    /// `Idempotency-Key`, as of a job: the same key again means the same batch.
    pub key: Option<String>,
    /// Who asks.
    pub client: String,
    /// Renders that this client may have on one day.
    pub quota: Option<u64>,
    /// Whether to render even if the same pictures were made before.
    pub anew: bool,
}

impl Batch {
    /// Waits until every job is over and the ledger knows.
    pub async fn finished(&self) {
        for job in &self.jobs {
            job.finished().await;
        }
    }

    /// Waits until the ledger has all that has happened so far.
    ///
    /// # Errors
    /// It cannot be written at present.
    pub async fn settled(&self) -> Result<(), LedgerError> {
        for job in &self.jobs {
            job.settled().await?;
        }
        Ok(())
    }

    /// What a client may know of the batch as a whole.
    pub fn summary(&self) -> Value {
        let states: Vec<State> = self.jobs.iter().map(|job| job.state()).collect();
        let count = |state: State| states.iter().filter(|other| **other == state).count();
        let counts: serde_json::Map<_, _> =
            State::ALL.iter().map(|state| (state.name().to_owned(), json!(count(*state)))).collect();
        let state = match () {
            () if states.iter().all(|state| state.is_over()) => "finished",
            () if count(State::Queued) == states.len() => "queued",
            () => "running",
        };
        let link = |part: &str| format!("/v1/batches/{}{part}", self.spec.id);
        json!({
            "id": self.spec.id,
            "state": state,
            "created_unix": self.spec.created as f64 / 1e3,
            "counts": counts,
            "links": { "self": link(""), "events": link("/events"), "results": link("/results"), "cancel": link("/cancel") },
        })
    }

    /// Everything that a client may know, job by job.
    pub fn describe(&self) -> Value {
        let mut value = self.summary();
        value["items"] = self.jobs.iter().map(|job| describe_item(job)).collect();
        value
    }
}

/// Where one job of a batch stands.
pub fn describe_item(job: &Job) -> Value {
    let (state, outcome) = (job.state(), job.outcome());
    let record = outcome.as_ref().map(|outcome| &outcome.record);
    let name = job.spec.place.as_ref().map(|place| place.name.as_str());
    json!({
        "name": name,
        "job": job.spec.id,
        "scene": job.spec.scene,
        "state": state,
        "samples": record.map(|record| record.samples),
        "error": record.and_then(|record| record.error),
        "error_bound_95": record.and_then(|record| record.error_bound_95),
        "problem": job.problem(),
    })
}

impl Service {
    /// Accepts all jobs of a batch once the ledger has them, or none.
    pub async fn submit_batch(&self, submission: BatchSubmission) -> Result<Arc<Batch>, Problem> {
        let BatchSubmission { items, key, client, quota, anew } = submission;
        let content = batch_content(&items);
        // What was accepted before needs nothing that is checked now.
        if let Some(batch) = self.core.table.known_batch(key.as_deref()) {
            return as_it_stands(batch, &content).await;
        }
        self.refuse_when_draining()?;
        self.check_items(&items).await?;
        let renders = items.len() as u64;
        let jobs: Vec<Spec> = items.into_iter().enumerate().map(|(n, item)| spec_of(item, n as u32, &client)).collect();
        let spec = BatchSpec {
            number: 0,
            id: String::new(),
            key,
            created: now(),
            content: content.clone(),
            client: client.clone(),
        };
        let ledger = &self.core.storage.ledger;
        let most = self.core.limits.batch_queue_length.max(self.core.limits.batch_items);
        let admission = self.core.table.admit_batch(spec, jobs, most, |spec, jobs| {
            let taken = self.core.usage.take(&client, renders, quota)?;
            let made = jobs.into_iter().map(|spec| Job::create(spec, ledger.clone(), Arc::clone(&self.core.meters)));
            let (jobs, first): (Vec<_>, Vec<_>) = made.unzip();
            let rows = jobs.iter().map(|job| Arc::clone(&job.spec)).zip(first).collect();
            Ok((jobs, (ledger.commit(super::ledger::Change::Batch(spec, rows)), taken)))
        });
        match admission? {
            Admission::New(batch, (sent, taken)) => {
                let taken_by_ledger = self.core.storage.accepted(sent).await;
                self.accept_batch(&batch, taken_by_ledger)?;
                taken.keep();
                let shares = self.core.limits.result_cache && !anew;
                let work = batch.jobs.iter().map(|job| (Arc::clone(job), None)).collect();
                tokio::spawn(self.clone().feed(work, shares));
                Ok(batch)
            }
            Admission::Known(batch) => as_it_stands(batch, &content).await,
            Admission::Full(waiting) => {
                let detail =
                    format!("{waiting} jobs of batches wait, and {most} may (GET /v1/limits, batch_queue_length)");
                Err(Problem::new(Code::QueueFull, detail).retry_after(BATCH_RETRY_SECONDS))
            }
        }
    }

    fn accept_batch(&self, batch: &Batch, taken: Result<bool, Problem>) -> Result<(), Problem> {
        match taken {
            Ok(true) => {
                let BatchSpec { id, client, .. } = batch.spec.as_ref();
                tracing::info!(batch = %id, %client, jobs = batch.jobs.len(), "batch accepted");
                self.core.meters.accepted.inc_by(batch.jobs.len() as u64);
                batch.jobs.iter().for_each(|job| job.events.publish(1));
                Ok(())
            }
            Ok(false) => {
                let numbers: Vec<i64> = batch.jobs.iter().map(|job| job.spec.number).collect();
                self.core.table.forget(&numbers, &[batch.spec.number]);
                let detail = "a scene or an image of this batch has just been forgotten: upload it again";
                Err(Problem::new(Code::SceneNotFound, detail))
            }
            Err(problem) => {
                let jobs = batch.jobs.iter().map(|job| job.spec.number).collect();
                self.withdraw(&batch.jobs, Leaving { jobs, batches: vec![batch.spec.number], ..Leaving::default() });
                Err(problem)
            }
        }
    }

    /// Whether every item is valid, within the limits, and names what is there. Tells of the first one that is not.
    async fn check_items(&self, items: &[Item]) -> Result<(), Problem> {
        let (mut scenes, mut images) = (HashSet::new(), HashSet::new());
        for item in items {
            let part = format!("`{}`", item.name);
            let place = |problem: Problem| problem.within(&part, |fault| item.origin.place(fault));
            self.check(&item.params, item.priority).map_err(place)?;
            self.check_webhook(item.webhook.as_deref()).map_err(place)?;
            if scenes.insert(&item.scene) && !self.core.storage.offers_scene(&item.scene).await? {
                let detail = format!("there is no scene `{}`; scenes not used for long are forgotten", item.scene);
                let errors = vec![FieldError::new("/scene", "unknown scene")];
                return Err(place(Problem { errors, ..Problem::new(Code::SceneNotFound, detail) }));
            }
            for (pointer, image) in image_names(&item.params) {
                if !images.contains(&image) && !self.core.storage.offers_image(&image).await? {
                    let detail = format!("there is no image `{image}`: name an id that POST /v1/images gave");
                    return Err(place(Problem::fields(Code::InvalidParams, vec![FieldError::new(pointer, detail)])));
                }
                images.insert(image);
            }
        }
        Ok(())
    }

    /// Gives jobs to the compiler and the device, a few at a time. `shares`: results of other jobs will do.
    pub(super) async fn feed(self, work: Vec<(Arc<Job>, Option<String>)>, shares: bool) {
        for (job, film) in work {
            if job.is_over() {
                continue;
            }
            // The semaphore is never closed.
            let Ok(place) = Arc::clone(&self.core.feeding).acquire_owned().await else { return };
            tokio::spawn(self.clone().begin_item(job, film, shares, place));
        }
    }

    /// Holds its place until the job is over.
    async fn begin_item(self, job: Arc<Job>, film: Option<String>, shares: bool, place: OwnedSemaphorePermit) {
        if !(shares && self.serve_from_cache(&job).await) {
            self.reopen(Arc::clone(&job), film).await;
        }
        job.finished().await;
        drop(place);
    }

    /// Looks a batch up. What it says of itself then is in the ledger.
    pub async fn batch(&self, id: &str) -> Result<Arc<Batch>, Problem> {
        let detail = || format!("there is no batch `{id}`; finished ones are forgotten after a while (GET /v1/limits)");
        let batch = self.core.table.batch(id).ok_or_else(|| Problem::new(Code::BatchNotFound, detail()))?;
        batch.settled().await?;
        Ok(batch)
    }

    /// Up to `count` batches older than `before`, newest first, and whether there are more.
    pub async fn batches(&self, before: Option<&Batch>, count: usize) -> Result<(Vec<Arc<Batch>>, bool), Problem> {
        let (batches, more) = self.core.table.batches(before, count);
        for batch in &batches {
            batch.settled().await?;
        }
        Ok((batches, more))
    }

    /// Cancels what is not over of a batch. Doing so again is fine.
    pub async fn cancel_batch(&self, batch: &Batch) -> Result<(), Problem> {
        batch.jobs.iter().for_each(|job| self.cancel_soon(job));
        Ok(batch.settled().await?)
    }
}

/// A batch that is there already, unless it is another one than is asked for.
async fn as_it_stands(batch: Arc<Batch>, content: &str) -> Result<Arc<Batch>, Problem> {
    if batch.spec.content != content {
        let detail = format!("this Idempotency-Key began `{}`, which asks for something else", batch.spec.id);
        return Err(Problem::new(Code::IdempotencyMismatch, detail));
    }
    batch.settled().await?;
    Ok(batch)
}

/// Pointers and names of the images that parameters ask for.
fn image_names(params: &RenderParams) -> Vec<(String, String)> {
    let environment = params.hdri_name().map(|name| ("/params/environment/hdri".to_owned(), name.to_owned()));
    let mut params = params.clone();
    let owned = |(pointer, name): (String, &mut String)| (pointer, name.clone());
    let maps: Vec<_> = params.map_names_mut().map(owned).collect();
    environment.into_iter().chain(maps).chain(params.profile_names_mut().map(owned)).collect()
}

fn spec_of(item: Item, index: u32, client: &str) -> Spec {
    let image = item.params.hdri_name().map(str::to_owned);
    Spec {
        number: 0,
        id: String::new(),
        key: None,
        created: now(),
        content: content(&item.scene, image.as_deref(), &item.params),
        scene: item.scene,
        image,
        params: item.params,
        priority: item.priority,
        client: client.to_owned(),
        attended: false,
        place: Some(Place { batch: 0, item: index, name: item.name }),
        webhook: item.webhook,
    }
}

/// Of everything that a manifest says.
fn batch_content(items: &[Item]) -> String {
    let line = |item: &Item| json!([item.name, item.scene, item.params, item.priority, item.webhook]);
    content_id(items.iter().map(line).collect::<Value>().to_string().as_bytes())
}
