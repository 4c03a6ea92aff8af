//! `candela doctor`.

use super::{Failure, apart};
use crate::demo;
use crate::denoise::Bounds;
use crate::jobs::audit_folder;
use crate::params::{EngineChoice, Mode, RenderParams};
use crate::render::gpu::has_hardware_adapter;
use crate::render::prepare::{prepare, render_to_end};
use crate::render::{Engines, RenderError};
use crate::scene::{self, Limits, Package};
use crate::{compile, config};
use anyhow::{Context, Result, anyhow, ensure};
use clap::Args;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Bytes written to see whether the disk takes them.
const TRIAL: usize = 1 << 20;

/// Arguments of `candela doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// A data folder to check, which no server may use meanwhile.
    #[arg(long, env = "CANDELA_DATA", value_name = "FOLDER")]
    pub data: Option<PathBuf>,
    /// Library of Open Image Denoise, or its folder.
    #[arg(long, env = "CANDELA_OIDN", value_name = "FILE|FOLDER")]
    pub oidn: Option<PathBuf>,
}

/// Looks at everything, says what it finds, and fails if something is not in order.
pub fn run(arguments: &DoctorArgs) -> Result<(), Failure> {
    let mut findings = vec![
        ("version", Ok(env!("CARGO_PKG_VERSION").to_owned())),
        ("processor", picture(EngineChoice::Cpu, Mode::Path)),
        ("graphics", graphics()),
        ("preview", preview()),
        ("denoise", denoise(arguments.oidn.as_deref())),
        ("memory", Ok(memory())),
    ];
    if let Some(folder) = &arguments.data {
        findings.push(("disk", disk(folder)));
        findings.push(("ledger", ledger(folder)));
    }
    let mut out = std::io::stdout().lock();
    let mut faults = 0;
    for (what, found) in findings {
        let (mark, text) = match found {
            Ok(text) => ("ok", text),
            Err(error) => {
                faults += 1;
                ("FAULT", format!("{error:#}"))
            }
        };
        let written = writeln!(out, "{mark:<6} {what:<10} {text}");
        written.map_err(|error| Failure::Machine(format!("standard output: {error}")))?;
    }
    if faults > 0 { Err(Failure::Machine(format!("{faults} of these are not in order"))) } else { Ok(()) }
}

/// Renders a small picture.
fn picture(engine: EngineChoice, mode: Mode) -> Result<String> {
    let glb = demo::by_name("grid").context("there is no demo grid")?;
    let limits = Limits::default();
    let scene = scene::import(&Package::from_bytes(glb, &limits)?, &limits)?;
    let params = RenderParams { engine, mode, width: 64, height: 32, max_samples: 16, ..RenderParams::default() };
    let compiled = Arc::new(compile::compile_scene(&scene, None)?);
    let prepared = prepare(&scene, compiled, &params, None)?;
    let rendered = render_to_end(&mut Engines::new(), prepared.work, &mut |_| {})?;
    let dropped = rendered.non_finite.nan + rendered.non_finite.infinite;
    ensure!(dropped == 0, "{dropped} samples of a small picture were not finite");
    let (device, seconds) = (rendered.device, rendered.trace.as_secs_f64());
    Ok(format!("{} ({}, {}); a small picture took {seconds:.3} s", device.name, device.backend, device.driver))
}

/// Without a graphics card all is in order, too: the processor renders.
fn graphics() -> Result<String> {
    if !has_hardware_adapter() {
        return Ok("no graphics card; `engine: auto` is the processor".to_owned());
    }
    picture(EngineChoice::Gpu, Mode::Path)
}

/// Previews are drawn by graphics drivers alone, one in software if need be.
fn preview() -> Result<String> {
    picture(EngineChoice::Gpu, Mode::Preview).or_else(|error| match error.downcast_ref() {
        Some(RenderError::NoAdapter(_)) => {
            Ok("no graphics driver, not even one in software (Mesa's lavapipe): `mode: preview` will fail".to_owned())
        }
        _ => Err(error),
    })
}

/// Without a library all is in order, too, unless one was named: `denoise: true` is refused.
fn denoise(place: Option<&Path>) -> Result<String> {
    match apart::denoiser(place, Bounds::default()) {
        Ok(denoiser) => Ok(denoiser.name()),
        Err(why) if place.is_some() => Err(anyhow!(why)),
        Err(why) => Ok(format!("`denoise: true` will be refused: {why}")),
    }
}

fn memory() -> String {
    let limits = config::Limits::default();
    let bounds = limits.render_memory_bytes + limits.import_memory_bytes + limits.upload_memory_bytes;
    let mib = |bytes: u64| bytes >> 20;
    let present = std::fs::read_to_string("/proc/meminfo").ok();
    let kib = present.as_deref().and_then(|text| text.lines().find_map(|line| line.strip_prefix("MemAvailable:")));
    let kib: Option<u64> = kib.and_then(|text| text.split_whitespace().next()?.parse().ok());
    let there = kib.map_or_else(|| "unknown here".to_owned(), |kib| format!("{} MiB", kib >> 10));
    format!("{there} available; renders, imports and uploads may take up to {} MiB by default", mib(bounds))
}

fn disk(folder: &Path) -> Result<String> {
    let trial = folder.join("doctor.tmp");
    let begun = Instant::now();
    let written = std::fs::File::create(&trial).and_then(|mut file| {
        file.write_all(&vec![0; TRIAL])?;
        file.sync_all()
    });
    let removed = std::fs::remove_file(&trial);
    written.with_context(|| format!("{} cannot be written", folder.display()))?;
    removed.with_context(|| format!("{} cannot be removed", trial.display()))?;
    Ok(format!("{} takes 1 MiB in {:.1} ms", folder.display(), begun.elapsed().as_secs_f64() * 1e3))
}

fn ledger(folder: &Path) -> Result<String> {
    ensure!(folder.join("ledger.sqlite").is_file(), "{} holds no ledger", folder.display());
    let runtime = tokio::runtime::Builder::new_current_thread().build()?;
    let faults = runtime.block_on(audit_folder(folder))?;
    ensure!(faults.is_empty(), "{} rules are broken:\n  {}", faults.len(), faults.join("\n  "));
    Ok("every rule holds, every file is there and unchanged".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_none_is_a_fault() {
        let folder = tempfile::tempdir().unwrap();
        assert!(disk(folder.path()).is_ok());
        assert!(ledger(folder.path()).unwrap_err().to_string().contains("no ledger"));
        assert!(disk(&folder.path().join("nothing")).is_err());
    }

    #[test]
    fn the_processor_renders() {
        assert!(picture(EngineChoice::Cpu, Mode::Path).unwrap().contains("cpu"));
    }

    #[test]
    fn a_preview_is_drawn_or_said_to_be_impossible() {
        let said = preview().unwrap();
        assert!(said.contains("a small picture took") || said.contains("no graphics driver"), "{said}");
    }
}
