//! `/v1/jobs`: renders that outlive the request that began them.

use super::scenes::Page;
use super::{App, accept, picture, scenes, upload};
use crate::film::Aov;
use crate::jobs::{Code, Job, Order, Problem, Stages, State as JobState};
use crate::params::{self, FieldError, ImageFormat};
use axum::Json;
use axum::extract::{Path, Query, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;

/// Body of `POST /v1/jobs`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct NewJob {
    scene: String,
    #[serde(default)]
    params: Option<Value>,
    #[serde(default)]
    priority: i32,
}

/// `POST /v1/jobs`
pub async fn create(State(app): State<App>, headers: HeaderMap, request: Request) -> Result<Response, Problem> {
    let order = read_order(&app, request).await?;
    let job = app.service.submit(order)?;
    let longest = Duration::from_secs(app.service.limits().wait_seconds);
    if let Some(patience) = accept::wait(&headers, longest) {
        let in_time = tokio::time::timeout(patience, job.finished()).await.is_ok();
        if in_time {
            return finished(&app, &job, &headers).await;
        }
    }
    let location = HeaderValue::try_from(format!("/v1/jobs/{}", job.id)).map(|value| [(header::LOCATION, value)]);
    Ok((StatusCode::ACCEPTED, location.ok(), Json(app.service.describe(&job))).into_response())
}

async fn read_order(app: &App, request: Request) -> Result<Order, Problem> {
    let body = upload::read_json(app, request).await?;
    let new: NewJob = serde_path_to_error::deserialize(body).map_err(|error| {
        let path = error.path().to_string();
        let pointer = if path == "." { String::new() } else { format!("/{}", path.replace('.', "/")) };
        Problem::fields(Code::InvalidParams, vec![FieldError::new(pointer, error.into_inner().to_string())])
    })?;
    let text = new.params.map_or_else(|| "{}".to_owned(), |params| params.to_string());
    let params = params::from_json(&text).map_err(|faults| Problem::fields(Code::InvalidParams, faults))?;
    let scene = app.service.scenes().get(&new.scene).ok_or_else(|| Problem {
        errors: vec![FieldError::new("/scene", "unknown scene")],
        ..scenes::unknown(&new.scene)
    })?;
    let hdri = app.service.stored_hdri(&params)?;
    Ok(Order { scene, hdri, params, priority: new.priority, stages: Stages::default() })
}

/// The reply to a request that waited for its job: the picture, or why there is none.
pub async fn finished(app: &App, job: &Job, headers: &HeaderMap) -> Result<Response, Problem> {
    if let Some(problem) = job.problem() {
        return Err(problem);
    }
    let format = accept::picture_format(headers, job.params.output.format)?;
    let file = app.service.result(job, format).await?;
    Ok(picture::reply(job, &file, headers))
}

/// `GET /v1/jobs`
pub async fn list(State(app): State<App>, Query(page): Query<Page>) -> Result<Json<Value>, Problem> {
    let (jobs, more) = app.service.jobs(page.cursor.as_deref(), page.count()?);
    let next = jobs.last().filter(|_| more).map(|job| job.id.clone());
    let items: Vec<_> = jobs.iter().map(|job| app.service.describe(job)).collect();
    Ok(Json(json!({ "items": items, "next": next })))
}

/// `GET /v1/jobs/{id}`
pub async fn show(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Value>, Problem> {
    let job = app.service.job(&id)?;
    Ok(Json(app.service.describe(&job)))
}

/// `GET /v1/jobs/{id}/preview`: the newest picture so far; of a finished job, its result.
pub async fn preview(State(app): State<App>, Path(id): Path<String>, headers: HeaderMap) -> Result<Response, Problem> {
    let job = app.service.job(&id)?;
    if job.state() == JobState::Succeeded {
        return finished(&app, &job, &headers).await;
    }
    let preview = job.preview().ok_or_else(|| {
        Problem::new(
            Code::NoPreview,
            "no picture of this job has been made yet; the event `preview` tells when there is one",
        )
    })?;
    let number = HeaderValue::from(preview.number);
    let head = [
        (header::CONTENT_TYPE, HeaderValue::from_static(accept::media_type(preview.file.format))),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
        (HeaderName::from_static("candela-preview"), number),
    ];
    Ok((head, preview.file.bytes.to_vec()).into_response())
}

/// Query of `GET /v1/jobs/{id}/result`.
#[derive(Debug, Deserialize)]
pub struct Wanted {
    /// Name of an AOV; none: the picture.
    aov: Option<String>,
}

/// `GET /v1/jobs/{id}/result`
pub async fn result(
    State(app): State<App>,
    Path(id): Path<String>,
    Query(wanted): Query<Wanted>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = app.service.job(&id)?;
    let Some(name) = wanted.aov else {
        let format = accept::picture_format(&headers, job.params.output.format)?;
        return Ok(picture::reply(&job, &app.service.result(&job, format).await?, &headers));
    };
    let unknown = |fault| Problem::fields(Code::InvalidParams, vec![FieldError::new("/aov", fault)]);
    let aov = Aov::from_name(&name).map_err(unknown)?;
    if accept::picture_format(&headers, ImageFormat::Exr)? != ImageFormat::Exr {
        let detail = format!("{name} is no picture to look at and comes as image/x-exr only; ask for that in `Accept`");
        return Err(Problem::new(Code::NotAcceptable, detail));
    }
    Ok(picture::reply(&job, &app.service.aov(&job, aov).await?, &headers))
}

/// `POST /v1/jobs/{id}/cancel`: 200 however often; 409 if the job had ended otherwise.
pub async fn cancel(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Value>, Problem> {
    let job = app.service.job(&id)?;
    app.service.cancel(&job)?;
    Ok(Json(app.service.describe(&job)))
}

/// Cancels a job when the client that waits for it goes away.
pub struct Waiting {
    /// For cancelling.
    pub app: App,
    /// The job waited for.
    pub job: Arc<Job>,
}

impl Drop for Waiting {
    fn drop(&mut self) {
        // A job that is over stays as it is.
        let _ = self.app.service.cancel(&self.job);
    }
}
