//! Parts of the kernel that the scene does not need: each is switched on where there is nothing for it to do.
//!
//! Not among them: the orthographic projection, which is another picture; a second level, which needs another tree
//! (`pairs`); and textures that are read, for which there is nothing but to read them.

use super::compare::Pair;
use crate::compile::{self, CompiledScene, Features, Hdri};
use crate::demo;
use crate::render::Work;
use crate::render::prepare::prepare;
use crate::scene::{self, Package, Scene};
use anyhow::{Context, Result, ensure};
use glam::{Vec3, Vec4};
use serde_json::{Value, json};
use std::sync::Arc;

/// Picture and samples of every comparison; `extra` has the other parameters.
pub fn params(extra: Value) -> Value {
    let mut params = json!({"width": 256, "height": 256, "max_samples": 4});
    if let (Some(params), Value::Object(extra)) = (params.as_object_mut(), extra) {
        params.extend(extra);
    }
    params
}

/// A scene that Candela makes itself, imported.
pub fn demo_scene(name: &str) -> Result<Scene> {
    imported(demo::by_name(name).with_context(|| format!("there is no demo {name}"))?)
}

/// A file, imported.
pub fn imported(glb: Vec<u8>) -> Result<Scene> {
    let limits = scene::Limits::default();
    Ok(scene::import(&Package::from_bytes(glb, &limits)?, &limits)?)
}

/// Work for a compiled scene.
pub fn work(scene: &Scene, compiled: CompiledScene, params: Value, hdri: Option<Arc<Hdri>>) -> Result<Work> {
    Ok(prepare(scene, Arc::new(compiled), &serde_json::from_value(params)?, hdri)?.work)
}

/// Work for a scene.
pub fn compiled(scene: &Scene, params: Value) -> Result<Work> {
    work(scene, compile::compile_scene(scene, None)?, params, None)
}

/// Switches a part of the kernel on.
type Switch = fn(&mut Features);

/// All comparisons.
pub fn pairs() -> Result<Vec<Pair>> {
    let white = params(json!({"environment": {"constant": [1, 1, 1]}}));
    let bumpy = compiled(&demo_scene("bumpy-160k")?, white.clone())?;
    let of_bumpy: [(&str, Switch); 10] = [
        ("alpha test", |f| f.alpha = true),
        ("base colour textures", |f| f.base_color_texture = true),
        ("metallic-roughness textures", |f| f.metallic_roughness_texture = true),
        ("normal maps", |f| f.normal_texture = true),
        ("emissive textures", |f| f.emissive_texture = true),
        ("unlit materials", |f| f.unlit = true),
        ("perfect mirrors", |f| f.mirror = true),
        ("thin lens", |f| f.thin_lens = true),
        ("spheres", |f| f.spheres = true),
        ("height, normal and parallax maps", |f| f.detail = true),
    ];
    let mut pairs: Vec<Pair> = Vec::new();
    for (what, force) in of_bumpy {
        pairs.push(forced(what, "bumpy-160k", &bumpy, force)?);
    }
    pairs.push(forced("all of these at once", "bumpy-160k", &bumpy, |f| {
        of_bumpy.iter().for_each(|(_, force)| force(f));
    })?);
    let open_box = compiled(&demo_scene("box")?, params(json!({})))?;
    pairs.push(forced("punctual lights", "box, lit by a lamp", &open_box, |f| f.punctual = true)?);
    pairs.push(forced("constant environment", "box, no environment", &open_box, |f| f.environment = 1)?);
    pairs.push(forced("gradient environment", "box, no environment", &open_box, |f| f.environment = 2)?);
    pairs.push(forced("HDRI environment", "box, no environment", &open_box, |f| f.environment = 3)?);
    let plane = compiled(&demo_scene("plane")?, params(json!({})))?;
    pairs.push(forced("emitting triangles", "plane under a point light", &plane, |f| f.emitters = true)?);
    pairs.push(one_sided(white.clone())?);
    pairs.push(specular(white.clone())?);
    pairs.push(normals(white.clone())?);
    pairs.push(colors(white)?);
    Ok(pairs)
}

/// The same work with more of the kernel.
pub fn forced(what: &'static str, scene: &'static str, lean: &Work, force: impl FnOnce(&mut Features)) -> Result<Pair> {
    let mut full = lean.clone();
    force(&mut full.features);
    ensure!(full.features != lean.features, "{what}: {scene} needs it");
    Ok(Pair { what, scene, lean: lean.clone(), full })
}

fn one_sided(params: Value) -> Result<Pair> {
    let mut scene = demo_scene("bumpy-160k")?;
    scene.materials.iter_mut().for_each(|material| material.double_sided = true);
    let work = compiled(&scene, params)?;
    forced("one-sided materials", "bumpy-160k, double-sided", &work, |f| f.one_sided = true)
}

fn specular(params: Value) -> Result<Pair> {
    let mut scene = demo_scene("bumpy-160k")?;
    scene.materials.iter_mut().for_each(|material| material.unlit = true);
    let work = compiled(&scene, params)?;
    forced("specular lobe", "bumpy-160k, unlit", &work, |f| f.specular = true)
}

/// Normals of length zero: the surface is flat all the same.
fn normals(params: Value) -> Result<Pair> {
    let mut scene = demo_scene("bumpy-160k")?;
    edit_primitives(&mut scene, |primitive| primitive.normals = None);
    let lean = compiled(&scene, params.clone())?;
    edit_primitives(&mut scene, |primitive| primitive.normals = Some(vec![Vec3::ZERO; primitive.positions.len()]));
    Ok(Pair { what: "vertex normals", scene: "bumpy-160k, flat", lean, full: compiled(&scene, params)? })
}

/// White vertices.
fn colors(params: Value) -> Result<Pair> {
    let mut scene = demo_scene("bumpy-160k")?;
    let lean = compiled(&scene, params.clone())?;
    edit_primitives(&mut scene, |primitive| primitive.colors = Some(vec![Vec4::ONE; primitive.positions.len()]));
    Ok(Pair { what: "vertex colours", scene: "bumpy-160k", lean, full: compiled(&scene, params)? })
}

fn edit_primitives(scene: &mut Scene, edit: impl Fn(&mut scene::Primitive)) {
    Arc::make_mut(&mut scene.meshes).iter_mut().flat_map(|mesh| &mut mesh.primitives).for_each(edit);
}
