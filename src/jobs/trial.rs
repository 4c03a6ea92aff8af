//! A scene is read by a process of its own first, which can be killed: whoever hangs, or takes all memory, or falls over it
//! is that process. What it has read well is then read here, in the same way.

use super::problem::{Code, Problem};
use crate::process::{read_frame, restrict_memory, write_frame};
use crate::scene::{self, Limits, Package};
use serde::{Deserialize, Serialize};
use std::io::{self, Read, Write};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Longest pause between two looks at the process.
const LOOK: Duration = Duration::from_millis(10);

/// How scenes are tried.
pub struct Trial {
    /// Makes what starts the process, which must do [`Trial::sit`].
    pub command: Box<dyn Fn() -> io::Result<Command> + Send + Sync>,
    /// Longest time that it may take.
    pub patience: Duration,
    /// Bytes of memory that it may take.
    pub memory: u64,
}

/// What the process is told: its memory, the limits of a scene, and how many files follow.
#[derive(Serialize, Deserialize)]
struct Task {
    memory: u64,
    limits: Limits,
    files: Vec<(String, u64)>,
}

impl Trial {
    /// Reads the files elsewhere. Blocks. What is wrong with them will be found here, too: only a reader that does not end well counts.
    ///
    /// # Errors
    /// It took too long or too much memory, or crashed.
    pub fn hold(&self, package: &Package, limits: &Limits) -> Result<(), Problem> {
        let begun = Instant::now();
        let unavailable = |error: io::Error| {
            tracing::error!(%error, "the process that reads scenes cannot be started");
            Problem::new(Code::Internal, "the process that reads scenes could not be started")
        };
        let mut process = (self.command)()
            .and_then(|mut command| command.stdin(Stdio::piped()).stdout(Stdio::null()).spawn())
            .map_err(unavailable)?;
        let task = Task {
            memory: self.memory,
            limits: limits.clone(),
            files: package.files().map(|(name, bytes)| (name.to_owned(), bytes.len() as u64)).collect(),
        };
        let files: Vec<_> = package.files().map(|(_, bytes)| std::sync::Arc::clone(bytes)).collect();
        if let Some(mut input) = process.stdin.take() {
            // A process that does not read is not waited for.
            std::thread::spawn(move || -> io::Result<()> {
                let task = postcard::to_stdvec(&task).map_err(io::Error::other)?;
                write_frame(&mut input, &task)?;
                files.iter().try_for_each(|file| input.write_all(file))
            });
        }
        let mut pause = Duration::from_micros(500);
        loop {
            match process.try_wait() {
                Ok(Some(status)) if status.success() => return Ok(()),
                Ok(Some(status)) => return Err(self.fell(status)),
                Ok(None) if begun.elapsed() < self.patience => std::thread::sleep(pause),
                Ok(None) => {
                    // It may have ended just now.
                    let _ = process.kill();
                    let _ = process.wait();
                    return Err(self.too_slow());
                }
                Err(error) => return Err(unavailable(error)),
            }
            pause = (pause * 2).min(LOOK);
        }
    }

    fn too_slow(&self) -> Problem {
        let seconds = self.patience.as_secs();
        let detail = format!(
            "reading this scene took longer than {seconds} s and was ended (GET /v1/limits, import_seconds); make it simpler"
        );
        Problem::new(Code::ImportFailed, detail)
    }

    fn fell(&self, status: ExitStatus) -> Problem {
        tracing::error!(%status, "the process that read a scene has not ended well");
        let detail = format!(
            "what reads scenes did not get through this one: it needs more than {} bytes of memory (GET /v1/limits, \
             import_memory_bytes), or it is a fault of the server; please report it",
            self.memory
        );
        Problem::new(Code::ImportFailed, detail)
    }

    /// What the process does: reads the files on its standard input as [`scene::import()`] does.
    ///
    /// # Errors
    /// Whoever asked has gone.
    pub fn sit(mut input: impl Read) -> io::Result<()> {
        let task = read_frame(&mut input)?;
        let Task { memory, limits, files } = postcard::from_bytes(&task).map_err(io::Error::other)?;
        restrict_memory(memory)?;
        let mut parts = Vec::new();
        for (name, length) in files {
            let mut bytes = Vec::new();
            input.by_ref().take(length).read_to_end(&mut bytes)?;
            parts.push((name, bytes));
        }
        // Good or bad: it came to an end.
        let _ = Package::from_parts(parts, &limits).and_then(|package| scene::import(&package, &limits));
        Ok(())
    }
}
