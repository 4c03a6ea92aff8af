//! Bodies of requests: bounded in bytes, in parts and in time.

use super::App;
use crate::config::Limits;
use crate::jobs::{Code, Problem};
use crate::params::{self, JsonError};
use axum::body::{Body, Bytes};
use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, StatusCode, header};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio_stream::StreamExt;

/// Seconds after which a client that found no room for its body should try again.
const RETRY_SECONDS: u32 = 2;

/// Bytes of a permit of [`Room`].
const GRAIN: usize = 1 << 10;

/// Memory for bodies that are being read. What a body has sent so far is what it takes, so that a slow one takes little.
#[derive(Debug, Clone)]
pub struct Room {
    free: Arc<Semaphore>,
    grains: usize,
    idle: Duration,
}

impl Room {
    /// As the limits say; at least one body fits.
    pub fn new(limits: &Limits) -> Self {
        let bytes = limits.upload_memory_bytes.max(limits.upload_bytes).max(limits.json_bytes as u64);
        let grains = usize::try_from(bytes).unwrap_or(usize::MAX).div_ceil(GRAIN) + 1;
        let grains = grains.min(Semaphore::MAX_PERMITS);
        Self { free: Arc::new(Semaphore::new(grains)), grains, idle: Duration::from_secs(limits.idle_seconds.max(1)) }
    }

    /// Bytes in use, in whole grains.
    pub fn used(&self) -> usize {
        (self.grains - self.free.available_permits()) * GRAIN
    }

    /// The request with a body that is metered, and the meter.
    fn metered(&self, request: Request) -> (Request, Arc<Meter>) {
        let meter = Arc::new(Meter::default());
        let (parts, body) = request.into_parts();
        let (idle, free) = (self.idle, Arc::clone(&self.free));
        let chunks = body.into_data_stream().timeout(idle);
        let counted = {
            let meter = Arc::clone(&meter);
            chunks.then(move |chunk| {
                let (meter, free) = (Arc::clone(&meter), Arc::clone(&free));
                async move {
                    let chunk = chunk.map_err(|_| meter.give_up(silent(idle)))??;
                    meter.take(&free, chunk.len(), idle).await?;
                    Ok::<_, axum::BoxError>(chunk)
                }
            })
        };
        (Request::from_parts(parts, Body::from_stream(counted)), meter)
    }
}

fn silent(idle: Duration) -> Problem {
    let seconds = idle.as_secs();
    let detail = format!("nothing of the body arrived for {seconds} s (GET /v1/limits, idle_seconds)");
    Problem::new(Code::RequestTimeout, detail)
}

/// Memory that one body holds, and why it was given up.
#[derive(Debug, Default)]
struct Meter {
    held: Mutex<Option<OwnedSemaphorePermit>>,
    rest: Mutex<usize>,
    fault: OnceLock<Problem>,
}

impl Meter {
    /// Takes memory for so many bytes more.
    async fn take(&self, free: &Arc<Semaphore>, bytes: usize, patience: Duration) -> Result<(), axum::BoxError> {
        let grains = {
            let mut rest = self.rest.lock().unwrap_or_else(PoisonError::into_inner);
            *rest += bytes;
            let grains = *rest / GRAIN;
            *rest %= GRAIN;
            u32::try_from(grains).unwrap_or(u32::MAX)
        };
        let more = tokio::time::timeout(patience, Arc::clone(free).acquire_many_owned(grains)).await;
        let Ok(Ok(more)) = more else {
            let detail = "the memory for uploads is in use; try again later (GET /v1/limits, upload_memory_bytes)";
            return Err(self.give_up(Problem::new(Code::QueueFull, detail).retry_after(RETRY_SECONDS)));
        };
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        match held.as_mut() {
            Some(held) => held.merge(more),
            None => *held = Some(more),
        }
        Ok(())
    }

    fn give_up(&self, problem: Problem) -> axum::BoxError {
        let text = problem.detail.clone();
        // The first reason counts.
        let _ = self.fault.set(problem);
        text.into()
    }

    /// The reason that the meter knows, else the one given.
    fn explain<T>(&self, read: Result<T, Problem>) -> Result<T, Problem> {
        read.map_err(|problem| self.fault.get().cloned().unwrap_or(problem))
    }
}

/// The limit that a body, or a part of it, is held to.
#[derive(Debug, Clone, Copy)]
pub struct Bound {
    /// In `GET /v1/limits`.
    pub name: &'static str,
    /// Its value.
    pub bytes: u64,
}

impl Bound {
    fn exceeded(self, what: &str) -> Problem {
        let Self { name, bytes } = self;
        let detail = format!("{what} is larger than the {bytes} bytes that this server reads (GET /v1/limits, {name})");
        Problem::new(Code::PayloadTooLarge, detail)
    }

    /// Refuses a body that says itself that it is too large, before any of it is read.
    fn check(self, headers: &HeaderMap) -> Result<(), Problem> {
        let length = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
        if length.is_some_and(|length| length > self.bytes) { Err(self.exceeded("the body")) } else { Ok(()) }
    }
}

/// Files of an upload, and what else the form says.
#[derive(Debug, Default)]
pub struct Upload {
    /// Name and content of each file, in the form's order; a raw body has an empty name.
    pub files: Vec<(String, Vec<u8>)>,
    /// The field `params`.
    pub params: Option<String>,
    /// Keeps count of the memory that the files take.
    _meter: Arc<Meter>,
}

/// What a route reads besides multipart forms.
pub struct Kinds {
    /// Media types of a raw body.
    pub raw: &'static [&'static str],
    /// The form field whose file needs no name.
    pub file_field: &'static str,
    /// Whether the form may have a field `params`.
    pub params: bool,
    /// What to say to those who send something else.
    pub hint: &'static str,
}

/// Reads a form or a raw file.
pub async fn read(app: &App, kinds: &Kinds, request: Request) -> Result<Upload, Problem> {
    let limits = app.service.limits();
    upload_bound(limits).check(request.headers())?;
    check_encoding(request.headers())?;
    let kind = content_type(request.headers());
    let (request, meter) = app.room.metered(request);
    let reading = async {
        match kind.as_str() {
            "multipart/form-data" => read_form(limits, kinds, request).await,
            raw if kinds.raw.contains(&raw) => {
                let bytes = read_all(upload_bound(limits), request).await?;
                if bytes.is_empty() {
                    return Err(Problem::new(Code::BadRequest, "the body is empty: send the file as the body"));
                }
                Ok(Upload { files: vec![(String::new(), bytes.into())], ..Upload::default() })
            }
            other => Err(unsupported(other, kinds.hint)),
        }
    };
    let upload = meter.explain(in_time(limits.body_seconds, reading).await)?;
    Ok(Upload { _meter: meter, ..upload })
}

/// What a route reads that takes text.
pub struct Text {
    /// Media types.
    pub kinds: &'static [&'static str],
    /// Longest body, which is the route's `DefaultBodyLimit`, too.
    pub bound: Bound,
    /// What to say to those who send something else.
    pub hint: &'static str,
}

/// Reads a body that must be JSON.
pub async fn read_json(app: &App, request: Request) -> Result<serde_json::Value, Problem> {
    let json = Text {
        kinds: &["application/json"],
        bound: json_bound(app.service.limits()),
        hint: "send JSON with `Content-Type: application/json`",
    };
    parse_json(&read_text(app, &json, request).await?.1)
}

fn upload_bound(limits: &Limits) -> Bound {
    Bound { name: "upload_bytes", bytes: limits.upload_bytes }
}

fn json_bound(limits: &Limits) -> Bound {
    Bound { name: "json_bytes", bytes: limits.json_bytes as u64 }
}

/// Reads a body that must be text of one of some media types, and says which.
pub async fn read_text(app: &App, wanted: &Text, request: Request) -> Result<(String, String), Problem> {
    wanted.bound.check(request.headers())?;
    check_encoding(request.headers())?;
    let kind = content_type(request.headers());
    if !wanted.kinds.contains(&kind.as_str()) {
        return Err(unsupported(&kind, wanted.hint));
    }
    let (request, meter) = app.room.metered(request);
    let bytes = meter.explain(in_time(app.service.limits().body_seconds, read_all(wanted.bound, request)).await)?;
    let text =
        String::from_utf8(bytes.into()).map_err(|_| Problem::new(Code::MalformedJson, "the body is not UTF-8"))?;
    Ok((kind, text))
}

/// Reads JSON, strictly.
pub fn parse_json(text: &str) -> Result<serde_json::Value, Problem> {
    params::json(text, "").map_err(|error| match error {
        JsonError::Syntax(error) => Problem::new(Code::MalformedJson, format!("the body is not valid JSON: {error}")),
        JsonError::Twice(fault) => Problem::fields(Code::InvalidParams, vec![fault]),
    })
}

async fn in_time<T>(seconds: u64, reading: impl Future<Output = Result<T, Problem>>) -> Result<T, Problem> {
    let read = tokio::time::timeout(Duration::from_secs(seconds), reading).await;
    read.unwrap_or_else(|_| {
        let detail = format!("the body did not arrive within {seconds} s (GET /v1/limits, body_seconds)");
        Err(Problem::new(Code::RequestTimeout, detail))
    })
}

/// The limit of the route's `DefaultBodyLimit` holds.
async fn read_all(bound: Bound, request: Request) -> Result<Bytes, Problem> {
    Bytes::from_request(request, &()).await.map_err(|rejection| match rejection.status() {
        StatusCode::PAYLOAD_TOO_LARGE => bound.exceeded("the body"),
        _ => Problem::new(Code::BadRequest, "the body broke off before its end"),
    })
}

async fn read_form(limits: &Limits, kinds: &Kinds, request: Request) -> Result<Upload, Problem> {
    let nameless = || {
        let detail = "`Content-Type: multipart/form-data` must name its boundary, of 1 to 70 characters";
        Problem::new(Code::MalformedMultipart, detail)
    };
    if !(1..=70).contains(&boundary(request.headers()).map_or(0, str::len)) {
        return Err(nameless());
    }
    let mut form = Multipart::from_request(request, &()).await.map_err(|_| nameless())?;
    let mut upload = Upload::default();
    let mut parts = 0;
    let malformed = |error: MultipartError| malformed(&error, limits);
    let most_parts = limits.form_parts;
    while let Some(field) = form.next_field().await.map_err(malformed)? {
        parts += 1;
        if parts > most_parts {
            let detail = format!("the form has more than {most_parts} parts (GET /v1/limits, form_parts)");
            return Err(Problem::new(Code::PayloadTooLarge, detail));
        }
        read_field(limits, kinds, &mut upload, field).await?;
    }
    Ok(upload)
}

async fn read_field(limits: &Limits, kinds: &Kinds, upload: &mut Upload, mut field: Field<'_>) -> Result<(), Problem> {
    let name = field.name().unwrap_or_default().to_owned();
    if let Some(odd) = [field.name(), field.file_name()].into_iter().flatten().find(|name| has_controls(name)) {
        let detail = format!("the name {odd:?} of a part has a control character in it: rename the part, or its file");
        return Err(Problem::new(Code::MalformedMultipart, detail));
    }
    if kinds.params && name == "params" {
        let text = read_text_field(limits, &mut field).await?;
        if upload.params.replace(text).is_some() {
            return Err(Problem::new(Code::MalformedMultipart, "the form has two fields `params`"));
        }
        return Ok(());
    }
    let file = match field.file_name() {
        Some(file) => file.to_owned(),
        None if name == kinds.file_field => String::new(),
        None => {
            let also = if kinds.params { ", `params`" } else { "" };
            let detail = format!(
                "the field `{name}` is not known: send `{}`{also}, and further files with a file name each",
                kinds.file_field
            );
            return Err(Problem::new(Code::MalformedMultipart, detail));
        }
    };
    let mut bytes = Vec::new();
    while let Some(chunk) = field.chunk().await.map_err(|error| malformed(&error, limits))? {
        bytes.extend_from_slice(&chunk);
    }
    if bytes.is_empty() {
        let detail = format!("the part `{name}` (file name `{file}`) is empty: was the file there, and is it whole?");
        return Err(Problem::new(Code::BadRequest, detail));
    }
    upload.files.push((file, bytes));
    Ok(())
}

async fn read_text_field(limits: &Limits, field: &mut Field<'_>) -> Result<String, Problem> {
    let (mut bytes, bound) = (Vec::new(), json_bound(limits));
    while let Some(chunk) = field.chunk().await.map_err(|error| malformed(&error, limits))? {
        bytes.extend_from_slice(&chunk);
        if bytes.len() as u64 > bound.bytes {
            return Err(bound.exceeded("the field `params`"));
        }
    }
    String::from_utf8(bytes).map_err(|_| Problem::new(Code::MalformedJson, "the field `params` is not UTF-8"))
}

fn malformed(error: &MultipartError, limits: &Limits) -> Problem {
    if error.status() == StatusCode::PAYLOAD_TOO_LARGE {
        return upload_bound(limits).exceeded("the form");
    }
    let text = error.body_text();
    let why =
        if text.contains("headers") { ": a name in it has a control character, or a line has no colon" } else { "" };
    Problem::new(Code::MalformedMultipart, format!("{text}{why}"))
}

fn has_controls(name: &str) -> bool {
    name.chars().any(char::is_control)
}

/// The boundary that a form names.
fn boundary(headers: &HeaderMap) -> Option<&str> {
    let kind = headers.get(header::CONTENT_TYPE)?.to_str().ok()?;
    let (_, value) = kind
        .split(';')
        .filter_map(|part| part.split_once('='))
        .find(|(name, _)| name.trim().eq_ignore_ascii_case("boundary"))?;
    Some(value.trim().trim_matches('"'))
}

/// Refuses a body that is packed on its way.
fn check_encoding(headers: &HeaderMap) -> Result<(), Problem> {
    match headers.get(header::CONTENT_ENCODING) {
        Some(encoding) if !encoding.as_bytes().eq_ignore_ascii_case(b"identity") => {
            let detail = "this server reads no `Content-Encoding`: send the body as it is (a scene may be a .zip)";
            Err(Problem::new(Code::UnsupportedMediaType, detail))
        }
        _ => Ok(()),
    }
}

fn unsupported(kind: &str, hint: &str) -> Problem {
    let fault =
        if kind.is_empty() { "there is no Content-Type".into() } else { format!("this route does not read {kind}") };
    Problem::new(Code::UnsupportedMediaType, format!("{fault}: {hint}"))
}

/// Media type of the body in lower case, without its parameters.
fn content_type(headers: &HeaderMap) -> String {
    let value = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    value.split(';').next().unwrap_or_default().trim().to_ascii_lowercase()
}
