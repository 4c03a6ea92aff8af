//! From POST to the first preview and to the final picture.

use super::client::Client;
use super::server::Server;
use crate::config::Limits;
use crate::demo;
use anyhow::{Context, Result, ensure};
use serde_json::{Value, json};
use std::io::Write;
use std::time::Instant;

/// What the first bytes of a PNG are.
pub const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Stages of the report that the table shows.
const STAGES: [&str; 5] = ["compile", "queue", "device_upload", "trace", "encode"];

/// Seconds of one picture.
struct Timing {
    scene: f64,
    preview: f64,
    done: f64,
    stages: [f64; STAGES.len()],
}

/// Writes the table. Cold: a new server that has traced nothing, so that the driver compiles the kernel; warm: another
/// seed for a scene that the server has traced, best of `rounds`.
pub fn run(rounds: u32, out: &mut dyn Write) -> Result<()> {
    writeln!(out, "600 x 250 pixels, 16 samples. Seconds; from the POST of the scene's bytes, except the stages.\n")?;
    writeln!(
        out,
        "| scene | server | scene stored | first preview | picture received | of that: {} |",
        STAGES.join(" | ")
    )?;
    writeln!(out, "|---{}|", "|---".repeat(4 + STAGES.len()))?;
    for name in ["still-life", "grid", "bumpy-160k"] {
        let glb = demo::by_name(name).with_context(|| format!("there is no demo {name}"))?;
        let server = Server::start(Limits::default())?;
        let client = Client(server.address);
        write_row(out, name, "cold", &picture(client, &glb, 1)?)?;
        let mut best: Option<Timing> = None;
        for seed in 2..2 + rounds {
            let timing = picture(client, &glb, seed)?;
            if best.as_ref().is_none_or(|best| timing.done < best.done) {
                best = Some(timing);
            }
        }
        if let Some(best) = best {
            write_row(out, name, "warm", &best)?;
        }
    }
    Ok(())
}

fn picture(client: Client, glb: &[u8], seed: u32) -> Result<Timing> {
    let begun = Instant::now();
    let scene = client.upload(glb)?;
    let stored = begun.elapsed().as_secs_f64();
    let job = client.begin(&scene, &json!({"width": 600, "height": 250, "max_samples": 16, "seed": seed}))?;
    let (mut preview, mut report) = (None, Value::Null);
    client.follow(&job, |event, data| match event {
        "preview" => _ = preview.get_or_insert_with(|| begun.elapsed().as_secs_f64()),
        "completed" => report = data["report"].clone(),
        _ => {}
    })?;
    let file = client.get(&format!("/v1/jobs/{job}/result"))?.expect(200..201)?.bytes()?;
    let done = begun.elapsed().as_secs_f64();
    ensure!(file.starts_with(PNG), "the result is not a PNG");
    let seconds = |stage: &str| report["seconds"][stage].as_f64().with_context(|| format!("no stage {stage}"));
    let mut stages = [0.0; STAGES.len()];
    for (value, stage) in stages.iter_mut().zip(STAGES) {
        *value = seconds(stage)?;
    }
    // A picture that is done before a preview of it would be due is its own preview.
    Ok(Timing { scene: stored, preview: preview.unwrap_or(done), done, stages })
}

fn write_row(out: &mut dyn Write, name: &str, state: &str, timing: &Timing) -> Result<()> {
    let Timing { scene, preview, done, stages } = timing;
    let stages: Vec<String> = stages.iter().map(|seconds| format!("{seconds:.3}")).collect();
    writeln!(out, "| {name} | {state} | {scene:.3} | {preview:.3} | {done:.3} | {} |", stages.join(" | "))?;
    Ok(())
}
