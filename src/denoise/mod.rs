//! Denoising by Open Image Denoise, where its library is present, in a process of its own (`candela denoise`): a native library may
//! crash, hang or take all memory, and then only that process ends.
//!
//! It trades truth for smoothness: off unless a request asks for it, named in the reply, and the stated error stays that of the
//! picture before it (docs/accuracy.md).

mod frame;
mod host;
mod oidn;
#[cfg(all(test, unix))]
mod tests;
mod wire;

pub use host::host;
pub use wire::Guidance;

use crate::film::{Guides, Picture};
use crate::process::{read_frame, write_frame};
use frame::Frame;
use serde::de::DeserializeOwned;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use wire::{Answer, Done, Hello, Task};

/// Name of the library's file.
const FILE: &str = if cfg!(windows) {
    "OpenImageDenoise.dll"
} else if cfg!(target_os = "macos") {
    "libOpenImageDenoise.2.dylib"
} else {
    "libOpenImageDenoise.so.2"
};

/// Where the system looks for what a library needs besides.
const SEARCH_PATH: &str = if cfg!(windows) {
    "PATH"
} else if cfg!(target_os = "macos") {
    "DYLD_LIBRARY_PATH"
} else {
    "LD_LIBRARY_PATH"
};

/// Longest time until the library is loaded.
const LOADING: Duration = Duration::from_secs(30);

/// Longest time that a process takes to end after its last word.
const ENDING: Duration = Duration::from_secs(2);

/// Pixels that may take the time of [`Bounds::patience`].
const MILLION: usize = 1_000_000;

/// Time between two looks at whether the picture is still wanted.
const LOOK: Duration = Duration::from_millis(50);

/// Code of the warning that a picture was not denoised although it was to be.
pub const FAILED: &str = "denoise_failed";

/// What a reply says of a picture that was denoised.
pub const BIAS: &str = "denoise: a trained network has smoothed the noise; detail may be lost or invented, and the stated error is that of \
                        the picture before (aov=undenoised)";

/// What to do where there is no library.
pub const HOW_TO_GET_IT: &str = "`script/oidn` gets it, and `--oidn FOLDER` (CANDELA_OIDN) says where it is";

/// What makes the command that starts `candela denoise`.
pub type Starter = Box<dyn Fn() -> io::Result<Command> + Send + Sync>;

/// How much one picture may take.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// Time for each million pixels begun.
    pub patience: Duration,
    /// Bytes of memory.
    pub memory: u64,
}

impl Default for Bounds {
    fn default() -> Self {
        Self { patience: Duration::from_secs(120), memory: 4 << 30 }
    }
}

/// A library that was found, and the way to use it.
pub struct Denoiser {
    start: Starter,
    library: PathBuf,
    version: String,
    bounds: Bounds,
    /// One picture at a time: it takes all cores.
    turn: Mutex<()>,
}

impl Denoiser {
    /// Looks for the library at `place`, a file or its folder, else where the system keeps libraries.
    /// `start` makes the command of a process that must [`host`] the library whose path it gets as its last argument.
    ///
    /// # Errors
    /// Why it cannot be used.
    pub fn find(start: Starter, place: Option<&Path>, bounds: Bounds) -> Result<Self, String> {
        let library = match place {
            Some(folder) if folder.is_dir() => folder.join(FILE),
            Some(file) => file.to_owned(),
            None => PathBuf::from(FILE),
        };
        let mut denoiser = Self { start, library, version: String::new(), bounds, turn: Mutex::new(()) };
        let hello: Hello = Process::start(&denoiser)?.answer(LOADING, &|| true)?;
        denoiser.version = hello.map_err(|error| format!("Open Image Denoise cannot be loaded: {error}"))?;
        Ok(denoiser)
    }

    /// The library and its version, for replies.
    pub fn name(&self) -> String {
        format!("Open Image Denoise {}", self.version)
    }

    /// The picture without its noise; coverage is left as it is. Blocks, one picture after the other. Given up once it is no longer
    /// `wanted`.
    ///
    /// # Errors
    /// What became of the process, in words.
    pub fn denoise(
        &self,
        picture: &Picture,
        guides: Option<&Guides>,
        guidance: Guidance,
        wanted: &dyn Fn() -> bool,
    ) -> Result<Picture, String> {
        let Some(frame) = Frame::of(picture) else { return Ok(picture.clone()) };
        let task = Task {
            memory: self.bounds.memory,
            width: frame.width,
            height: frame.height,
            color: frame.light(picture),
            guides: guides.map(|guides| frame.guides(guides)),
            guidance,
        };
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let mut process = Process::start(self)?;
        process.answer::<Hello>(LOADING, wanted)??;
        process.tell(task);
        let patience = self.bounds.patience * (picture.pixels.len() / MILLION) as u32 + self.bounds.patience;
        let Done { pixels } = process.answer::<Answer>(patience, wanted)??;
        frame.picture(picture, &pixels).ok_or_else(|| "its picture has values that are none".to_owned())
    }
}

/// A process that denoises, which ends with this.
struct Process {
    child: Child,
    /// Its input, once it has the task: the end of it would end the process.
    input: Option<Receiver<ChildStdin>>,
    frames: Receiver<Vec<u8>>,
}

impl Process {
    fn start(denoiser: &Denoiser) -> Result<Self, String> {
        let failed = |error: io::Error| format!("its process cannot be started: {error}");
        let mut command = (denoiser.start)().map_err(failed)?;
        command.arg(&denoiser.library);
        if let Some(folder) = denoiser.library.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            // What it needs lies beside it.
            let others = std::env::var_os(SEARCH_PATH).unwrap_or_default();
            let folders = std::iter::once(folder.to_owned()).chain(std::env::split_paths(&others));
            command.env(SEARCH_PATH, std::env::join_paths(folders).map_err(|error| error.to_string())?);
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        // An interrupt of the terminal is for the server, which lets renders end.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().map_err(failed)?;
        let (told, frames) = mpsc::channel();
        if let Some(mut output) = child.stdout.take() {
            std::thread::spawn(move || {
                while let Ok(frame) = read_frame(&mut output) {
                    if told.send(frame).is_err() {
                        return;
                    }
                }
            });
        }
        Ok(Self { child, input: None, frames })
    }

    /// Sends a task; a process that does not read is not waited for.
    fn tell(&mut self, task: Task) {
        let Some(mut input) = self.child.stdin.take() else { return };
        let (keep, kept) = mpsc::channel();
        std::thread::spawn(move || {
            let frame = postcard::to_stdvec(&task).map_err(io::Error::other);
            drop(task);
            // Who does not read gives no answer either.
            let _ = frame.and_then(|frame| write_frame(&mut input, &frame));
            let _ = keep.send(input);
        });
        self.input = Some(kept);
    }

    fn answer<T: DeserializeOwned>(&mut self, patience: Duration, wanted: &dyn Fn() -> bool) -> Result<T, String> {
        let begun = Instant::now();
        loop {
            match self.frames.recv_timeout(LOOK) {
                Ok(frame) => {
                    return postcard::from_bytes(&frame).map_err(|error| format!("its answer is none: {error}"));
                }
                Err(RecvTimeoutError::Disconnected) => return Err(format!("its process has ended: {}", self.end())),
                Err(RecvTimeoutError::Timeout) if !wanted() => {
                    return Err("nobody wants the picture any more".to_owned());
                }
                Err(RecvTimeoutError::Timeout) if begun.elapsed() < patience => {}
                Err(RecvTimeoutError::Timeout) => return Err(format!("no answer for {} s", patience.as_secs())),
            }
        }
    }

    /// How a process has ended that says no more.
    fn end(&mut self) -> String {
        let begun = Instant::now();
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return status.to_string(),
                Ok(None) if begun.elapsed() < ENDING => std::thread::sleep(LOOK),
                Ok(None) => return "it has closed its output, and went on".to_owned(),
                Err(error) => return error.to_string(),
            }
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
