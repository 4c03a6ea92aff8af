//! Pictures that benchmarks of error render: scenes that Candela makes itself, and the cases that other renderers were given.

use super::skip::kernel::{compiled, demo_scene, imported, work};
use crate::compile::{ENVIRONMENT_PIXELS, compile_scene, decode_hdri};
use crate::render::Work;
use anyhow::{Context, Result};
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// All cases with their names, `side` pixels square. `peers`: a folder with a folder `cases`, if there is one.
///
/// # Errors
/// A case that cannot be read.
pub fn all(side: u32, samples: u32, peers: Option<&Path>) -> Result<Vec<(String, Work)>> {
    let mut cases = demos(side, samples)?;
    match peers {
        Some(folder) => cases.extend(peer_cases(folder, side, samples)?),
        None => eprintln!("SKIPPED: the peers' cases; give their folder as --peers"),
    }
    Ok(cases)
}

/// Scenes that Candela makes itself.
fn demos(side: u32, samples: u32) -> Result<Vec<(String, Work)>> {
    let white = json!({"constant": [1, 1, 1]});
    let afar = json!({"position": [0, 1, 14], "target": [0, 1, 0], "yfov_degrees": 36});
    let cases = [
        ("still-life", json!({})),
        ("box", json!({})),
        ("box from afar", json!({"camera": afar})),
        ("detail", json!({})),
        ("grid", json!({})),
        ("bumpy-10k in white", json!({"environment": white})),
        ("furnace", json!({})),
        ("plane", json!({})),
        ("emitters", json!({})),
        ("instances", json!({})),
    ];
    let case = |(name, extra): (&str, Value)| {
        let demo = name.split(' ').next().unwrap_or(name);
        Ok((format!("demo {name}"), compiled(&demo_scene(demo)?, params(side, samples, extra))?))
    };
    cases.into_iter().map(case).collect()
}

fn params(side: u32, samples: u32, extra: Value) -> Value {
    let mut params = json!({"width": side, "height": side, "max_samples": samples});
    if let (Some(params), Value::Object(extra)) = (params.as_object_mut(), extra) {
        params.extend(extra);
    }
    params
}

/// What a peer's case says that we need.
#[derive(Deserialize)]
struct PeerCase {
    scene: String,
    camera: PeerCamera,
    environment: PeerEnvironment,
    max_depth: u32,
}

#[derive(Deserialize)]
struct PeerCamera {
    position: Value,
    target: Value,
    up: Value,
    vfov_deg: f64,
}

#[derive(Deserialize)]
struct PeerEnvironment {
    hdr: Option<String>,
    constant: Option<Value>,
    #[serde(default)]
    rotation_deg: f64,
}

fn peer_cases(folder: &Path, side: u32, samples: u32) -> Result<Vec<(String, Work)>> {
    let cases = folder.join("cases");
    let mut found = Vec::new();
    for name in ["cornell", "helmet", "grid", "bigmesh"] {
        if folder.join("glb").join(format!("{name}.glb")).exists() {
            found.push(peer_case(&cases, name, side, samples)?);
        } else {
            eprintln!("SKIPPED: the peers' {name}; its GLB is not there");
        }
    }
    Ok(found)
}

fn peer_case(folder: &Path, name: &str, side: u32, samples: u32) -> Result<(String, Work)> {
    let read = |file: &str| {
        let path = folder.join(file);
        std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))
    };
    let case: PeerCase = serde_json::from_slice(&read(&format!("{name}.json"))?)?;
    let PeerCamera { position, target, up, vfov_deg } = case.camera;
    let mut extra = json!({
        "max_bounces": case.max_depth, "filter": {"kind": "box"},
        "camera": {"position": position, "target": target, "up": up, "yfov_degrees": vfov_deg},
    });
    let PeerEnvironment { hdr, constant, rotation_deg } = case.environment;
    extra["environment"] = match &hdr {
        Some(file) => json!({"hdri": file, "rotation_degrees": rotation_deg}),
        None => json!({"constant": constant}),
    };
    let hdri = hdr.map(|file| anyhow::Ok(Arc::new(decode_hdri(&read(&file)?, ENVIRONMENT_PIXELS)?))).transpose()?;
    let scene = imported(read(&case.scene)?)?;
    let compiled = compile_scene(&scene, None)?;
    Ok((format!("peers' {name}"), work(&scene, compiled, params(side, samples, extra), hdri)?))
}
