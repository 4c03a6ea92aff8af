//! What can go wrong, as data: one table of codes for the replies, for `/docs/errors` and for the tests.

use crate::compile::CompileError;
use crate::params::FieldError;
use crate::scene::{SceneError, SceneErrorKind};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Writes the table of codes once: name, identifier, HTTP status, title.
macro_rules! codes {
    ($($(#[doc = $doc:literal])+ $name:ident = $code:literal, $status:literal, $title:literal;)+) => {
        /// Faults that are not tied to one place of a scene file (those have the codes of the scene room).
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Code {
            $($(#[doc = $doc])+ $name,)+
        }

        impl Code {
            /// Every code.
            pub const ALL: &[Self] = &[$(Self::$name,)+];

            /// Stable identifier, the anchor in `/docs/errors`.
            pub fn id(self) -> &'static str {
                match self { $(Self::$name => $code,)+ }
            }

            /// HTTP status.
            pub fn status(self) -> u16 {
                match self { $(Self::$name => $status,)+ }
            }

            /// Short summary, the same for every occurrence.
            pub fn title(self) -> &'static str {
                match self { $(Self::$name => $title,)+ }
            }
        }
    };
}

codes! {
    /// There is no key, or an unknown one.
    Unauthorized = "unauthorized", 401, "A key is needed";
    /// The key does not allow this.
    Forbidden = "forbidden", 403, "The key does not allow this";
    /// The request was meant for another host.
    HostNotAllowed = "host_not_allowed", 421, "This server does not answer for that host";
    /// The key has sent too many requests of late.
    RateLimited = "rate_limited", 429, "Too many requests";
    /// The key has had all its renders of today.
    QuotaExceeded = "quota_exceeded", 429, "The quota of this key is used up";
    /// A page of another site sent the request.
    CrossSite = "cross_site", 403, "Requests from other sites are refused";
    /// The request line, a header or the query cannot be read.
    BadRequest = "bad_request", 400, "The request cannot be read";
    /// A list is to go on at a place that is not there.
    BadCursor = "bad_cursor", 400, "The list cannot go on from there";
    /// The form is cut off or not a form.
    MalformedMultipart = "malformed_multipart", 400, "The multipart form cannot be read";
    /// The body is not JSON.
    MalformedJson = "malformed_json", 400, "The body is not valid JSON";
    /// No such route.
    NotFound = "not_found", 404, "There is nothing at this address";
    /// No such scene.
    SceneNotFound = "scene_not_found", 404, "There is no such scene";
    /// No such image.
    ImageNotFound = "image_not_found", 404, "There is no such image";
    /// No such job.
    JobNotFound = "job_not_found", 404, "There is no such job";
    /// No such batch.
    BatchNotFound = "batch_not_found", 404, "There is no such batch";
    /// The job has no preview.
    NoPreview = "no_preview", 404, "The job has no preview yet";
    /// The route exists, the method does not.
    MethodNotAllowed = "method_not_allowed", 405, "The method is not allowed here";
    /// No format of `Accept` can be made.
    NotAcceptable = "not_acceptable", 406, "None of the formats asked for can be made";
    /// The body came too slowly.
    RequestTimeout = "request_timeout", 408, "The body did not arrive in time";
    /// The result is asked for too early.
    NotFinished = "not_finished", 409, "The job has not finished";
    /// The job failed, so it has no result.
    JobFailed = "job_failed", 409, "The job failed";
    /// The job was cancelled, so it has no result.
    JobCancelled = "job_cancelled", 409, "The job was cancelled";
    /// A job of the same id is there, and is another one.
    JobConflict = "job_conflict", 409, "There is another job of this id";
    /// Another format or an AOV is asked for too late.
    LinearPictureGone = "linear_picture_gone", 410, "The linear picture of the job has left";
    /// The body is larger than the server reads.
    PayloadTooLarge = "payload_too_large", 413, "The body is too large";
    /// The body is of a type that the route does not read.
    UnsupportedMediaType = "unsupported_media_type", 415, "The type of the body is not supported";
    /// A field is unknown, missing or out of range.
    InvalidParams = "invalid_params", 422, "The parameters are not valid";
    /// Valid, but beyond a limit of this server.
    LimitExceeded = "limit_exceeded", 422, "The request is beyond a limit of this server";
    /// Denoising is asked for, and nothing here can do it.
    DenoiserMissing = "denoiser_missing", 422, "This server cannot denoise";
    /// The key was used with another request.
    IdempotencyMismatch = "idempotency_mismatch", 422, "The idempotency key belongs to another request";
    /// The image cannot be decoded.
    InvalidImage = "invalid_image", 422, "The image cannot be read";
    /// What reads scenes did not get through it.
    ImportFailed = "import_failed", 422, "The scene could not be imported";
    /// What renders was ended by it, again and again.
    RenderFailed = "render_failed", 422, "The render ends what renders it";
    /// The scene does not fit the device or the memory of a job.
    RenderTooLarge = "render_too_large", 422, "The render does not fit this server";
    /// A fault of the server.
    Internal = "internal", 500, "The server failed";
    /// The queue is full.
    QueueFull = "queue_full", 503, "The queue is full";
    /// The server is shutting down.
    ShuttingDown = "shutting_down", 503, "The server is shutting down";
    /// The disk cannot be written, or has lost what was on it.
    StorageUnavailable = "storage_unavailable", 503, "The server's storage is at fault";
    /// The graphics device is lost and did not come back.
    DeviceUnavailable = "device_unavailable", 503, "The graphics device is not available";
}

/// A fault as the client sees it (RFC 9457), without the request's id.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Problem {
    /// Link to what the code means.
    pub r#type: Box<str>,
    /// Summary of the code.
    pub title: Box<str>,
    /// HTTP status.
    pub status: u16,
    /// Stable identifier.
    pub code: Cow<'static, str>,
    /// What, why, how to fix.
    pub detail: String,
    /// Places at fault.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<FieldError>,
    /// Seconds after which a retry may help.
    #[serde(skip)]
    pub retry_after: Option<u32>,
}

impl Problem {
    /// A fault with the code's status and title.
    pub fn new(code: Code, detail: impl Into<String>) -> Self {
        Self::build(code.id(), code.status(), code.title(), detail.into())
    }

    /// Whether it is of a code.
    pub fn is(&self, code: Code) -> bool {
        self.code == code.id()
    }

    /// Faults of parameters, each with its place; the whole of a body is none.
    pub fn fields(code: Code, mut errors: Vec<FieldError>) -> Self {
        let detail = said(&errors);
        errors.retain(|fault| !fault.pointer.is_empty());
        Self { errors, ..Self::new(code, detail) }
    }

    /// The same fault of a part: `place` puts the places where that part stands.
    pub fn within(self, part: &str, place: impl Fn(FieldError) -> FieldError) -> Self {
        let tells_of_places = self.detail == said(&self.errors);
        let errors: Vec<FieldError> = self.errors.into_iter().map(place).collect();
        let detail = if tells_of_places { said(&errors) } else { self.detail };
        Self { errors, detail: format!("{part}: {detail}"), ..self }
    }

    /// The same, to be tried again after some seconds.
    pub fn retry_after(self, seconds: u32) -> Self {
        Self { retry_after: Some(seconds), ..self }
    }

    fn build(code: &'static str, status: u16, title: &'static str, detail: String) -> Self {
        Self {
            r#type: format!("/docs/errors#{code}").into(),
            title: title.into(),
            status,
            code: code.into(),
            detail,
            errors: Vec::new(),
            retry_after: None,
        }
    }
}

fn said(errors: &[FieldError]) -> String {
    errors.iter().map(FieldError::to_string).collect::<Vec<_>>().join("; ")
}

impl From<SceneError> for Problem {
    fn from(error: SceneError) -> Self {
        let (status, title) = match error.kind {
            SceneErrorKind::Malformed => (400, "The scene cannot be read"),
            SceneErrorKind::Invalid => (422, "The scene cannot be rendered"),
            SceneErrorKind::TooLarge => (413, "The scene is beyond a limit of this server"),
        };
        // Maps of a request have their places in its parameters.
        let root = if error.pointer.starts_with("/params/") { "" } else { "/scene" };
        let place = FieldError { pointer: format!("{root}{}", error.pointer), detail: error.detail.clone() };
        Self { errors: vec![place], ..Self::build(error.code, status, title, error.detail) }
    }
}

impl From<CompileError> for Problem {
    fn from(error: CompileError) -> Self {
        match error {
            CompileError::Scene(error) => error.into(),
            CompileError::Params(error) => Self::fields(Code::InvalidParams, vec![error]),
        }
    }
}
