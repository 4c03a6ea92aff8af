//! `/v1/batches`: many renders at once.

use super::list::{self, Page};
use super::prefer::Patience;
use super::upload::{self, Bound, Text};
use super::{App, archive, caller, jobs, query};
use crate::jobs::{BatchSubmission, Code, Item, ManifestError, Problem, from_lines, from_matrix};
use axum::Json;
use axum::body::Body;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde_json::Value;

const LINES: [&str; 3] = ["application/x-ndjson", "application/jsonl", "application/x-jsonlines"];

/// `POST /v1/batches`
pub async fn create(State(app): State<App>, headers: HeaderMap, request: Request) -> Result<Response, Problem> {
    let [] = query::fields(request.uri(), [])?;
    let caller = caller(&request);
    let key = jobs::idempotency_key(&headers, &caller)?;
    let manifest = Text {
        kinds: &[LINES[0], LINES[1], LINES[2], "application/json"],
        bound: Bound { name: "manifest_bytes", bytes: app.service.limits().manifest_bytes as u64 },
        hint: "send a render per line as application/x-ndjson, or a matrix as application/json",
    };
    let (kind, text) = upload::read_text(&app, &manifest, request).await?;
    let items = read(&kind, &text, app.service.limits().batch_items)?;
    let submission = BatchSubmission {
        items,
        key,
        client: caller.client,
        quota: caller.renders_per_day,
        anew: jobs::wants_anew(&headers),
    };
    let batch = app.service.submit_batch(submission).await?;
    Ok(jobs::accepted(&format!("/v1/batches/{}", batch.spec.id), batch.describe()))
}

fn read(kind: &str, text: &str, most: usize) -> Result<Vec<Item>, Problem> {
    let items =
        if LINES.contains(&kind) { from_lines(text, most) } else { from_matrix(&upload::parse_json(text)?, most) };
    items.map_err(|error| match error {
        ManifestError::Syntax(detail) => Problem::new(Code::MalformedJson, detail),
        ManifestError::Fields(faults) => Problem::fields(Code::InvalidParams, faults),
    })
}

/// `GET /v1/batches`
pub async fn list(State(app): State<App>, uri: Uri) -> Result<Json<Value>, Problem> {
    let page = Page::read(&uri)?;
    let service = &app.service;
    let before = page.after(|id| async move { service.batch(&id).await }).await?;
    let (batches, more) = app.service.batches(before.as_deref(), page.count).await?;
    Ok(list::reply(&batches, more, |batch| &batch.spec.id, |batch| batch.summary()))
}

/// `GET /v1/batches/{id}`; `Prefer: wait=N` waits for its end.
pub async fn show(State(app): State<App>, Path(id): Path<String>, headers: HeaderMap) -> Result<Response, Problem> {
    let batch = app.service.batch(&id).await?;
    let Some(patience) = Patience::of(&app, &headers) else { return Ok(Json(batch.describe()).into_response()) };
    patience.wait_for(&app, batch.finished()).await;
    batch.settled().await?;
    Ok(patience.note(Json(batch.describe()).into_response()))
}

/// `GET /v1/batches/{id}/results`: pictures as they are finished, in the order of the manifest.
pub async fn results(State(app): State<App>, Path(id): Path<String>) -> Result<Response, Problem> {
    let batch = app.service.batch(&id).await?;
    let name = format!("attachment; filename=\"{}.zip\"", batch.spec.id);
    let head = [
        (header::CONTENT_TYPE, HeaderValue::from_static("application/zip")),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
        (header::CONTENT_DISPOSITION, HeaderValue::try_from(name).unwrap_or(HeaderValue::from_static("attachment"))),
    ];
    Ok((head, Body::from_stream(archive::stream(app, batch))).into_response())
}

/// `POST /v1/batches/{id}/cancel`: 200 however often; jobs that are over stay as they are.
pub async fn cancel(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Value>, Problem> {
    let batch = app.service.batch(&id).await?;
    app.service.cancel_batch(&batch).await?;
    Ok(Json(batch.describe()))
}

/// `DELETE /v1/batches/{id}`: ended if need be, and forgotten with its jobs.
pub async fn remove(State(app): State<App>, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    let batch = app.service.batch(&id).await?;
    app.service.remove_batch(&batch).await?;
    Ok(StatusCode::NO_CONTENT)
}
