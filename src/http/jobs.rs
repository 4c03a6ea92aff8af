//! `/v1/jobs`: renders that outlive the request that began them.

use super::list::{self, Page};
use super::prefer::Patience;
use super::{App, Caller, accept, caller, picture, query, scenes, upload};
use crate::film::Aov;
use crate::jobs::{
    Asked, Code, Encoded, Images, Job, Order, Problem, Stages, State as JobState, Submission, Webhook, no_params,
};
use crate::params::{self, FieldError, ImageFormat, RenderParams};
use axum::Json;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::Value;
use std::sync::Arc;

/// Body of `POST /v1/jobs`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct NewJob {
    scene: String,
    #[serde(default = "no_params")]
    params: Value,
    #[serde(default)]
    priority: i32,
    #[serde(default)]
    webhook: Option<Webhook>,
}

/// `POST /v1/jobs`
pub async fn create(State(app): State<App>, headers: HeaderMap, request: Request) -> Result<Response, Problem> {
    let key = idempotency_key(&headers, &caller(&request))?;
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
    let anew = wants_anew(headers);
    let body = upload::read_json(&app, request).await?;
    let new: NewJob = params::read(&body).map_err(|fault| Problem::fields(Code::InvalidParams, vec![fault]))?;
    let params = params::from_json(&new.params.to_string());
    let params = params.map_err(|faults| Problem::fields(Code::InvalidParams, faults))?;
    let NewJob { scene, priority, webhook, .. } = new;
    let webhook = webhook.map(|webhook| webhook.url);
    let patience = Patience::of(&app, headers);
    // A format that cannot be made is refused before the work, not after it.
    let wanted = |_: &Patience| accept::picture_format(headers, params.output.format);
    let format = patience.as_ref().map(wanted).transpose()?;
    let asked = Asked {
        id: id.as_deref(),
        key: key.as_deref(),
        anew,
        scene: &scene,
        params: &params,
        priority,
        webhook: webhook.as_deref(),
    };
    let job = if let Some(job) = app.service.known(&asked).await? {
        job
    } else {
        app.service.refuse_when_full(&asked)?;
        let order = order(&app, &scene, params, priority).await?;
        let quota = caller.renders_per_day;
        let submission = Submission { id, key, anew, format, quota, webhook, ..Submission::new(order, caller.client) };
        app.service.submit(submission).await?
    };
    // It is accepted, whatever becomes of the ledger now.
    let _ = job.settled().await;
    let accepted = || accepted(&format!("/v1/jobs/{}", job.spec.id), app.service.describe(&job));
    let Some(patience) = patience else { return Ok(accepted()) };
    let in_time = patience.wait_for(&app, job.finished()).await;
    Ok(patience.note(if in_time { finished(&app, &job, headers).await? } else { accepted() }))
}

/// `Idempotency-Key`, of 1 to 255 visible characters, behind the client's API key if it has one: what two of these call by the same
/// name is not the same. As neither has spaces, no other client's is like it.
pub fn idempotency_key(headers: &HeaderMap, caller: &Caller) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    let is_plain = |key: &&str| (1..=255).contains(&key.len()) && key.bytes().all(|byte| byte.is_ascii_graphic());
    let fault = || {
        let detail = "`Idempotency-Key` must be 1 to 255 visible ASCII characters, without spaces";
        Problem::new(Code::BadRequest, detail)
    };
    let key = value.to_str().ok().filter(is_plain).ok_or_else(fault)?;
    Ok(Some(if caller.has_key { format!("{} {key}", caller.client) } else { key.to_owned() }))
}

/// Whether the client wants no result that was made before (`Cache-Control: no-cache`).
pub fn wants_anew(headers: &HeaderMap) -> bool {
    let lines = headers.get_all(header::CACHE_CONTROL).iter().filter_map(|value| value.to_str().ok());
    lines.flat_map(|line| line.split(',')).any(|part| part.trim().eq_ignore_ascii_case("no-cache"))
}

/// 202 with what was accepted as it stands, and its address.
pub fn accepted(location: &str, body: Value) -> Response {
    let location = HeaderValue::try_from(location).map(|value| [(header::LOCATION, value)]);
    (StatusCode::ACCEPTED, location.ok(), Json(body)).into_response()
}

async fn order(app: &App, scene: &str, mut params: RenderParams, priority: i32) -> Result<Order, Problem> {
    let unknown = || Problem { errors: vec![FieldError::new("/scene", "unknown scene")], ..scenes::unknown(scene) };
    let scene = app.service.scene(scene).await?.ok_or_else(unknown)?;
    let Images { environment: hdri, maps, profiles } = app.service.take_images(&mut params, &mut Vec::new()).await?;
    Ok(Order { scene, hdri, maps, profiles, params, priority, stages: Stages::default() })
}

/// The reply to a request that waited for its job: the picture, or why there is none.
pub async fn finished(app: &App, job: &Job, headers: &HeaderMap) -> Result<Response, Problem> {
    if let Some(problem) = job.problem() {
        return Err(problem);
    }
    Ok(picture::reply(job, &file(app, job, headers).await?))
}

/// The file of a job in the format that the client likes best; if that can no longer be made, in the job's own, where the client takes it.
async fn file(app: &App, job: &Job, headers: &HeaderMap) -> Result<Encoded, Problem> {
    let own = job.spec.params.output.format;
    let format = accept::picture_format(headers, own)?;
    match app.service.result(job, format).await {
        Err(problem) if problem.code == Code::LinearPictureGone.id() && accept::takes(headers, own) => {
            app.service.result(job, own).await
        }
        made => made,
    }
}

/// `GET /v1/jobs`
pub async fn list(State(app): State<App>, uri: Uri) -> Result<Json<Value>, Problem> {
    let page = Page::read(&uri)?;
    let service = &app.service;
    let before = page.after(|id| async move { service.job(&id).await }).await?;
    let (jobs, more) = app.service.jobs(before.as_deref(), page.count).await?;
    Ok(list::reply(&jobs, more, |job| &job.spec.id, |job| app.service.describe(job)))
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
        return Ok(picture::reply_unless_had(&job, &file(&app, &job, &headers).await?, &headers));
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
        return Ok(picture::reply_unless_had(&job, &file(&app, &job, &headers).await?, &headers));
    };
    let unknown = |fault| Problem::fields(Code::InvalidParams, vec![FieldError::new("/aov", fault)]);
    let aov = Aov::from_name(&name).map_err(unknown)?;
    if accept::picture_format(&headers, ImageFormat::Exr)? != ImageFormat::Exr {
        let detail = format!("{name} is no picture to look at and comes as image/x-exr only; ask for that in `Accept`");
        return Err(Problem::new(Code::NotAcceptable, detail));
    }
    Ok(picture::reply_unless_had(&job, &app.service.aov(&job, aov).await?, &headers))
}

/// `POST /v1/jobs/{id}/cancel`: 200 with the job, however often and however it has ended.
pub async fn cancel(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Value>, Problem> {
    let job = app.service.job(&id).await?;
    app.service.cancel(&job).await?;
    Ok(Json(app.service.describe(&job)))
}

/// `DELETE /v1/jobs/{id}`: ended if need be, and forgotten with its result.
pub async fn remove(State(app): State<App>, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    let job = app.service.job(&id).await?;
    app.service.remove_job(&job).await?;
    Ok(StatusCode::NO_CONTENT)
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
