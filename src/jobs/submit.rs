//! How a request becomes a job: checked, admitted, in the ledger, and only then told.

use super::job::{Job, Order, Spec};
use super::ledger::{Change, Leaving, LedgerError, now};
use super::memory::film_bytes;
use super::problem::{Code, Problem};
use super::saved::ENGINE_VERSION;
use super::scenes::content_id;
use super::table::Admission;
use super::{RETRY_SECONDS, Service};
use crate::denoise::HOW_TO_GET_IT;
use crate::params::{FieldError, ImageFormat, RenderParams};
use std::sync::Arc;

/// An order, and how it was given.
#[derive(Debug, Clone)]
pub struct Submission {
    /// What to render.
    pub order: Order,
    /// Id that the client has chosen; none: the server chooses.
    pub id: Option<String>,
    /// `Idempotency-Key`, as of [`Spec`]: the same key again means the same job.
    pub key: Option<String>,
    /// Who asks: clients share the device evenly.
    pub client: String,
    /// Whether the job is to end with the request that waits for it.
    pub attended: bool,
    /// Renders that this client may have on one day.
    pub quota: Option<u64>,
    /// Whether to render even if the same picture was made before.
    pub anew: bool,
    /// Format in which whoever waits wants the picture; none: nobody waits, or that of the parameters.
    pub format: Option<ImageFormat>,
    /// Address that is told of the job's end.
    pub webhook: Option<String>,
}

impl Submission {
    /// A plain one.
    pub fn new(order: Order, client: String) -> Self {
        Self {
            order,
            id: None,
            key: None,
            client,
            attended: false,
            quota: None,
            anew: false,
            format: None,
            webhook: None,
        }
    }
}

/// What is known of a request before its scene is looked up.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    /// As of [`Submission`].
    pub id: Option<&'a str>,
    /// As of [`Submission`].
    pub key: Option<&'a str>,
    /// As of [`Submission`].
    pub anew: bool,
    /// Id of the scene.
    pub scene: &'a str,
    /// Parameters.
    pub params: &'a RenderParams,
    /// As of [`Order`].
    pub priority: i32,
    /// As of [`Submission`].
    pub webhook: Option<&'a str>,
}

impl Asked<'_> {
    /// A job that is there already, unless it is another one than is asked for.
    fn for_it(&self, job: Arc<Job>) -> Result<Arc<Job>, Problem> {
        let Spec { id, scene, params, priority, webhook, .. } = job.spec.as_ref();
        if (scene.as_str(), params, *priority, webhook.as_deref())
            == (self.scene, self.params, self.priority, self.webhook)
        {
            return Ok(job);
        }
        Err(if self.id.is_some() {
            let detail = format!("the job `{id}` asks for something else: choose another id");
            Problem::new(Code::JobConflict, detail)
        } else {
            let detail = format!("this Idempotency-Key began `{id}`, which asks for something else");
            Problem::new(Code::IdempotencyMismatch, detail)
        })
    }
}

impl Service {
    /// The job that was asked for before, by its id or idempotency key, as it stands. Neither its scene, nor a place in the queue, nor
    /// a quota is needed for it.
    ///
    /// # Errors
    /// It asks for something else, or is not in the ledger yet, which takes nothing at present.
    pub async fn known(&self, asked: &Asked<'_>) -> Result<Option<Arc<Job>>, Problem> {
        let Some(job) = self.core.table.known(asked.id, asked.key) else { return Ok(None) };
        asked.for_it(job)?.settled().await?;
        // It may have been withdrawn meanwhile.
        Ok(self.core.table.known(asked.id, asked.key))
    }

    /// Accepts a job once the ledger has it, or refuses it at once. A job that is there already is handed out again.
    pub async fn submit(&self, submission: Submission) -> Result<Arc<Job>, Problem> {
        self.refuse_when_draining()?;
        let Submission { order, id, key, client, attended, quota, anew, format, webhook } = submission;
        self.check(&order.params, order.priority)?;
        self.check_webhook(webhook.as_deref())?;
        let image = order.hdri.as_ref().map(|image| image.id.clone());
        let spec = Spec {
            number: 0,
            id: id.unwrap_or_default(),
            key,
            created: now(),
            scene: order.scene.id.clone(),
            content: content(&order.scene.id, image.as_deref(), &order.params),
            image,
            params: order.params.clone(),
            priority: order.priority,
            client: client.clone(),
            attended,
            place: None,
            webhook,
        };
        let ledger = &self.core.storage.ledger;
        let shares = self.core.limits.result_cache && !anew && self.can_give(&spec, format);
        let admission = self.core.table.admit(spec.clone(), shares, |spec| {
            let taken = self.core.usage.take(&client, 1, quota)?;
            let (job, change) = Job::new(spec, ledger.clone(), Arc::clone(&self.core.meters));
            Ok((job, (ledger.commit(change), taken)))
        });
        match admission? {
            Admission::New(job, (sent, taken)) => {
                self.accept(&job, sent, order, shares).await?;
                taken.keep();
                Ok(job)
            }
            Admission::Known(job) => {
                let Spec { id, key, scene, params, priority, webhook, .. } = &spec;
                let id = Some(id.as_str()).filter(|id| !id.is_empty());
                let (key, webhook) = (key.as_deref(), webhook.as_deref());
                let job = Asked { id, key, anew, scene, params, priority: *priority, webhook }.for_it(job)?;
                job.settled().await?;
                Ok(job)
            }
            Admission::Full(_) => Err(self.queue_full()),
        }
    }

    /// Refuses what [`Service::submit`] would refuse for want of a place, before anything is looked up or imported for it:
    /// whoever asks too much costs as little as can be.
    ///
    /// # Errors
    /// The queue is full, and no result of what is asked for is at hand.
    pub fn refuse_when_full(&self, asked: &Asked<'_>) -> Result<(), Problem> {
        let &Asked { anew, scene, params, .. } = asked;
        // The name of an environment is its id, unless it came as a file of the same form, which no result can have used.
        let shares = self.core.limits.result_cache && !anew;
        let content = shares.then(|| content(scene, params.hdri_name(), params));
        if self.core.table.refuses(content.as_deref()) { Err(self.queue_full()) } else { Ok(()) }
    }

    /// Refuses what is new in every respect while the queue is full.
    pub(super) fn refuse_without_a_place(&self) -> Result<(), Problem> {
        if self.core.table.refuses(None) { Err(self.queue_full()) } else { Ok(()) }
    }

    fn queue_full(&self) -> Problem {
        let detail = format!("{} jobs are waiting already; try again later", self.core.limits.queue_length);
        Problem::new(Code::QueueFull, detail).retry_after(RETRY_SECONDS)
    }

    /// Waits for the ledger, then begins the work.
    async fn accept(
        &self,
        job: &Arc<Job>,
        sent: impl Future<Output = Result<(), LedgerError>>,
        order: Order,
        shares: bool,
    ) -> Result<(), Problem> {
        match self.core.storage.accepted(sent).await {
            Ok(true) => {
                let Spec { id, client, scene, .. } = job.spec.as_ref();
                tracing::info!(job = %id, %client, %scene, "job accepted");
                self.core.meters.accepted.inc();
                job.events.publish(1);
            }
            Ok(false) => {
                self.core.table.forget(&[job.spec.number], &[]);
                let detail =
                    format!("the scene `{}` or its image has just been forgotten: upload it again", job.spec.scene);
                return Err(Problem::new(Code::SceneNotFound, detail));
            }
            Err(problem) => {
                let leaving = Leaving { jobs: vec![job.spec.number], ..Leaving::default() };
                self.withdraw(std::slice::from_ref(job), leaving);
                return Err(problem);
            }
        }
        if !(shares && self.serve_from_cache(job).await) {
            tokio::spawn(self.clone().compile(Arc::clone(job), order, None));
        }
        Ok(())
    }

    /// Takes back jobs that the ledger did not take in time, with their ids and keys: the client was told that they were refused. If it takes
    /// them after all, they end and leave at once.
    pub(super) fn withdraw(&self, jobs: &[Arc<Job>], leaving: Leaving) {
        for job in jobs {
            job.cancel();
        }
        self.core.table.forget(&leaving.jobs, &leaving.batches);
        self.core.storage.ledger.record(Change::Forget(leaving), || {});
    }

    /// Whether results of others, if there are any, can be given in a format.
    fn can_give(&self, spec: &Spec, format: Option<ImageFormat>) -> bool {
        let is_linear = |job: &Job| job.outcome().is_some_and(|outcome| outcome.picture.is_some());
        let is_its_own = format.is_none_or(|format| format == spec.params.output.format);
        is_its_own || self.core.table.result_of(&spec.content).is_none_or(|other| is_linear(&other))
    }

    /// Ends a job with the result of another that asked for the same; false if there is none.
    pub(super) async fn serve_from_cache(&self, job: &Job) -> bool {
        let Some(other) = self.core.table.result_of(&job.spec.content) else { return false };
        let served = self.core.storage.succeed_with(job, &other).await;
        if served {
            self.core.meters.cached.inc();
            self.core.tidy.notify_one();
        }
        served
    }

    /// Whether webhooks are sent, and to that address.
    pub(super) fn check_webhook(&self, url: Option<&str>) -> Result<(), Problem> {
        match (url, self.core.webhooks.get()) {
            (None, _) => Ok(()),
            (Some(url), Some(webhooks)) => webhooks.check(url),
            (Some(_), None) => {
                let detail = "this server sends no webhooks (--webhook-secret): follow the job's events instead";
                Err(Problem::fields(Code::InvalidParams, vec![FieldError::new("/webhook", detail)]))
            }
        }
    }

    pub(super) fn refuse_when_draining(&self) -> Result<(), Problem> {
        if !self.is_draining() {
            return Ok(());
        }
        let detail = "the server is shutting down and takes no new jobs";
        Err(Problem::new(Code::ShuttingDown, detail).retry_after(RETRY_SECONDS))
    }

    /// Whether an order is valid and within the limits.
    pub(super) fn check(&self, params: &RenderParams, priority: i32) -> Result<(), Problem> {
        let invalid = |faults| Problem::fields(Code::InvalidParams, faults);
        params.validate(&self.core.limits.params()).map_err(invalid)?;
        if !(-100..=100).contains(&priority) {
            let detail = format!("must lie between -100 and 100, and is {priority}");
            return Err(invalid(vec![FieldError { pointer: "/priority".to_owned(), detail }]));
        }
        if params.denoise && self.denoiser().is_none() {
            let detail = format!(
                "this server has no Open Image Denoise: leave it out, and smooth the picture yourself if it must be; for whoever runs the \
                 server, {HOW_TO_GET_IT}"
            );
            return Err(Problem::fields(Code::DenoiserMissing, vec![FieldError::new("/params/denoise", detail)]));
        }
        let (bytes, limit) =
            (film_bytes(params.width, params.height, params.groups()), self.core.limits.job_memory_bytes);
        if bytes > limit {
            let detail = format!("the picture needs {bytes} bytes of memory, more than the {limit} allowed here");
            let fault = FieldError { pointer: "/params/width".to_owned(), detail };
            return Err(Problem::fields(Code::LimitExceeded, vec![fault]));
        }
        Ok(())
    }
}

/// Id of all that a picture depends on: scene, image, parameters and the version of the renderer.
pub(super) fn content(scene: &str, image: Option<&str>, params: &RenderParams) -> String {
    let all = serde_json::json!([scene, image, params, ENGINE_VERSION]);
    content_id(all.to_string().as_bytes())
}
