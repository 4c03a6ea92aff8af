//! Work outside the kernel's switches: a second level of the tree, tests of opaque texels, lights that light nothing,
//! triangles of no area, an environment that nothing sees.

use super::compare::Pair;
use super::kernel::{compiled, demo_scene, imported, params, work};
use crate::compile::{self, Triangle};
use crate::demo::{self, Burden, Use, burdened, closed_room};
use crate::render::cpu::CpuEngine;
use crate::render::reach::without_unseen_environment;
use crate::scene::{Node, Primitive, Scene};
use anyhow::{Result, ensure};
use glam::{DAffine3, DVec3};
use serde_json::{Value, json};
use std::sync::Arc;

/// Lights of a stress.
const LIGHTS: usize = 1000;

/// All comparisons.
pub fn pairs() -> Result<Vec<Pair>> {
    let white = json!({"environment": {"constant": [1, 1, 1]}});
    Ok(vec![
        second_level("bumpy-160k, one mesh", "bumpy-160k", DVec3::ZERO, white.clone())?,
        second_level("still-life, 20 meshes", "still-life", DVec3::new(0.0, -0.03, 0.5), json!({}))?,
        alpha_of_opaque_texels()?,
        useless_lights("1,000 lights of no power", &json!({"intensity": 0}))?,
        useless_lights("1,000 lights out of range", &json!({"intensity": 1, "range": 0.5}))?,
        slivers(white)?,
        unseen_environment()?,
    ])
}

/// Meshes drawn once, merged in world space; and the same with a second copy of each, a millionth the size and out of
/// sight, so that each is stored as an instance. Coordinates are rounded in another space.
fn second_level(scene_words: &'static str, demo: &str, hidden: DVec3, extra: Value) -> Result<Pair> {
    let mut scene = demo_scene(demo)?;
    let lean = compiled(&scene, params(extra.clone()))?;
    let copies: Vec<Node> = dark_meshes(&scene)
        .map(|mesh| Node {
            mesh: Some(mesh),
            local: DAffine3::from_translation(hidden) * DAffine3::from_scale(DVec3::splat(1e-6)),
            ..Node::default()
        })
        .collect();
    let first = scene.nodes.len();
    scene.nodes.extend(copies);
    let last = scene.nodes.len();
    scene.scenes[0].nodes.extend(first..last);
    Ok(Pair { what: "second level of the tree", scene: scene_words, lean, full: compiled(&scene, params(extra))? })
}

/// Meshes that do not emit: copies of lamps would be lights.
fn dark_meshes(scene: &Scene) -> impl Iterator<Item = usize> {
    let emits = |primitive: &Primitive| {
        primitive.material.and_then(|index| scene.materials.get(index)).is_some_and(|m| m.emissive.max_element() > 0.0)
    };
    scene.meshes.iter().enumerate().filter(move |(_, mesh)| !mesh.primitives.iter().any(emits)).map(|(index, _)| index)
}

/// Triangles of which no texel is transparent are known when the scene is compiled; here all are tested.
fn alpha_of_opaque_texels() -> Result<Pair> {
    let scene = demo_scene("still-life")?;
    let lean = compiled(&scene, params(json!({})))?;
    let mut tested = compile::compile_scene(&scene, None)?;
    tested.triangles.iter_mut().for_each(|triangle| triangle.material |= Triangle::ALPHA);
    let full = work(&scene, tested, params(json!({})), None)?;
    Ok(Pair { what: "alpha test of opaque triangles", scene: "still-life", lean, full })
}

/// The other way has as many lights in the same places that are just not nothing, which is what not to leave them
/// out would cost. They are picked at random beside the lamp, so that the noise is another.
fn useless_lights(what: &'static str, useless: &Value) -> Result<Pair> {
    let scene = demo_scene("plane")?;
    let lights = |fields: &Value| -> Value {
        let light = |index: usize| {
            let mut light = json!({"type": "point", "position": [index as f64 * 0.01, 50, 0]});
            light
                .as_object_mut()
                .into_iter()
                .for_each(|light| light.extend(fields.as_object().cloned().unwrap_or_default()));
            light
        };
        (0..LIGHTS).map(light).collect()
    };
    let with = |fields: &Value| compiled(&scene, params(json!({"lights": lights(fields), "max_samples": 16})));
    let full = with(&json!({"intensity": 1e-20}))?;
    Ok(Pair { what, scene: "plane under a point light", lean: with(useless)?, full })
}

/// As many triangles again, of no area; and the same with an area so small that they stay.
fn slivers(extra: Value) -> Result<Pair> {
    let [lean, full] = [Use::Unused, Use::Used].map(|use_| burdened(Burden::FlatTriangles, use_));
    Ok(Pair {
        what: "as many triangles again, of no area",
        scene: "bumpy-160k",
        lean: compiled(&imported(lean)?, params(extra.clone()))?,
        full: compiled(&imported(full)?, params(extra))?,
    })
}

/// Light samples towards a sky that no path reaches.
fn unseen_environment() -> Result<Pair> {
    let scene = imported(closed_room())?;
    let sky = demo::png(64, |u, v| [0.5 * u, 0.5 * v, 0.8, 1.0]);
    let sky = Arc::new(compile::decode_hdri(&sky, compile::ENVIRONMENT_PIXELS)?);
    let given = params(json!({"environment": {"hdri": "sky"}}));
    let full = work(&scene, compile::compile_scene(&scene, None)?, given, Some(sky))?;
    let lean = without_unseen_environment(&mut CpuEngine::new(), full.clone())?;
    ensure!(lean.lighting.environment_probability == 0.0, "the closed room is not closed");
    Ok(Pair { what: "light samples of an HDRI that nothing sees", scene: "closed room with a lamp", lean, full })
}
