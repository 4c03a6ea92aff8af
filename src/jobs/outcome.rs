//! What came of a render: what a client is told of it, and where its pictures lie.

use super::blobs::BlobRef;
use crate::film::{Aovs, Picture};
use crate::params::ImageFormat;
use crate::render::report::Report;
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// A file with what the client needs to know of it.
#[derive(Debug, Clone)]
pub struct Encoded {
    /// The file.
    pub bytes: Bytes,
    /// Its format.
    pub format: ImageFormat,
    /// Hash of the bytes, quoted.
    pub etag: String,
}

/// A picture of the unfinished render.
#[derive(Debug, Clone)]
pub struct Preview {
    /// Counts from 1 within the job, since the server started.
    pub number: u64,
    /// The file: JPEG, or PNG where the background is transparent.
    pub file: Encoded,
}

/// What came of a render.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Its facts.
    pub record: Record,
    /// The file in the format of the request.
    pub file: BlobRef,
    /// A [`Developed`], from which every other format is made; none: it has left to make room.
    pub picture: Option<BlobRef>,
}

/// The report of a render in the forms in which it leaves the server.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// As JSON.
    pub report: Value,
    /// For the file and the headers.
    pub facts: Vec<(String, String)>,
    /// Seconds per stage, for a header.
    pub seconds: String,
    /// Samples per pixel.
    pub samples: u32,
    /// Measured relative error.
    pub error: Option<f64>,
    /// The error is below this with 95 % confidence.
    pub error_bound_95: Option<f64>,
    /// As [`Report::is_repeatable`].
    pub repeatable: bool,
}

impl Record {
    /// What is kept of a report.
    pub fn new(report: &Report) -> Self {
        Self {
            report: json!(report),
            facts: report.facts(),
            seconds: report.stage_line(),
            samples: report.samples,
            error: report.error,
            error_bound_95: report.error_bound_95,
            repeatable: report.is_repeatable(),
        }
    }
}

/// First byte of a stored [`Developed`]; another one once its shape changes.
const SHAPE: u8 = 3;

/// A picture before tone mapping and encoding.
#[derive(Debug, Serialize, Deserialize)]
pub struct Developed {
    /// Scene-linear picture.
    pub picture: Picture,
    /// What is known of each pixel besides.
    pub aovs: Aovs,
}

impl Developed {
    /// As it is stored.
    pub fn to_bytes(&self) -> Result<Bytes, postcard::Error> {
        postcard::to_stdvec(&(SHAPE, self)).map(Bytes::from)
    }

    /// Back from the store; none: another version has stored it.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (&shape, rest) = bytes.split_first()?;
        (shape == SHAPE).then(|| postcard::from_bytes(rest).ok()).flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::Film;

    #[test]
    fn what_is_stored_is_read_back() {
        let film = Film::new(17, 9);
        let developed = Developed { picture: film.picture(), aovs: film.aovs() };
        let back = Developed::from_bytes(&developed.to_bytes().unwrap()).unwrap();
        assert_eq!(back.picture, developed.picture);
        assert!(Developed::from_bytes(b"nothing of that kind").is_none());
    }
}
