//! A finished picture as a reply: the file, its facts as `Candela-*` headers, its hash as `ETag`.

use super::accept::media_type;
use crate::jobs::{Encoded, Job, Record};
use axum::body::Body;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

/// Longest value of one fact; the whole list is in the job's JSON.
const LONGEST: usize = 1000;

/// The file of a finished job, or 304 if the client has it: of a request that merely looks.
pub fn reply_unless_had(job: &Job, file: &Encoded, request: &HeaderMap) -> Response {
    if has_it(request, &file.etag) {
        return (StatusCode::NOT_MODIFIED, headers(job, file)).into_response();
    }
    reply(job, file)
}

/// The file of a finished job.
pub fn reply(job: &Job, file: &Encoded) -> Response {
    let mut headers = headers(job, file);
    set(&mut headers, header::CONTENT_TYPE, media_type(file.format));
    (headers, Body::from(file.bytes.clone())).into_response()
}

fn headers(job: &Job, file: &Encoded) -> HeaderMap {
    let mut headers = HeaderMap::new();
    if let Some(outcome) = job.outcome() {
        facts(&mut headers, &outcome.record);
    }
    set(&mut headers, HeaderName::from_static("candela-job"), &job.spec.id);
    set(&mut headers, header::ETAG, &file.etag);
    // An id of the client's may come to mean another picture: a cache has to ask whether the tag still holds.
    set(&mut headers, header::CACHE_CONTROL, "private, no-cache");
    set(&mut headers, header::VARY, "Accept");
    headers
}

fn facts(headers: &mut HeaderMap, record: &Record) {
    let stages = ("Candela-Seconds".to_owned(), record.seconds.clone());
    for (name, value) in record.facts.iter().chain([&stages]) {
        if let Ok(name) = HeaderName::try_from(name) {
            set(headers, name, value);
        }
    }
}

/// Sets a header; what is not plain ASCII (names in scenes and drivers) shows as `?`.
fn set(headers: &mut HeaderMap, name: HeaderName, value: &str) {
    let plain: String =
        value.chars().take(LONGEST).map(|c| if c == ' ' || c.is_ascii_graphic() { c } else { '?' }).collect();
    if let Ok(value) = HeaderValue::from_str(&plain) {
        headers.insert(name, value);
    }
}

/// Whether `If-None-Match` names this content.
pub fn has_it(request: &HeaderMap, etag: &str) -> bool {
    let lines = request.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
    lines.flat_map(|line| line.split(',')).map(str::trim).any(|tag| tag == "*" || tag.trim_start_matches("W/") == etag)
}
