//! What is done once for a scene: its second picture needs neither upload nor pipeline.

use super::kernel::{demo_scene, params};
use crate::compile::compile_scene;
use crate::render::Engine;
use crate::render::prepare::prepare;
use anyhow::Result;
use serde_json::json;
use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Writes the rows. The first time is that of a scene that the device has not seen, its pipeline being there already.
pub fn measure(engine: &mut dyn Engine, rounds: u32, out: &mut dyn Write) -> Result<()> {
    for demo in ["still-life", "bumpy-1m"] {
        let scene = demo_scene(demo)?;
        let params = serde_json::from_value(params(json!({})))?;
        let (mut first, mut again) = (Duration::MAX, Duration::MAX);
        for _ in 0..rounds {
            let work = prepare(&scene, Arc::new(compile_scene(&scene, None)?), &params, None)?.work;
            for best in [&mut first, &mut again] {
                let begun = Instant::now();
                drop(engine.begin_ready(work.clone(), None)?);
                *best = (*best).min(begun.elapsed());
            }
        }
        let [first, again] = [first, again].map(|time| time.as_secs_f64() * 1e3);
        writeln!(out, "| scene to the device | {demo} | {first:.1} | {again:.1} |")?;
    }
    Ok(())
}
