//! `/v1/scenes`: upload once, render often.

use super::App;
use super::upload::{self, Kinds, Upload};
use crate::jobs::{Code, Problem, StoredScene};
use crate::params::FieldError;
use axum::Json;
use axum::extract::{Path, Query, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};

/// Media types of a scene that comes as one file.
pub const RAW: &[&str] = &["model/gltf-binary", "model/gltf+json", "application/zip"];

const KINDS: Kinds = Kinds {
    raw: RAW,
    file_field: "scene",
    params: false,
    hint: "send multipart/form-data with the file as `scene`, or the file itself as model/gltf-binary, \
           model/gltf+json or application/zip",
};

/// Where a page of a list begins, and how long it is.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Page {
    /// What the page before gave as `next`.
    pub cursor: Option<String>,
    /// 1 to 100.
    pub limit: Option<usize>,
}

impl Page {
    /// Length of the page.
    pub fn count(&self) -> Result<usize, Problem> {
        let count = self.limit.unwrap_or(20);
        if (1..=100).contains(&count) {
            return Ok(count);
        }
        let detail = format!("must lie between 1 and 100, and is {count}");
        Err(Problem::fields(Code::InvalidParams, vec![FieldError::new("/limit", detail)]))
    }
}

/// `POST /v1/scenes`
pub async fn create(State(app): State<App>, request: Request) -> Result<Response, Problem> {
    let upload = upload::read(&app, &KINDS, request).await?;
    let files = some_file(upload, &KINDS)?.files;
    let (scene, new) = app.service.add_scene(files).await?;
    Ok(created(new, format!("/v1/scenes/{}", scene.id), scene.describe()))
}

/// An upload that has a file, or the fault that it has none.
pub fn some_file(upload: Upload, kinds: &Kinds) -> Result<Upload, Problem> {
    if !upload.files.is_empty() {
        return Ok(upload);
    }
    let field = kinds.file_field;
    let detail = format!("the form holds no file: send the {field} as its part `{field}`, or as the body of the request");
    Err(Problem::new(Code::BadRequest, detail))
}

/// 201 for what is new, 200 for what was there, with its address.
pub fn created(new: bool, location: String, body: Value) -> Response {
    let status = if new { StatusCode::CREATED } else { StatusCode::OK };
    let mut response = (status, Json(body)).into_response();
    if let Ok(location) = HeaderValue::try_from(location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    response
}

/// `GET /v1/scenes`
pub async fn list(State(app): State<App>, Query(page): Query<Page>) -> Result<Json<Value>, Problem> {
    let (scenes, more) = app.service.scenes().page(page.cursor.as_deref(), page.count()?);
    let next = scenes.last().filter(|_| more).map(|scene| scene.id.clone());
    let row = |scene: &StoredScene| json!({ "id": scene.id, "upload_bytes": scene.upload_bytes });
    Ok(Json(json!({ "items": scenes.iter().map(|scene| row(scene)).collect::<Vec<_>>(), "next": next })))
}

/// `GET /v1/scenes/{id}`
pub async fn show(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Value>, Problem> {
    app.service.scenes().get(&id).map(|scene| Json(scene.describe())).ok_or_else(|| unknown(&id))
}

/// `DELETE /v1/scenes/{id}`: jobs that use it finish.
pub async fn remove(State(app): State<App>, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    if app.service.scenes().remove(&id) { Ok(StatusCode::NO_CONTENT) } else { Err(unknown(&id)) }
}

/// The fault of an unknown scene.
pub fn unknown(id: &str) -> Problem {
    let detail = format!("there is no scene `{id}`; scenes not used for long are forgotten: upload it again");
    Problem::new(Code::SceneNotFound, detail)
}
