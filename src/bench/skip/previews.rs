//! Passes of a preview that its picture does not need: each is there for something that changes no pixel.

use super::compare::Pair;
use super::kernel::{compiled, demo_scene, forced, params};
use crate::render::Work;
use crate::scene::{AlphaMode, Material, Mesh, Node, Primitive, Scene};
use anyhow::{Context, Result};
use glam::{Vec3, Vec4};
use serde_json::{Value, json};
use std::sync::Arc;

/// Lights of the comparison of lists.
const LIGHTS: usize = 1000;
const SCENE: &str = "bumpy-160k";

/// All comparisons.
pub fn pairs() -> Result<Vec<Pair>> {
    let scene = demo_scene(SCENE)?;
    let sun = json!({"type": "directional", "direction": [-0.5, -1, -0.7], "intensity": 2});
    // In a corner of the scene's box, where nothing is.
    let idle = json!({"type": "point", "position": [0.95, 0.95, 0.95], "intensity": 1, "range": 0.1});
    let behind = json!({"type": "point", "position": [0, 0, 40], "intensity": 1});
    let spot = |target: f64, intensity: f64| json!({"type": "spot", "position": [0, 3, 0], "direction": [0, target, 0], "intensity": intensity, "outer_cone_degrees": 30});
    let with = |lights: Value, preview: Value| drawn(&scene, &lights, &preview);
    let plain = with(json!([sun]), json!({}))?;
    let mut pairs = vec![
        pair("preview: lights that do not reach a tile", "bumpy-160k, 1,000 lights", |culling| {
            with(strewn(), json!({"culling": !culling, "shadows": {"algorithm": "none"}}))
        })?,
        pair("preview: lists of lights, deferred", SCENE, |all| {
            with(if all { json!([sun, idle]) } else { json!([sun]) }, json!({"shadows": {"max_lights": 1}}))
        })?,
        pair("preview: lists of lights and a pass for depth, forward", SCENE, |all| {
            let lights = if all { json!([sun, idle]) } else { json!([sun]) };
            with(lights, json!({"path": "forward", "shadows": {"max_lights": 1}}))
        })?,
        pair("preview: shadow map of a light that sends nothing", SCENE, |all| {
            with(json!([sun, spot(-1.0, if all { 1e-20 } else { 0.0 })]), json!({}))
        })?,
        pair("preview: shadow map of a light that looks away", SCENE, |all| {
            with(json!([sun, if all { spot(-1.0, 1e-20) } else { spot(1.0, 5.0) }]), json!({}))
        })?,
        pair("preview: gizmos of lights behind the camera", SCENE, |all| {
            with(json!([sun, behind]), json!({"gizmos": all, "shadows": {"max_lights": 1}}))
        })?,
        forced("preview: environment", SCENE, &without_sky(&scene, &sun)?, |f| f.environment = 3)?,
        forced("preview: extensions of materials, views through glass", SCENE, &plain, |f| {
            (f.extended, f.transmission, f.volume, f.clearcoat, f.sheen) = (true, true, true, true, true);
        })?,
    ];
    pairs.push(Pair {
        what: "preview: pass over transparent triangles",
        scene: SCENE,
        full: drawn(&with_clear_triangle(scene.clone()), &json!([sun]), &json!({}))?,
        lean: plain.clone(),
    });
    pairs.push(Pair {
        what: "preview: pass over spheres",
        scene: SCENE,
        full: with_sphere(&scene, &sun)?,
        lean: plain,
    });
    Ok(pairs)
}

/// `make` is told whether to do all that could be left out.
fn pair(what: &'static str, scene: &'static str, make: impl Fn(bool) -> Result<Work>) -> Result<Pair> {
    Ok(Pair { what, scene, lean: make(false)?, full: make(true)? })
}

fn request(lights: &Value, preview: &Value) -> Value {
    let mut all = json!({"samples": 4, "shadows": {"algorithm": "pcf", "map_size": 512}});
    for (name, value) in preview.as_object().into_iter().flatten() {
        match (all.get_mut(name).and_then(Value::as_object_mut), value) {
            (Some(inner), Value::Object(value)) => inner.extend(value.clone()),
            _ => all[name] = value.clone(),
        }
    }
    let environment = json!({"constant": [0.5, 0.5, 0.5]});
    params(json!({"mode": "preview", "environment": environment, "lights": lights, "preview": all}))
}

fn drawn(scene: &Scene, lights: &Value, preview: &Value) -> Result<Work> {
    compiled(scene, request(lights, preview))
}

fn without_sky(scene: &Scene, sun: &Value) -> Result<Work> {
    let mut request = request(&json!([sun]), &json!({}));
    request["environment"] = Value::Null;
    compiled(scene, request)
}

/// Small lights all over the surface.
fn strewn() -> Value {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let light = |index: usize| {
        let y = 1.0 - 2.0 * (index as f64 + 0.5) / LIGHTS as f64;
        let (sin, cos) = (golden * index as f64).sin_cos();
        let radius = (1.0 - y * y).sqrt();
        json!({"type": "point", "position": [radius * cos, y, radius * sin], "intensity": 0.01, "range": 0.2})
    };
    (0..LIGHTS).map(light).collect()
}

/// A blended triangle through which all light goes.
fn with_clear_triangle(mut scene: Scene) -> Scene {
    let material =
        Material { base_color: Vec4::ZERO, alpha_mode: AlphaMode::Blend, double_sided: true, ..Material::default() };
    let corners = [Vec3::new(-0.1, 0.0, 0.9), Vec3::new(0.1, 0.0, 0.9), Vec3::new(0.0, 0.1, 0.9)];
    let primitive = Primitive {
        positions: corners.to_vec(),
        triangles: vec![[0, 1, 2]],
        material: Some(scene.materials.len()),
        ..Primitive::default()
    };
    scene.materials.push(material);
    let (mesh, node) = (scene.meshes.len(), scene.nodes.len());
    Arc::make_mut(&mut scene.meshes).push(Mesh { name: None, primitives: vec![primitive] });
    scene.nodes.push(Node { mesh: Some(mesh), ..Node::default() });
    scene.scenes.iter_mut().for_each(|root| root.nodes.push(node));
    scene
}

/// A sphere of a millionth of the scene, inside of it.
fn with_sphere(scene: &Scene, sun: &Value) -> Result<Work> {
    let mut request = request(&json!([sun]), &json!({}));
    request["spheres"] = json!([{"center": [0, 0, 0], "radius": 1e-6}]);
    let params = serde_json::from_value(request)?;
    let compiled = crate::compile::compile_request(scene, &params, &crate::compile::MapFiles::new())?;
    Ok(crate::render::prepare::prepare(scene, Arc::new(compiled), &params, None).context("a sphere in a scene")?.work)
}
