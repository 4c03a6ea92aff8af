//! `/v1/jobs`: renders that outlive the request that began them.

use super::scenes::{Page, bad_cursor};
use super::{App, accept, picture, query, scenes, upload};
use crate::film::Aov;
use crate::jobs::{Code, Job, Order, Problem, Stages, State as JobState};
use crate::params::{self, FieldError, ImageFormat};
use axum::Json;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header};
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
    let [] = query::fields(request.uri(), [])?;
    let order = read_order(&app, request).await?;
    let longest = Duration::from_secs(app.service.limits().wait_seconds);
    let Some(patience) = accept::wait(&headers, longest) else {
        let job = app.service.submit(order)?;
        return Ok(accepted(&app, &job));
    };
    // A format that cannot be made is refused before the work, not after it.
    accept::picture_format(&headers, order.params.output.format)?;
    let job = app.service.submit(order)?;
    let in_time = tokio::time::timeout(patience, job.finished()).await.is_ok();
    let mut reply = if in_time { finished(&app, &job, &headers).await? } else { accepted(&app, &job) };
    if let Ok(applied) = HeaderValue::try_from(format!("wait={}", patience.as_secs())) {
        reply.headers_mut().insert("preference-applied", applied);
    }
    Ok(reply)
}

/// 202 with the job as it stands.
fn accepted(app: &App, job: &Job) -> Response {
    let location = HeaderValue::try_from(format!("/v1/jobs/{}", job.id)).map(|value| [(header::LOCATION, value)]);
    (StatusCode::ACCEPTED, location.ok(), Json(app.service.describe(job))).into_response()
}

async fn read_order(app: &App, request: Request) -> Result<Order, Problem> {
    let body = upload::read_json(app, request).await?;
    let new: NewJob = params::read(&body).map_err(|fault| Problem::fields(Code::InvalidParams, vec![fault]))?;
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
pub async fn list(State(app): State<App>, uri: Uri) -> Result<Json<Value>, Problem> {
    let page = Page::read(&uri)?;
    if page.cursor.as_ref().is_some_and(|cursor| app.service.job(cursor).is_err()) {
        return Err(bad_cursor("there is no such job, or it has been forgotten since"));
    }
    let (jobs, more) = app.service.jobs(page.cursor.as_deref(), page.count);
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

/// `GET /v1/jobs/{id}/result`, or one of its AOVs.
pub async fn result(
    State(app): State<App>,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = app.service.job(&id)?;
    let [aov] = query::fields(&uri, ["aov"])?;
    let Some(name) = aov else {
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
