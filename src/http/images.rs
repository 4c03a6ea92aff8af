//! `/v1/images`: pictures, and profiles of lights, that parameters name by id.

use super::App;
use super::scenes::{created, some_file};
use super::upload::{self, Kinds};
use crate::jobs::{Code, Problem};
use axum::Json;
use axum::extract::{Path, Request, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde_json::Value;

const KINDS: Kinds = Kinds {
    raw: &[
        "image/vnd.radiance",
        "image/x-exr",
        "image/png",
        "image/jpeg",
        "image/webp",
        "application/x-ies-lm-63",
        "application/octet-stream",
    ],
    file_field: "image",
    params: false,
    hint: "send multipart/form-data with the file as `image`, or the file itself as image/vnd.radiance, image/x-exr, \
           image/png, image/jpeg, image/webp, application/x-ies-lm-63 or application/octet-stream",
};

/// `POST /v1/images`
pub async fn create(State(app): State<App>, request: Request) -> Result<Response, Problem> {
    let upload = upload::read(&app, &KINDS, request).await?;
    let mut files = some_file(upload, &KINDS)?.files.into_iter();
    let (Some((_, bytes)), None) = (files.next(), files.next()) else {
        return Err(Problem::new(Code::BadRequest, "send one image at a time"));
    };
    let (image, new) = app.service.add_image(bytes, "/image").await?;
    Ok(created(new, format!("/v1/images/{}", image.id), image.describe()))
}

/// `GET /v1/images/{id}`
pub async fn show(State(app): State<App>, Path(id): Path<String>) -> Result<Json<Value>, Problem> {
    app.service.image(&id).await?.map(|image| Json(image.describe())).ok_or_else(|| unknown(&id))
}

/// `DELETE /v1/images/{id}`: jobs that use it finish.
pub async fn remove(State(app): State<App>, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    if app.service.remove_image(&id).await? { Ok(StatusCode::NO_CONTENT) } else { Err(unknown(&id)) }
}

fn unknown(id: &str) -> Problem {
    let detail = format!("there is no image `{id}`; images not used for long are forgotten: upload it again");
    Problem::new(Code::ImageNotFound, detail)
}
