//! The results of a batch as one zip, which is sent while it is made.

use super::App;
use crate::jobs::{Batch, Job, Problem, State, describe_item};
use axum::body::Bytes;
use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::mpsc;
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use zip::CompressionMethod;
use zip::write::{SimpleFileOptions, StreamWriter, ZipWriter};

/// Bytes of a piece on its way.
const PIECE: usize = 256 << 10;

/// Name of the last entry: a line of JSON per job.
const INDEX: &str = "results.ndjson";

type Piece = io::Result<Bytes>;

/// Waits for each job in turn and sends its picture; then how all of them ended. The stream breaks off if the server shuts down.
pub fn stream(app: App, batch: Arc<Batch>) -> impl Stream<Item = Piece> {
    let (sender, receiver) = mpsc::channel(1);
    tokio::spawn(async move {
        if let Err(error) = send(&app, &batch, &sender).await {
            // Whoever reads must not take a part for the whole.
            let _ = sender.send(Err(error)).await;
        }
    });
    ReceiverStream::new(receiver)
}

async fn send(app: &App, batch: &Batch, sender: &mpsc::Sender<Piece>) -> io::Result<()> {
    let mut archive = Archive::new();
    let mut index = String::new();
    let mut closed = app.service.closed();
    for job in &batch.jobs {
        tokio::select! {
            () = job.finished() => {}
            () = sender.closed() => return Ok(()),
            _ = closed.wait_for(|closed| *closed) => return Err(io::Error::other("the server shuts down")),
        }
        let file = match picture(app, job).await {
            Ok(Some((name, bytes))) => {
                archive = archive.add(name.clone(), bytes).await?;
                Some(name)
            }
            Ok(None) => None,
            Err(problem) => return Err(io::Error::other(problem.detail)),
        };
        let mut line = describe_item(job);
        line["file"] = file.into();
        index += &format!("{line}\n");
        if !archive.flush(sender).await {
            return Ok(());
        }
    }
    archive = archive.add(INDEX.to_owned(), Bytes::from(index)).await?;
    let Archive { writer, buffer } = archive;
    writer.finish()?;
    flush(&buffer, sender).await;
    Ok(())
}

/// Name and content of a job's file, if it has one.
async fn picture(app: &App, job: &Job) -> Result<Option<(String, Bytes)>, Problem> {
    if job.state() != State::Succeeded {
        return Ok(None);
    }
    let format = job.spec.params.output.format;
    let file = app.service.result(job, format).await?;
    let stem = job.spec.place.as_ref().map_or(job.spec.id.as_str(), |place| &place.name);
    Ok(Some((format!("{stem}.{}", format.extension()), file.bytes)))
}

/// A zip whose beginning has been sent.
struct Archive {
    writer: ZipWriter<StreamWriter<Buffer>>,
    buffer: Buffer,
}

/// What has been written and not been sent.
#[derive(Clone, Default)]
struct Buffer(Arc<Mutex<Vec<u8>>>);

impl Buffer {
    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Buffer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Archive {
    fn new() -> Self {
        let buffer = Buffer::default();
        Self { writer: ZipWriter::new_stream(buffer.clone()), buffer }
    }

    /// Pictures are packed already.
    async fn add(mut self, name: String, bytes: Bytes) -> io::Result<Self> {
        let written = tokio::task::spawn_blocking(move || {
            let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
            self.writer.start_file(name, options)?;
            self.writer.write_all(&bytes)?;
            Ok(self)
        });
        written.await.unwrap_or_else(|error| Err(io::Error::other(error)))
    }

    async fn flush(&self, sender: &mpsc::Sender<Piece>) -> bool {
        flush(&self.buffer, sender).await
    }
}

/// Sends what was written; false if nobody listens.
async fn flush(buffer: &Buffer, sender: &mpsc::Sender<Piece>) -> bool {
    let mut bytes = Bytes::from(buffer.take());
    while !bytes.is_empty() {
        let piece = bytes.split_to(bytes.len().min(PIECE));
        if sender.send(Ok(piece)).await.is_err() {
            return false;
        }
    }
    true
}
