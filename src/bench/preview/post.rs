//! From POST to PNG: a preview of a scene that the server has compiled.

use crate::bench::http::client::Client;
use crate::bench::http::latency::PNG;
use crate::bench::http::server::Server;
use crate::config::Limits;
use crate::demo;
use crate::scene::{self, Package};
use anyhow::{Context, Result, ensure};
use serde_json::{Value, json};
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Stages of the report that the table shows.
const STAGES: [&str; 5] = ["compile", "queue", "device_upload", "trace", "encode"];

/// Writes a table: medians over `rounds` jobs of 512 x 512 pixels after one that warms up, each of another camera. `models`: glTF
/// files beside the demos.
///
/// # Errors
/// A file that cannot be read, or a reply that breaks the contract.
pub fn run(models: &[PathBuf], rounds: u32, out: &mut dyn Write) -> Result<()> {
    writeln!(out, "| scene | frames | POST to PNG, ms | of that: {} |", STAGES.join(" | "))?;
    writeln!(out, "|---|---{}|", "|---".repeat(1 + STAGES.len()))?;
    let server = Server::start(Limits::default())?;
    let client = Client(server.address);
    for (name, glb) in files(models)? {
        let scene = client.upload(&glb)?;
        for samples in [1, 4] {
            picture(client, &scene, samples, 0)?;
            let mut timings = Vec::new();
            for round in 1..=rounds {
                timings.push(picture(client, &scene, samples, round)?);
            }
            let median = |index: usize| {
                let mut values: Vec<f64> = timings.iter().map(|timing| timing[index]).collect();
                values.sort_by(f64::total_cmp);
                format!("{:.0}", 1e3 * values[values.len() / 2])
            };
            let cells: Vec<String> = (0..=STAGES.len()).map(median).collect();
            writeln!(out, "| {name} | {samples} | {} |", cells.join(" | "))?;
        }
    }
    Ok(())
}

fn files(models: &[PathBuf]) -> Result<Vec<(String, Vec<u8>)>> {
    let demo =
        |name: &str| Ok((name.to_owned(), demo::by_name(name).with_context(|| format!("there is no demo {name}"))?));
    let mut files: Vec<(String, Vec<u8>)> =
        ["still-life", "grid", "box"].into_iter().map(demo).collect::<Result<_>>()?;
    for path in models {
        let bytes = packed(path).with_context(|| path.display().to_string())?;
        // Found out here what is wrong with it, rather than from a reply.
        let limits = scene::Limits::default();
        scene::import(&Package::from_bytes(bytes.clone(), &limits)?, &limits)
            .with_context(|| path.display().to_string())?;
        let name = path.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy().into_owned());
        files.push((name, bytes));
    }
    Ok(files)
}

/// A file as it is; a .gltf as a zip of its folder.
fn packed(path: &Path) -> Result<Vec<u8>> {
    let (true, Some(folder)) = (path.extension().is_some_and(|end| end == "gltf"), path.parent()) else {
        return Ok(std::fs::read(path)?);
    };
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for entry in std::fs::read_dir(folder)? {
        let file = entry?.path();
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        if file.is_file() {
            zip.start_file(name, SimpleFileOptions::default().compression_method(CompressionMethod::Stored))?;
            zip.write_all(&std::fs::read(file)?)?;
        }
    }
    Ok(zip.finish()?.into_inner())
}

/// Seconds in all, then of the stages.
fn picture(client: Client, scene: &str, samples: u32, round: u32) -> Result<Vec<f64>> {
    let params = json!({
        "mode": "preview", "width": 512, "height": 512, "preview": {"samples": samples},
        "camera": {"orbit": {"azimuth_degrees": 10 * round, "elevation_degrees": 20}},
        "lights": [{"type": "directional", "direction": [-0.5, -1, -0.4], "intensity": 2}],
    });
    let begun = Instant::now();
    let body = json!({"scene": scene, "params": params}).to_string();
    let headers = [("content-type", "application/json"), ("prefer", "wait=60"), ("accept", "image/png")];
    let reply = client.send("POST", "/v1/jobs", &headers, body.as_bytes())?.expect(200..201)?;
    let job = reply.header("candela-job").context("the reply names no job")?.to_owned();
    let file = reply.bytes()?;
    let total = begun.elapsed().as_secs_f64();
    ensure!(file.starts_with(PNG), "the result is not a PNG");
    let job: Value = client.get(&format!("/v1/jobs/{job}"))?.expect(200..201)?.json()?;
    let seconds = |stage: &&str| job["report"]["seconds"][*stage].as_f64().with_context(|| format!("no stage {stage}"));
    let stages: Vec<f64> = STAGES.iter().map(seconds).collect::<Result<_>>()?;
    Ok(std::iter::once(total).chain(stages).collect())
}
