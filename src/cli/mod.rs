//! The command line: one file per subcommand.

mod apart;
mod bench;
mod demo;
mod doctor;
mod key;
mod manifest;
mod progress;
mod remote;
mod render;
mod request;
mod serve;
mod stop;
mod summary;
mod traces;

use crate::config::ServeConfig;
use clap::{Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// A render server: POST a glTF, get a path-traced picture back, with its measured error.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Renders for clients over HTTP.
    Serve(Box<ServeConfig>),
    /// Renders one picture, or those of a manifest, without a server or by one.
    Render(render::RenderArgs),
    /// Makes, lists and revokes API keys.
    Key(key::KeyArgs),
    /// Writes one of the scenes that Candela makes itself.
    Demo(demo::DemoArgs),
    /// Says what this machine has, and whether it is in order.
    Doctor(doctor::DoctorArgs),
    /// Measures this machine.
    Bench(bench::BenchArgs),
    /// Traces for `candela serve`, which starts this by itself.
    #[command(hide = true)]
    Engine,
    /// Reads a scene for `candela serve`, which starts this by itself.
    #[command(hide = true)]
    Import,
    /// Denoises a picture for other commands, which start this by themselves.
    #[command(hide = true)]
    Denoise {
        /// Library of Open Image Denoise.
        library: PathBuf,
    },
}

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// What was asked for is at fault: exit code 2.
    #[error("{0}")]
    Request(String),
    /// The machine is at fault: exit code 1.
    #[error("{0}")]
    Machine(String),
}

impl Failure {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Request(_) => 2,
            Self::Machine(_) => 1,
        }
    }
}

/// Does what the arguments of the process say. Exit code 2: they, the parameters or the scene are at fault; 1: the machine.
pub fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Serve(config) => serve::run(*config),
        Command::Render(arguments) => render::run(&arguments),
        Command::Key(arguments) => key::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Doctor(arguments) => doctor::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Engine => apart::engine(),
        Command::Import => apart::import(),
        Command::Denoise { library } => apart::denoise(&library),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("candela: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}
