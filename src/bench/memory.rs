//! Memory of this process on the way from a file to the device, and the pace of the trees. Linux only: elsewhere the
//! system does not say.

use crate::compile::compile_scene;
use crate::demo;
use crate::render::Engine as _;
use crate::render::gpu::GpuEngine;
use crate::render::prepare::prepare;
use crate::scene::{self, Package};
use anyhow::{Context, Result};
use serde_json::json;
use std::io::Write;
use std::sync::Arc;

/// Resident memory of this process in bytes.
#[derive(Debug, Clone, Copy)]
struct Resident {
    now: u64,
    /// Highest since [`forget_peak`].
    peak: u64,
}

/// Loads one large scene stage by stage and writes the table to `out`. To be run in a process of its own.
///
/// # Errors
/// No `/proc`, or a device fault.
pub fn run(engine: &mut GpuEngine, demo: &str, out: &mut dyn Write) -> Result<()> {
    writeln!(out, "On {}; {demo}.\n", super::machine(engine.device()))?;
    writeln!(out, "| stage | resident, MiB | its peak, MiB | peak above the start, bytes per triangle |")?;
    writeln!(out, "|---|---|---|---|")?;
    let limits = scene::Limits::default();
    let bytes = demo::by_name(demo).with_context(|| format!("there is no demo {demo:?}"))?;
    let triangles = 1.max(triangle_count(&bytes)?);
    let start = resident()?;
    let mut row = |stage: &str| -> Result<()> {
        let Resident { now, peak } = resident()?;
        let [now_mib, peak_mib] = [now, peak].map(|bytes| bytes >> 20);
        let each = peak.saturating_sub(start.now) as f64 / triangles as f64;
        writeln!(out, "| {stage} | {now_mib} | {peak_mib} | {each:.0} |")?;
        forget_peak()
    };
    forget_peak()?;
    row(&format!("the file ({} MiB) in memory", bytes.len() >> 20))?;
    let scene = scene::import(&Package::from_bytes(bytes, &limits)?, &limits)?;
    row("imported; the file is dropped")?;
    let compiled = Arc::new(compile_scene(&scene, None)?);
    let stats = compiled.stats.clone();
    row("compiled")?;
    let params = serde_json::from_value(json!({"width": 256, "height": 256, "max_samples": 4}))?;
    let work = prepare(&scene, compiled, &params, None)?.work;
    let render = engine.begin_ready(work, None)?;
    row("on the device (a software device's memory is this process's too)")?;
    drop(render);
    let pace = stats.triangles as f64 / stats.bvh_seconds / 1e6;
    writeln!(
        out,
        "\nTrees over {} triangles: {:.2} s, {pace:.2} million triangles/s.",
        stats.triangles, stats.bvh_seconds
    )?;
    Ok(())
}

/// Triangles of the file, before its memory is watched.
fn triangle_count(bytes: &[u8]) -> Result<u64> {
    let limits = scene::Limits::default();
    let scene = scene::import(&Package::from_bytes(bytes.to_vec(), &limits)?, &limits)?;
    Ok(scene.meshes.iter().flat_map(|mesh| &mesh.primitives).map(|primitive| primitive.triangles.len() as u64).sum())
}

fn resident() -> Result<Resident> {
    let status = std::fs::read_to_string("/proc/self/status").context("this needs Linux's /proc/self/status")?;
    let field = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        let kib =
            line.and_then(|line| line.trim_start_matches(':').trim().strip_suffix(" kB")?.trim().parse::<u64>().ok());
        kib.map(|kib| kib << 10).with_context(|| format!("/proc/self/status has no {name}"))
    };
    Ok(Resident { now: field("VmRSS")?, peak: field("VmHWM")? })
}

/// Has the peak count from now (proc(5), `clear_refs`).
fn forget_peak() -> Result<()> {
    std::fs::write("/proc/self/clear_refs", "5").context("/proc/self/clear_refs cannot be written")
}
