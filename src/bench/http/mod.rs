//! The service over real HTTP, in this process, on a free port of this machine: from the request to the first picture
//! and to the last; and what it does under load.

pub(super) mod client;
pub(super) mod latency;
mod load;
pub(super) mod server;

use crate::render::gpu::GpuEngine;
use anyhow::Result;
use std::io::Write;

/// Runs everything and writes three tables to `out`.
///
/// # Errors
/// No usable adapter, or a reply that breaks the contract.
pub fn run(rounds: u32, out: &mut dyn Write) -> Result<()> {
    let device = GpuEngine::new()?.device().clone();
    writeln!(out, "On {}.\n", super::machine(&device))?;
    latency::run(rounds, out)?;
    writeln!(out)?;
    load::crowd(out)?;
    writeln!(out)?;
    load::overtaking(rounds, out)
}
