//! Pictures of finished jobs, in the formats that clients ask for.

use super::Service;
use super::finish;
use super::job::Job;
use super::outcome::{Developed, Encoded};
use super::problem::{Code, Problem};
use super::state::State;
use crate::film::Aov;
use crate::params::ImageFormat;
use std::sync::Arc;

impl Service {
    /// The picture of a job in a format.
    pub async fn result(&self, job: &Job, format: ImageFormat) -> Result<Encoded, Problem> {
        let outcome = job.outcome().ok_or_else(|| no_result(job))?;
        if job.spec.params.output.format == format {
            let bytes = self.core.storage.get(&outcome.file.id).await?;
            return Ok(Encoded { bytes, format, etag: format!("\"{}\"", outcome.file.id) });
        }
        let (developed, spec) = (self.core.storage.get(&outcome.picture.id).await?, Arc::clone(&job.spec));
        self.at_desk(move || {
            let developed = Developed::from_bytes(&developed).ok_or_else(old_result)?;
            finish::encode(&developed.picture, &spec.params, format, &outcome.record.facts)
        })
        .await
    }

    /// What is known of each pixel of a job's picture, as EXR.
    pub async fn aov(&self, job: &Job, aov: Aov) -> Result<Encoded, Problem> {
        let outcome = job.outcome().ok_or_else(|| no_result(job))?;
        let developed = self.core.storage.get(&outcome.picture.id).await?;
        self.at_desk(move || {
            let developed = Developed::from_bytes(&developed).ok_or_else(old_result)?;
            finish::encode_aov(&developed, aov, &outcome.record)
        })
        .await
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

fn old_result() -> Problem {
    let detail = "another version of the server made this result, and can no longer be read but in its own format";
    Problem::new(Code::NotAcceptable, detail)
}
