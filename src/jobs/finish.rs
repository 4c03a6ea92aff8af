//! From the film of an ended render to its file and its report; runs away from the device's thread.

use super::job::Job;
use super::memory::Claim;
use super::outcome::{Developed, Encoded, Record};
use super::problem::{Code, Problem};
use super::progress::seconds;
use super::scenes::content_id;
use super::worker::Shared;
use crate::film::{self, Aov, EncodeError, Film, Guides, Picture};
use crate::params::{ImageFormat, RenderParams};
use crate::render::denoised::{Denoising, denoised};
use crate::render::prepare::Prepared;
use crate::render::report::{Report, Stages};
use crate::render::{DeviceInfo, NonFinite, StopReason};
use crate::scene::Warning;
use bytes::Bytes;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Pause before a result that could not be stored is stored again.
const RETRY: Duration = Duration::from_millis(500);

/// A render that ended with a film.
pub(super) struct Ended {
    pub job: Arc<Job>,
    pub prepared: Prepared,
    pub film: Film,
    /// What guides a denoiser, if it is to be.
    pub guides: Option<Guides>,
    pub reason: StopReason,
    pub device: DeviceInfo,
    pub stages: Stages,
    pub non_finite: NonFinite,
    /// The server's limit on the time ended it, not the request.
    pub cut_by_server: bool,
    /// Memory of all this.
    pub claim: Claim,
}

/// Makes the file, stores it and ends the job.
pub(super) fn finish(ended: Ended, shared: &Shared) {
    let job = Arc::clone(&ended.job);
    let _span = tracing::info_span!(parent: &job.span(), "encode").entered();
    let made = catch_unwind(AssertUnwindSafe(|| make(ended, shared))).unwrap_or_else(|_| {
        Err(Problem::new(Code::Internal, "the picture could not be made by a fault of the server"))
    });
    let stored = made.and_then(|made| store(&made, &job, shared));
    match stored {
        Ok(_) => {
            if let Some(outcome) = job.outcome() {
                let params = &job.spec.params;
                shared.meters.rendered(&outcome.record, u64::from(params.width) * u64::from(params.height));
                if outcome.record.repeatable {
                    shared.table.share_result(&job);
                }
            }
        }
        Err(problem) => {
            job.fail(problem);
        }
    }
    shared.tidy.notify_one();
}

/// Stores a result and ends its job with it, however long there is no room for it; a server that ends leaves it to the next one.
fn store(made: &Made, job: &Job, shared: &Shared) -> Result<bool, Problem> {
    loop {
        let storing = shared.storage.succeed(job, made.record.clone(), made.file.clone(), &made.developed);
        match shared.runtime.block_on(storing) {
            Err(problem) if problem.is(Code::StorageUnavailable) && !job.is_over() => {
                if *shared.closed.borrow() {
                    return Ok(false);
                }
                std::thread::sleep(RETRY);
            }
            stored => return stored,
        }
    }
}

/// What is to be stored.
struct Made {
    record: Record,
    file: Bytes,
    developed: Developed,
    /// Memory that is free again once this is gone.
    _claim: Claim,
}

fn make(ended: Ended, shared: &Shared) -> Result<Made, Problem> {
    let begun = Instant::now();
    let Ended { job, prepared, film, guides, reason, device, stages, non_finite, cut_by_server, claim } = ended;
    let mut developed = Developed { picture: film.picture(), aovs: film.aovs() };
    let error = film.error();
    let (samples_min, samples_max) = film.samples_range();
    let params = &job.spec.params;
    let mut report = Report {
        samples: film.samples(),
        samples_min,
        samples_max,
        adaptive: prepared.work.settings.adaptive,
        error: error.map(|error| error.relative_rms),
        error_bound_95: error.map(|error| error.upper_bound_95),
        denoised: None,
        seed: params.seed,
        engine: device.engine,
        device,
        stop_reason: reason,
        seconds: stages,
        biases: prepared.biases,
        defaults: prepared.defaults,
        warnings: prepared.warnings,
        non_finite,
        scene: prepared.work.scene.stats.clone(),
    };
    drop((film, prepared.work));
    if cut_by_server {
        report.warnings.push(Warning {
            code: "render_time_limit",
            pointer: "/params/max_samples".to_owned(),
            detail: "the render was stopped at the server's limit of time (GET /v1/limits, render_seconds)".to_owned(),
        });
    }
    if params.denoise {
        let denoising = Denoising { denoiser: shared.denoiser.get(), guides, wanted: &|| !job.is_over() };
        developed.picture = denoised(denoising, developed.picture, &mut developed.aovs, &mut report);
    }
    let file = encode(&developed.picture, params, params.output.format, &report.facts())?;
    report.seconds.encode = seconds(begun.elapsed()) - report.seconds.denoise;
    Ok(Made { record: Record::new(&report), file: file.bytes, developed, _claim: claim })
}

/// Encodes a picture and hashes the file.
pub(super) fn encode(
    picture: &Picture,
    params: &RenderParams,
    format: ImageFormat,
    facts: &[(String, String)],
) -> Result<Encoded, Problem> {
    encoded(film::encode(picture, params, format, facts), format)
}

/// Encodes what is known of each pixel and hashes the file.
pub(super) fn encode_aov(developed: &Developed, aov: Aov, record: &Record) -> Result<Encoded, Problem> {
    let bytes = film::encode_aov(&developed.aovs, aov, &record.facts).ok_or_else(|| {
        let lack = aov.lack(1, false, false).unwrap_or_default();
        Problem::new(Code::NotAcceptable, format!("this result has no {}: {lack}", aov.name()))
    })?;
    encoded(bytes, ImageFormat::Exr)
}

fn encoded(bytes: Result<Vec<u8>, EncodeError>, format: ImageFormat) -> Result<Encoded, Problem> {
    let bytes = bytes.map_err(|error| match error {
        EncodeError::Unsupported(detail) => Problem::new(Code::NotAcceptable, detail),
        EncodeError::Failed(detail) => Problem::new(Code::Internal, detail),
    })?;
    Ok(Encoded { etag: format!("\"{}\"", content_id(&bytes)), bytes: bytes.into(), format })
}
