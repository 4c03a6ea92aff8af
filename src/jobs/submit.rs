//! How a request becomes a job: checked, admitted, in the ledger, and only then told.

use super::job::{Job, Order, Spec};
use super::ledger::{LedgerError, now};
use super::memory::film_bytes;
use super::problem::{Code, Problem};
use super::saved::ENGINE_VERSION;
use super::scenes::content_id;
use super::table::Admission;
use super::{RETRY_SECONDS, Service};
use crate::params::FieldError;
use std::sync::Arc;

/// An order, and how it was given.
#[derive(Debug, Clone)]
pub struct Submission {
    /// What to render.
    pub order: Order,
    /// Id that the client has chosen; none: the server chooses.
    pub id: Option<String>,
    /// `Idempotency-Key`: the same key again means the same job.
    pub key: Option<String>,
    /// Who asks: clients share the device evenly.
    pub client: String,
    /// Whether the job is to end with the request that waits for it.
    pub attended: bool,
    /// Whether to render even if the same picture was made before.
    pub anew: bool,
}

impl Submission {
    /// A plain one.
    pub fn new(order: Order, client: String) -> Self {
        Self { order, id: None, key: None, client, attended: false, anew: false }
    }
}

impl Service {
    /// Accepts a job once the ledger has it, or refuses it at once. A job that is there already is handed out again.
    pub async fn submit(&self, submission: Submission) -> Result<Arc<Job>, Problem> {
        if self.is_draining() {
            let detail = "the server is shutting down and takes no new jobs";
            return Err(Problem::new(Code::ShuttingDown, detail).retry_after(RETRY_SECONDS));
        }
        let Submission { order, id, key, client, attended, anew } = submission;
        self.check(&order)?;
        let spec = Spec {
            number: 0,
            id: id.unwrap_or_default(),
            key,
            created: now(),
            scene: order.scene.id.clone(),
            image: order.hdri.as_ref().map(|image| image.id.clone()),
            params: order.params.clone(),
            priority: order.priority,
            client,
            attended,
            content: content(&order),
        };
        let ledger = &self.core.storage.ledger;
        let shares = self.core.limits.result_cache && !anew;
        let admission = self.core.table.admit(spec.clone(), shares, |spec| {
            let (job, change) = Job::new(spec, ledger.clone(), Arc::clone(&self.core.meters));
            (job, ledger.commit(change))
        });
        match admission {
            Admission::New(job, sent) => {
                self.accept(&job, sent, order, shares).await?;
                Ok(job)
            }
            Admission::SameId(job) if job.spec.asks_the_same(&spec) => Ok(job),
            Admission::SameKey(job) if job.spec.asks_the_same(&spec) => Ok(job),
            Admission::SameId(job) => {
                let detail = format!("the job `{}` asks for something else: choose another id", job.spec.id);
                Err(Problem::new(Code::JobConflict, detail))
            }
            Admission::SameKey(job) => {
                let detail = format!("this Idempotency-Key began `{}`, which asks for something else", job.spec.id);
                Err(Problem::new(Code::IdempotencyMismatch, detail))
            }
            Admission::Full => {
                let detail = format!("{} jobs are waiting already; try again later", self.core.limits.queue_length);
                Err(Problem::new(Code::QueueFull, detail).retry_after(RETRY_SECONDS))
            }
        }
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
                self.core.table.forget(&[job.spec.number]);
                let detail =
                    format!("the scene `{}` or its image has just been forgotten: upload it again", job.spec.scene);
                return Err(Problem::new(Code::SceneNotFound, detail));
            }
            Err(problem) => {
                // If the ledger takes it after all, it ends at once.
                job.cancel();
                return Err(problem);
            }
        }
        if shares
            && let Some(other) = self.core.table.result_of(&job.spec.content)
            && self.core.storage.succeed_with(job, &other).await
        {
            self.core.meters.cached.inc();
            self.core.tidy.notify_one();
            return Ok(());
        }
        tokio::spawn(self.clone().compile(Arc::clone(job), order, None));
        Ok(())
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
}

/// Id of all that a picture depends on: scene, image, parameters and the version of the renderer.
fn content(order: &Order) -> String {
    let image = order.hdri.as_ref().map(|image| &image.id);
    let all = serde_json::json!([order.scene.id, image, order.params, ENGINE_VERSION]);
    content_id(all.to_string().as_bytes())
}
