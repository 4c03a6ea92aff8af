//! Jobs and batches that their clients want forgotten.

use super::Service;
use super::batch::Batch;
use super::job::Job;
use super::ledger::Leaving;
use super::problem::{Code, Problem};

impl Service {
    /// Ends a job, if it is not over, and forgets it with its result. A result that other jobs share stays with them.
    ///
    /// # Errors
    /// It belongs to a batch.
    pub async fn remove_job(&self, job: &Job) -> Result<(), Problem> {
        if job.spec.place.is_some() {
            let detail = "this job belongs to a batch, whose jobs are kept and forgotten together: delete the batch";
            return Err(Problem::new(Code::JobConflict, detail));
        }
        self.cancel(job).await?;
        self.forget(Leaving { jobs: vec![job.spec.number], ..Leaving::default() }).await
    }

    /// Ends what is not over of a batch and forgets it with its jobs and their results.
    ///
    /// # Errors
    /// The ledger is at fault.
    pub async fn remove_batch(&self, batch: &Batch) -> Result<(), Problem> {
        self.cancel_batch(batch).await?;
        let jobs = batch.jobs.iter().map(|job| job.spec.number).collect();
        self.forget(Leaving { jobs, batches: vec![batch.spec.number], ..Leaving::default() }).await
    }

    async fn forget(&self, leaving: Leaving) -> Result<(), Problem> {
        self.core.storage.forget(&leaving).await?;
        self.core.table.forget(&leaving.jobs, &leaving.batches);
        // Blobs that nothing names any more leave then.
        self.core.tidy.notify_one();
        Ok(())
    }
}
