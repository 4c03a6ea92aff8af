//! The process that denoises: it loads the library, says what it has found, and makes one picture.

use super::oidn::{Inputs, Oidn, Plane};
use super::wire::{Answer, Done, Guidance, Hello, Task};
use crate::process::{read_frame, restrict_memory, write_frame};
use serde::Serialize;
use std::ffi::CStr;
use std::io::{self, Read, Write};
use std::path::Path;

/// Part of the memory that the library is told to keep to: the rest is for pictures, and for what it cannot help.
const SHARE: u64 = 2;

/// Address space that each of the library's threads may take for its stack and its heap.
const PER_THREAD: u64 = 80 << 20;

/// Serves whoever writes to `asks` and reads `answers`; ends with them.
///
/// # Errors
/// Nobody reads the answers, or what was asked cannot be read.
pub fn host(library: &Path, mut asks: impl Read + Send + 'static, mut answers: impl Write) -> io::Result<()> {
    let library = Oidn::load(library);
    let hello: Hello = library.as_ref().map(Oidn::version).map_err(Clone::clone);
    say(&mut answers, &hello)?;
    let Ok(oidn) = library else { return Ok(()) };
    let frame = match read_frame(&mut asks) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
        frame => frame?,
    };
    // Whoever asked keeps its end open until it has the answer: when it goes, nobody is left to end a library that hangs.
    std::thread::spawn(move || {
        let _ = asks.read(&mut [0]);
        std::process::exit(0);
    });
    let task: Task = postcard::from_bytes(&frame).map_err(io::Error::other)?;
    drop(frame);
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get) as u64;
    restrict_memory(task.memory.saturating_add(threads * PER_THREAD))?;
    let answer: Answer = denoise(&oidn, task).map(|pixels| Done { pixels });
    say(&mut answers, &answer)
}

fn say(answers: &mut impl Write, answer: &impl Serialize) -> io::Result<()> {
    write_frame(answers, &postcard::to_stdvec(answer).map_err(io::Error::other)?)
}

fn denoise(oidn: &Oidn, task: Task) -> Result<Vec<[f32; 3]>, String> {
    let Task { memory, width, height, color, guides, guidance } = task;
    let filter = |images: &[(&'static CStr, &Plane)], clean| {
        let (width, height, memory) = (width as usize, height as usize, memory / SHARE);
        oidn.filter(&Inputs { images, width, height, clean, memory })
    };
    let Some(guides) = guides.filter(|_| guidance != Guidance::None) else {
        return filter(&[(c"color", &color)], false);
    };
    let (mut albedo, mut normal) = (guides.albedo, guides.normal);
    let clean = guidance == Guidance::Prefiltered;
    if clean {
        albedo = filter(&[(c"albedo", &albedo)], false)?;
        normal = filter(&[(c"normal", &normal)], false)?;
    }
    filter(&[(c"color", &color), (c"albedo", &albedo), (c"normal", &normal)], clean)
}
