//! `/v1/jobs`: renders that outlive the request that began them.

use super::scenes::{Page, bad_cursor};
use super::{App, accept, caller, picture, query, scenes, upload};
use crate::film::Aov;
use crate::jobs::{Code, Images, Job, Order, Problem, Stages, State as JobState, Submission};
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
    #[serde(default)]
    webhook: Option<Webhook>,
}

/// Who is to be told of a job's end.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Webhook {
    url: String,
}

/// `POST /v1/jobs`
pub async fn create(State(app): State<App>, headers: HeaderMap, request: Request) -> Result<Response, Problem> {
    let key = idempotency_key(&headers)?;
    begin(app, None, key, &headers, request).await
}

/// `PUT /v1/jobs/{id}`: the client chooses the id, and may ask again as often as it likes.
pub async fn create_named(
    State(app): State<App>,
    Path(id): Path<String>,
    headers: HeaderMap,
    request: Request,
) -> Result<Response, Problem> {
    let plain = id.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.'));
    if id.len() > 64 || !plain || id.starts_with("job-") || !id.starts_with(|c: char| c.is_ascii_alphanumeric()) {
        let detail = "must be 1 to 64 letters, digits, `-`, `_` or `.`, beginning with a letter or a digit and not with \
                      `job-`, as the ids of the server do";
        return Err(Problem::fields(Code::InvalidParams, vec![FieldError::new("/id", detail)]));
    }
    begin(app, Some(id), None, &headers, request).await
}

async fn begin(
    app: App,
    id: Option<String>,
    key: Option<String>,
    headers: &HeaderMap,
    request: Request,
) -> Result<Response, Problem> {
    let [] = query::fields(request.uri(), [])?;
    let caller = caller(&request);
    let (order, webhook) = read_order(&app, request).await?;
    let webhook = webhook.map(|webhook| webhook.url);
    let longest = Duration::from_secs(app.service.limits().wait_seconds);
    let patience = accept::wait(headers, longest);
    if patience.is_some() {
        // A format that cannot be made is refused before the work, not after it.
        accept::picture_format(headers, order.params.output.format)?;
    }
    let (anew, quota) = (wants_anew(headers), caller.renders_per_day);
    let submission = Submission { id, key, anew, quota, webhook, ..Submission::new(order, caller.client) };
    let job = app.service.submit(submission).await?;
    job.settled().await;
    let Some(patience) = patience else { return Ok(accepted(&app, &job)) };
    let mut closed = app.service.closed();
    let in_time = tokio::select! {
        in_time = tokio::time::timeout(patience, job.finished()) => in_time.is_ok(),
        _ = closed.wait_for(|closed| *closed) => false,
    };
    let mut reply = if in_time { finished(&app, &job, headers).await? } else { accepted(&app, &job) };
    if let Ok(applied) = HeaderValue::try_from(format!("wait={}", patience.as_secs())) {
        reply.headers_mut().insert("preference-applied", applied);
    }
    Ok(reply)
}

/// `Idempotency-Key`: any text of up to 255 visible characters.
pub fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    let key = value.to_str().ok().filter(|key| (1..=255).contains(&key.len()));
    let fault = || Problem::new(Code::BadRequest, "`Idempotency-Key` must be 1 to 255 visible ASCII characters");
    key.map(|key| Some(key.to_owned())).ok_or_else(fault)
}

/// Whether the client wants no result that was made before (`Cache-Control: no-cache`).
pub fn wants_anew(headers: &HeaderMap) -> bool {
    let lines = headers.get_all(header::CACHE_CONTROL).iter().filter_map(|value| value.to_str().ok());
    lines.flat_map(|line| line.split(',')).any(|part| part.trim().eq_ignore_ascii_case("no-cache"))
}

/// 202 with the job as it stands.
fn accepted(app: &App, job: &Job) -> Response {
    let location = HeaderValue::try_from(format!("/v1/jobs/{}", job.spec.id)).map(|value| [(header::LOCATION, value)]);
    (StatusCode::ACCEPTED, location.ok(), Json(app.service.describe(job))).into_response()
}

async fn read_order(app: &App, request: Request) -> Result<(Order, Option<Webhook>), Problem> {
    let body = upload::read_json(app, request).await?;
    let new: NewJob = params::read(&body).map_err(|fault| Problem::fields(Code::InvalidParams, vec![fault]))?;
    let text = new.params.map_or_else(|| "{}".to_owned(), |params| params.to_string());
    let mut params = params::from_json(&text).map_err(|faults| Problem::fields(Code::InvalidParams, faults))?;
    let scene = app.service.scene(&new.scene).await?.ok_or_else(|| Problem {
        errors: vec![FieldError::new("/scene", "unknown scene")],
        ..scenes::unknown(&new.scene)
    })?;
    let Images { environment: hdri, maps } = app.service.take_images(&mut params, &mut Vec::new()).await?;
    Ok((Order { scene, hdri, maps, params, priority: new.priority, stages: Stages::default() }, new.webhook))
}

/// The reply to a request that waited for its job: the picture, or why there is none.
pub async fn finished(app: &App, job: &Job, headers: &HeaderMap) -> Result<Response, Problem> {
    if let Some(problem) = job.problem() {
        return Err(problem);
    }
    let format = accept::picture_format(headers, job.spec.params.output.format)?;
    let file = app.service.result(job, format).await?;
    Ok(picture::reply(job, &file, headers))
}

/// `GET /v1/jobs`
pub async fn list(State(app): State<App>, uri: Uri) -> Result<Json<Value>, Problem> {
    let page = Page::read(&uri)?;
    let lost = |_| bad_cursor("there is no such job, or it has been forgotten since");
    let before = match &page.cursor {
        Some(cursor) => Some(app.service.job(cursor).await.map_err(lost)?),
        None => None,
    };
    let (jobs, more) = app.service.jobs(before.as_deref(), page.count).await;
    let next = jobs.last().filter(|_| more).map(|job| job.spec.id.clone());
    let items: Vec<_> = jobs.iter().map(|job| app.service.describe(job)).collect();
    Ok(Json(json!({ "items": items, "next": next })))
}

/// `GET /v1/jobs/{id}`
pub async fn show(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Value>, Problem> {
    let job = app.service.job(&id).await?;
    Ok(Json(app.service.describe(&job)))
}

/// `GET /v1/jobs/{id}/preview`: the newest picture so far; of a finished job, its result.
pub async fn preview(
    State(app): State<App>,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let [number] = query::fields(&uri, ["n"])?;
    if number.is_some_and(|number| number.parse::<u64>().is_err()) {
        return Err(query::fault("n", "must be a whole number: it merely makes the address new".to_owned()));
    }
    let job = app.service.job(&id).await?;
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
    Ok((head, preview.file.bytes).into_response())
}

/// `GET /v1/jobs/{id}/result`, or one of its AOVs.
pub async fn result(
    State(app): State<App>,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = app.service.job(&id).await?;
    let [aov] = query::fields(&uri, ["aov"])?;
    let Some(name) = aov else {
        let format = accept::picture_format(&headers, job.spec.params.output.format)?;
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

/// `POST /v1/jobs/{id}/cancel`: 200 with the job, however often and however it has ended.
pub async fn cancel(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Value>, Problem> {
    let job = app.service.job(&id).await?;
    app.service.cancel(&job).await;
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
        self.app.service.cancel_soon(&self.job);
    }
}
