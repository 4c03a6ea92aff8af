//! Pictures of finished jobs, in the formats that clients ask for.

use super::Service;
use super::finish;
use super::job::Job;
use super::outcome::{Developed, Encoded, Outcome};
use super::problem::{Code, Problem};
use super::state::State;
use crate::film::Aov;
use crate::params::ImageFormat;
use bytes::Bytes;
use std::sync::Arc;

impl Service {
    /// The picture of a job in a format.
    pub async fn result(&self, job: &Job, format: ImageFormat) -> Result<Encoded, Problem> {
        let outcome = job.outcome().ok_or_else(|| no_result(job))?;
        if job.spec.params.output.format == format {
            let bytes = self.core.storage.get(&outcome.file.id).await?;
            return Ok(Encoded { bytes, format, etag: format!("\"{}\"", outcome.file.id) });
        }
        let (developed, spec) = (self.developed(job, &outcome).await?, Arc::clone(&job.spec));
        self.at_desk(move || {
            let developed = Developed::from_bytes(&developed).ok_or_else(old_result)?;
            finish::encode(&developed.picture, &spec.params, format, &outcome.record.facts)
        })
        .await
    }

    /// What is known of each pixel of a job's picture, as EXR.
    pub async fn aov(&self, job: &Job, aov: Aov) -> Result<Encoded, Problem> {
        let outcome = job.outcome().ok_or_else(|| no_result(job))?;
        let developed = self.developed(job, &outcome).await?;
        self.at_desk(move || {
            let developed = Developed::from_bytes(&developed).ok_or_else(old_result)?;
            finish::encode_aov(&developed, aov, &outcome.record)
        })
        .await
    }

    /// The linear picture of a job as it is stored.
    async fn developed(&self, job: &Job, outcome: &Outcome) -> Result<Bytes, Problem> {
        let picture = outcome.picture.as_ref().ok_or_else(|| picture_gone(job))?;
        let read = self.core.storage.get(&picture.id).await;
        // It may have left between the two.
        let has_left = || job.outcome().is_none_or(|outcome| outcome.picture.is_none());
        read.map_err(|problem| if has_left() { picture_gone(job) } else { problem })
    }
}

fn picture_gone(job: &Job) -> Problem {
    let format = job.spec.params.output.format.extension();
    let detail = format!(
        "the linear picture of this job, from which other formats and AOVs are made, has left to make room (GET /v1/limits, \
         kept_result_bytes); its own file ({format}) is still here. For another format ask for a new job with that `output.format`; for \
         all of them repeat the job with `Cache-Control: no-cache`"
    );
    Problem::new(Code::LinearPictureGone, detail)
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
