//! `candela demo`.

use super::Failure;
use crate::demo::{DEMOS, by_name};
use clap::Args;
use std::path::PathBuf;

/// Arguments of `candela demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Name of the scene; without it, all names are listed.
    name: Option<String>,
    /// File to write; by default the name with `.glb`.
    #[arg(short, long)]
    output: Option<PathBuf>,
}

/// Writes a scene, or lists what there is.
pub fn run(arguments: &DemoArgs) -> Result<(), Failure> {
    let Some(name) = &arguments.name else {
        eprint!("{}", list());
        return Ok(());
    };
    let bytes = make(name)?;
    let path = arguments.output.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.glb")));
    std::fs::write(&path, bytes).map_err(|error| Failure::Machine(format!("cannot write {}: {error}", path.display())))
}

/// The GLB of a demo.
pub fn make(name: &str) -> Result<Vec<u8>, Failure> {
    by_name(name).ok_or_else(|| Failure::Request(format!("there is no demo {name:?}; there are:\n{}", list())))
}

fn list() -> String {
    DEMOS.iter().map(|demo| format!("  {:<12} {}\n", demo.name, demo.description)).collect()
}
