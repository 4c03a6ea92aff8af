//! `candela engine`, `candela import` and `candela denoise`: the processes that `candela serve` has for what may crash, hang or be killed.

use super::Failure;
use crate::denoise::{self, Bounds, Denoiser};
use crate::jobs::Trial;
use crate::render::{Engines, host};
use std::io;
use std::path::Path;
use std::process::Command;

/// Steps of priority that the engine stands back behind the server.
#[cfg(unix)]
const NICE: i32 = 5;

/// What starts this program anew.
///
/// # Errors
/// The program does not know where it lies.
pub fn command(subcommand: &str) -> io::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command.arg(subcommand);
    Ok(command)
}

/// Serves the engines of this machine on standard input and output, to the end of the input.
///
/// # Errors
/// Whoever asked has gone.
pub fn engine() -> Result<(), Failure> {
    // Replies come before samples: where the cores are few, whoever is refused is so at once. A system that does not allow it loses that alone.
    #[cfg(unix)]
    let _ = rustix::process::nice(NICE);
    tracing_subscriber::fmt().with_writer(io::stderr).with_max_level(tracing::Level::WARN).with_ansi(false).init();
    let served = host(|| Box::new(Engines::new()), io::stdin(), io::stdout());
    served.map_err(|error| Failure::Machine(format!("the engine's process: {error}")))
}

/// Reads a scene from standard input.
///
/// # Errors
/// Whoever asked has gone.
pub fn import() -> Result<(), Failure> {
    Trial::sit(io::stdin().lock()).map_err(|error| Failure::Machine(format!("the process that reads a scene: {error}")))
}

/// Denoises the picture of standard input with a library.
///
/// # Errors
/// Whoever asked has gone.
pub fn denoise(library: &Path) -> Result<(), Failure> {
    denoise::host(library, io::stdin(), io::stdout())
        .map_err(|error| Failure::Machine(format!("the process that denoises: {error}")))
}

/// Looks for the library that denoises, in a process of its own.
///
/// # Errors
/// Why it cannot be used, and how to get it.
pub fn denoiser(place: Option<&Path>, bounds: Bounds) -> Result<Denoiser, String> {
    Denoiser::find(Box::new(|| command("denoise")), place, bounds)
        .map_err(|why| format!("{why} ({})", denoise::HOW_TO_GET_IT))
}
