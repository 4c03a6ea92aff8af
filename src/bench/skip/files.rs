//! What a file carries and its picture does not show: time from bytes to what can be traced.

use super::compare::{Equality, picture};
use super::kernel::{compiled, imported, params};
use crate::bench::clock::Clock;
use crate::demo::{Burden, Use, burdened};
use crate::render::Engine;
use anyhow::Result;
use serde_json::json;
use std::time::{Duration, Instant};

/// Seeds of the pictures that are compared.
const SEEDS: u32 = 2;

/// A burden, in words.
pub struct File {
    what: &'static str,
    burden: Burden,
}

/// All of them.
pub fn all() -> [File; 5] {
    [
        File { what: "8 textures of 2048 x 2048 texels", burden: Burden::Textures },
        File { what: "mesh of 1,002,528 triangles (beside 159,048)", burden: Burden::Mesh },
        File { what: "2 sets of texture coordinates of 159,048 triangles", burden: Burden::Coordinates },
        File { what: "1,000 materials, each with a mesh of 2 triangles", burden: Burden::Materials },
        File { what: "159,048 triangles of no area", burden: Burden::FlatTriangles },
    ]
}

/// Times the three files in turns, and compares their pictures. The row of the table.
pub fn measure(engine: &mut dyn Engine, file: &File, rounds: u32) -> Result<String> {
    let files = [Use::Absent, Use::Unused, Use::Used].map(|use_| burdened(file.burden, use_));
    let mut best = [Duration::MAX; 3];
    let mut pictures = [const { Vec::new() }; 3];
    for round in 0..rounds.max(SEEDS) {
        for ((file, best), pictures) in files.iter().zip(&mut best).zip(&mut pictures) {
            let begun = Instant::now();
            let scene = imported(file.clone())?;
            let work = compiled(&scene, params(json!({})))?;
            *best = (*best).min(begun.elapsed());
            if round < SEEDS {
                pictures.push(picture(engine, Clock::Wall, &work, round)?.0);
            }
        }
    }
    let [absent, unused, used] = best.map(|time| time.as_secs_f64() * 1e3);
    let equality = [1, 2].map(|other| Equality::of(&pictures[0], &pictures[other]));
    let equality =
        if equality[0] == equality[1] { equality[0].to_string() } else { format!("{}; {}", equality[0], equality[1]) };
    Ok(format!("| {} | {absent:.0} | {unused:.0} | {used:.0} | {equality} |", file.what))
}
