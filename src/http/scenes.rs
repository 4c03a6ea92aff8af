//! `/v1/scenes`: upload once, render often.

use super::upload::{self, Kinds, Upload};
use super::{App, query};
use crate::jobs::{Code, Problem, SceneRow};
use crate::params::FieldError;
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

/// Where a page of a list begins, and how long it is.
#[derive(Debug)]
pub struct Page {
    /// What the page before gave as `next`.
    pub cursor: Option<String>,
    /// 1 to 100.
    pub count: usize,
}

impl Page {
    /// The fields `cursor` and `limit` of a query.
    pub fn read(uri: &Uri) -> Result<Self, Problem> {
        let [cursor, limit] = query::fields(uri, ["cursor", "limit"])?;
        let limit = limit.unwrap_or_else(|| "20".to_owned());
        match limit.parse() {
            Ok(count @ 1..=100) => Ok(Self { cursor, count }),
            _ => {
                let limit: String = limit.chars().take(40).collect();
                Err(query::fault("limit", format!("must be a whole number from 1 to 100, and is `{limit}`")))
            }
        }
    }
}

/// The fault of a cursor that leads nowhere.
pub fn bad_cursor(why: &str) -> Problem {
    let detail = format!("{why}: give the `next` of the page before, or no cursor to begin again");
    Problem { errors: vec![FieldError::new("/cursor", why)], ..Problem::new(Code::BadCursor, detail) }
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
        return Err(bad_cursor("this is no cursor of this list"));
    }
    let (scenes, more) = app.service.scenes(page.cursor.as_deref().unwrap_or_default(), page.count).await?;
    let next = scenes.last().filter(|_| more).map(|scene| scene.id.clone());
    let row = |scene: &SceneRow| json!({ "id": scene.id, "upload_bytes": scene.upload_bytes });
    Ok(Json(json!({ "items": scenes.iter().map(row).collect::<Vec<_>>(), "next": next })))
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
