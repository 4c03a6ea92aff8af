//! What it saves to leave out what a picture does not need, and that the picture stays the same.

mod compare;
mod files;
pub(super) mod kernel;
mod pairs;
mod previews;
mod reuse;

use super::clock::Clock;
use crate::render::gpu::GpuEngine;
use anyhow::Result;
use std::io::Write;

/// Runs comparisons with `rounds` interleaved rounds and writes tables to `out`: all three, or of the first table those rows that have
/// one of `words` in their names.
///
/// # Errors
/// A device fault.
pub fn run(engine: &mut GpuEngine, words: &[String], rounds: u32, out: &mut dyn Write) -> Result<()> {
    let clock = Clock::of(engine.device());
    let machine = super::machine(engine.device());
    writeln!(out, "On {machine}; best of {rounds} interleaved rounds; {}, files by the wall's.\n", clock.words())?;
    writeln!(out, "| left out | scene | with it, ms | left out, ms | ratio | pictures |")?;
    writeln!(out, "|---|---|---|---|---|---|")?;
    for pairs in [kernel::pairs, pairs::pairs, previews::pairs] {
        let wanted = |pair: &compare::Pair| words.is_empty() || words.iter().any(|word| pair.what.contains(word));
        for pair in pairs()?.into_iter().filter(wanted) {
            writeln!(out, "{}", compare::trace(engine, clock, &pair, rounds)?)?;
        }
    }
    if !words.is_empty() {
        return Ok(());
    }
    writeln!(
        out,
        "\n| in the file, not in the picture | not in the file, ms | not drawn, ms | drawn, ms | pictures |"
    )?;
    writeln!(out, "|---|---|---|---|---|")?;
    for file in files::all() {
        writeln!(out, "{}", files::measure(engine, &file, rounds)?)?;
    }
    writeln!(out, "\n| done once | scene | first, ms | again, ms |")?;
    writeln!(out, "|---|---|---|---|")?;
    reuse::measure(engine, rounds, out)
}
