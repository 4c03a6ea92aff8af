//! More clients than places, and a small job beside a long one.

use super::client::Client;
use super::latency::PNG;
use super::server::Server;
use crate::config::Limits;
use crate::demo;
use anyhow::{Context, Result, ensure};
use serde_json::json;
use std::io::Write;
use std::time::{Duration, Instant};

const CLIENTS: usize = 20;
const QUEUE: usize = 4;

/// What became of one request.
enum Fate {
    /// A picture, after so long.
    Picture(Duration),
    /// Refused, after so long.
    Refused(Duration),
}

/// 20 clients post at once to a server of two renders at a time and a queue of four.
///
/// # Errors
/// A job that was accepted and gave no picture, or a refusal without `Retry-After`.
pub fn crowd(out: &mut dyn Write) -> Result<()> {
    let glb = demo::by_name("grid").context("there is no demo grid")?;
    let server = Server::start(Limits { queue_length: QUEUE, active_renders: 2, ..Limits::default() })?;
    let client = Client(server.address);
    let fates: Vec<Fate> = std::thread::scope(|scope| {
        let clients: Vec<_> = (0..CLIENTS)
            .map(|seed| (seed, &glb))
            .map(|(seed, glb)| scope.spawn(move || one_shot(client, glb, seed)))
            .collect();
        clients
            .into_iter()
            .map(|client| client.join().unwrap_or_else(|_| Err(anyhow::anyhow!("a client panicked"))))
            .collect::<Result<_>>()
    })?;
    let pictures: Vec<_> =
        fates.iter().filter_map(|fate| if let Fate::Picture(time) = fate { Some(*time) } else { None }).collect();
    let refusals: Vec<_> =
        fates.iter().filter_map(|fate| if let Fate::Refused(time) = fate { Some(*time) } else { None }).collect();
    let slowest = |times: &[Duration]| {
        times.iter().max().map_or_else(|| "-".to_owned(), |time| format!("{:.2}", time.as_secs_f64()))
    };
    writeln!(
        out,
        "{CLIENTS} clients at once, 256 x 256 pixels, 16 samples; two renders at a time, a queue of {QUEUE}.\n"
    )?;
    writeln!(out, "| accepted, all with a picture | slowest, s | refused, all with Retry-After | slowest, s |")?;
    writeln!(out, "|---|---|---|---|")?;
    writeln!(out, "| {} | {} | {} | {} |", pictures.len(), slowest(&pictures), refusals.len(), slowest(&refusals))?;
    Ok(())
}

fn one_shot(client: Client, glb: &[u8], seed: usize) -> Result<Fate> {
    let begun = Instant::now();
    let path = format!("/v1/render?width=256&height=256&max_samples=16&seed={seed}");
    let reply = client.send("POST", &path, &[("content-type", "model/gltf-binary")], glb)?;
    if reply.status == 503 {
        let seconds = reply.header("retry-after").and_then(|seconds| seconds.parse::<u32>().ok());
        ensure!(seconds.is_some_and(|seconds| seconds > 0), "a refusal without Retry-After");
        return Ok(Fate::Refused(begun.elapsed()));
    }
    let file = reply.expect(200..201)?.bytes()?;
    ensure!(file.starts_with(PNG), "the result is not a PNG");
    Ok(Fate::Picture(begun.elapsed()))
}

/// A picture of 240 x 100 pixels and 4 samples, on an idle server and while a render of a minute is under way.
pub fn overtaking(rounds: u32, out: &mut dyn Write) -> Result<()> {
    let server = Server::start(Limits::default())?;
    let client = Client(server.address);
    let scene = client.upload(&demo::by_name("still-life").context("there is no demo still-life")?)?;
    // The kernel is compiled by the first.
    preview(client, &scene, 0)?;
    let idle = latencies(client, &scene, 1, rounds)?;
    let long = json!({"max_samples": 1_000_000, "deadline_ms": 60_000});
    let long = client.begin(&scene, &long)?;
    let running = || -> Result<bool> {
        let job: serde_json::Value = serde_json::from_slice(&client.get(&format!("/v1/jobs/{long}"))?.bytes()?)?;
        Ok(job["state"] == "running" && job["progress"]["fraction"].as_f64().is_some_and(|done| done > 0.0))
    };
    while !running()? {
        std::thread::sleep(Duration::from_millis(50));
    }
    let busy = latencies(client, &scene, 1 + rounds, rounds)?;
    ensure!(running()?, "the long render ended too soon to tell");
    client.post(&format!("/v1/jobs/{long}/cancel"), &json!({}))?;
    writeln!(out, "A picture of 240 x 100 pixels, 4 samples, from its POST to its last byte; {rounds} times.\n")?;
    writeln!(out, "| server | best, s | median, s | worst, s |")?;
    writeln!(out, "|---|---|---|---|")?;
    for (state, times) in [("idle", idle), ("1200 x 500 pixels of a minute under way", busy)] {
        let [best, median, worst] = [0, times.len() / 2, times.len() - 1].map(|place| times[place].as_secs_f64());
        writeln!(out, "| {state} | {best:.3} | {median:.3} | {worst:.3} |")?;
    }
    Ok(())
}

/// In ascending order.
fn latencies(client: Client, scene: &str, first_seed: u32, rounds: u32) -> Result<Vec<Duration>> {
    let mut times: Vec<_> =
        (first_seed..first_seed + rounds).map(|seed| preview(client, scene, seed)).collect::<Result<_>>()?;
    times.sort();
    Ok(times)
}

fn preview(client: Client, scene: &str, seed: u32) -> Result<Duration> {
    let begun = Instant::now();
    let params = json!({"width": 240, "height": 100, "max_samples": 4, "seed": seed});
    let body = json!({"scene": scene, "params": params}).to_string();
    let headers = [("content-type", "application/json"), ("prefer", "wait=60")];
    let file = client.send("POST", "/v1/jobs", &headers, body.as_bytes())?.expect(200..201)?.bytes()?;
    ensure!(file.starts_with(PNG), "the result is not a PNG");
    Ok(begun.elapsed())
}
