//! `POST /v1/render`: upload, job and wait in one.

use super::jobs::{Waiting, finished, wants_anew};
use super::scenes::{RAW, some_file};
use super::upload::{self, Kinds};
use super::{App, accept, caller, query};
use crate::jobs::{Code, Images, Order, Problem, Stages, Submission};
use crate::params::{self, FieldError, JsonError, RenderParams};
use axum::extract::{Request, State};
use axum::http::Uri;
use axum::response::Response;
use std::time::Instant;

const KINDS: Kinds = Kinds {
    raw: RAW,
    file_field: "scene",
    params: true,
    hint: "send multipart/form-data with the file as `scene` and parameters as `params`, or the file itself as \
           model/gltf-binary, model/gltf+json or application/zip with parameters in the query",
};

/// `POST /v1/render`
pub async fn render(State(app): State<App>, request: Request) -> Result<Response, Problem> {
    let begun = Instant::now();
    let headers = request.headers().clone();
    let (query, caller) = (request.uri().clone(), caller(&request));
    let mut upload = some_file(upload::read(&app, &KINDS, request).await?, &KINDS)?;
    let mut params = read_params(upload.params.as_deref(), &query)?;
    // A format that cannot be made is refused before the work, not after it.
    let format = Some(accept::picture_format(&headers, params.output.format)?);
    let uploaded = begun.elapsed().as_secs_f64();

    let Images { environment: hdri, maps, profiles } = app.service.take_images(&mut params, &mut upload.files).await?;
    let importing = Instant::now();
    let (scene, _) = app.service.add_scene(upload.files, true).await?;
    let stages = Stages { upload: uploaded, import: importing.elapsed().as_secs_f64(), ..Stages::default() };

    let order = Order { scene, hdri, maps, profiles, params, priority: 0, stages };
    let anew = wants_anew(&headers);
    let quota = caller.renders_per_day;
    let submission = Submission { attended: true, anew, format, quota, ..Submission::new(order, caller.client) };
    let job = app.service.submit(submission).await?;
    let waiting = Waiting { app, job };
    waiting.job.finished().await;
    finished(&waiting.app, &waiting.job, &headers).await
}

/// Parameters of the form's `params`, over which the query has precedence.
fn read_params(form: Option<&str>, uri: &Uri) -> Result<RenderParams, Problem> {
    let form = form.unwrap_or("{}");
    if let Err(JsonError::Syntax(error)) = params::json(form, "/params") {
        let fault = FieldError::new("/params", format!("not valid JSON: {error}"));
        return Err(Problem::fields(Code::MalformedJson, vec![fault]));
    }
    let pairs = query::pairs(uri)?;
    let pairs = pairs.iter().map(|(name, value)| (name.as_str(), value.as_str()));
    params::from_json_and_query(form, pairs).map_err(|faults| Problem::fields(Code::InvalidParams, faults))
}
