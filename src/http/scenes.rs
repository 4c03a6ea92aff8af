//! `/v1/scenes`: upload once, render often.

use super::App;
use super::list::{self, Page};
use super::upload::{self, Kinds, Upload};
use crate::jobs::{Code, Problem, SceneRow};
use axum::Json;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
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

/// `POST /v1/scenes`
pub async fn create(State(app): State<App>, request: Request) -> Result<Response, Problem> {
    let upload = upload::read(&app, &KINDS, request).await?;
    let files = some_file(upload, &KINDS)?.files;
    let (scene, new) = app.service.add_scene(files, false).await?;
    Ok(created(new, format!("/v1/scenes/{}", scene.id), scene.describe()))
}

/// An upload that has a file, or the fault that it has none.
pub fn some_file(upload: Upload, kinds: &Kinds) -> Result<Upload, Problem> {
    if !upload.files.is_empty() {
        return Ok(upload);
    }
    let field = kinds.file_field;
    let detail =
        format!("the form holds no file: send the {field} as its part `{field}`, or as the body of the request");
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
pub async fn list(State(app): State<App>, uri: Uri) -> Result<Json<Value>, Problem> {
    let page = Page::read(&uri)?;
    if page.cursor.as_ref().is_some_and(|cursor| !cursor.starts_with("sha256-")) {
        return Err(list::bad_cursor());
    }
    let (scenes, more) = app.service.scenes(page.cursor.as_deref().unwrap_or_default(), page.count).await?;
    let row = |scene: &SceneRow| json!({ "id": scene.id, "upload_bytes": scene.upload_bytes });
    Ok(list::reply(&scenes, more, |scene| &scene.id, row))
}

/// `GET /v1/scenes/{id}`
pub async fn show(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Value>, Problem> {
    app.service.scene(&id).await?.map(|scene| Json(scene.describe())).ok_or_else(|| unknown(&id))
}

/// `DELETE /v1/scenes/{id}`: jobs that use it finish.
pub async fn remove(State(app): State<App>, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    if app.service.remove_scene(&id).await? { Ok(StatusCode::NO_CONTENT) } else { Err(unknown(&id)) }
}

/// The fault of an unknown scene.
pub fn unknown(id: &str) -> Problem {
    let detail = format!("there is no scene `{id}`; scenes not used for long are forgotten: upload it again");
    Problem::new(Code::SceneNotFound, detail)
}
