//! What shines: punctual lights, emitters, environment, and how often each is sampled.

use super::alias;
use super::emitters::luminance;
use super::environment;
use super::walk::placed_nodes;
use super::{CompileError, CompiledScene, DefaultTaken, Environment, EnvironmentKind, Hdri, LightPick, Lighting};
use super::{PunctualKind, PunctualLight};
use crate::params::{LightParams, Mode, RenderParams, SpotFalloff};
use crate::scene::{Light, LightKind, Placed, Scene};
use glam::{DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Share of picks that goes to all lights alike: none becomes rare because its estimate is poor.
const UNIFORM_SHARE: f64 = 0.1;

/// Compiles everything that shines in one request. `hdri` is the picture that `params.environment` names.
///
/// # Errors
/// [`CompileError::Params`] if the environment's fields contradict each other or the picture is missing.
pub fn light(
    scene: &Scene,
    compiled: &CompiledScene,
    params: &RenderParams,
    hdri: Option<Arc<Hdri>>,
) -> Result<(Lighting, Vec<DefaultTaken>), CompileError> {
    let mut lighting = Lighting::default();
    let mut add = |light: PunctualLight| {
        if reaches(&light, compiled) {
            lighting.lights.push(light);
        } else {
            lighting.skipped += 1;
        }
    };
    if params.scene_lights {
        for placed in placed_nodes(scene, params.scene)? {
            let light = scene.nodes[placed.node].light.and_then(|index| scene.lights.get(index));
            if let Some(light) = light {
                add(of_file(light, &placed, compiled.origin));
            }
        }
    }
    let mut ambient = Vec3::ZERO;
    for given in &params.lights {
        match of_request(given, compiled.origin) {
            Given::Punctual(light) => add(light),
            Given::Ambient(radiance) => ambient += radiance,
        }
    }
    let path = params.mode == Mode::Path;
    let emits = path && !compiled.emitters.is_empty();
    let nothing_shines = lighting.lights.is_empty() && !emits && ambient == Vec3::ZERO;
    lighting.environment = environment::given(&params.environment, hdri)?;
    lighting.environment.ambient = ambient;
    let defaults = match (params.environment.is_auto(), nothing_shines) {
        (true, true) => environment::neutral(params.mode, &mut lighting),
        (true, false) => vec![DefaultTaken { what: "environment".into(), value: serde_json::Value::Null }],
        (false, _) => Vec::new(),
    };
    lighting.picks = picks(&lighting.lights, compiled, path);
    lighting.environment_probability = environment_probability(&lighting, path);
    Ok((lighting, defaults))
}

/// A sky without detail is found by the surface's own sampling; only a picture is sampled on purpose. Half of the samples where
/// lights shine too: either may dominate at a given point.
fn environment_probability(lighting: &Lighting, path: bool) -> f32 {
    match &lighting.environment.kind {
        EnvironmentKind::Hdri(_) if path && lighting.picks.is_empty() => 1.0,
        EnvironmentKind::Hdri(_) if path && shines(&lighting.environment) => 0.5,
        _ => 0.0,
    }
}

/// Whether any light comes from infinity.
pub fn shines(environment: &Environment) -> bool {
    let bright = |colour: &Vec3| colour.max_element() * environment.intensity > 0.0;
    bright_kind(&environment.kind, bright) || environment.ambient.max_element() > 0.0
}

fn bright_kind(kind: &EnvironmentKind, bright: impl Fn(&Vec3) -> bool) -> bool {
    match kind {
        EnvironmentKind::None => false,
        EnvironmentKind::Constant(colour) => bright(colour),
        EnvironmentKind::Gradient { top, horizon, bottom } => [top, horizon, bottom].into_iter().any(bright),
        EnvironmentKind::Hdri(hdri) => bright(&Vec3::splat(hdri.power)),
    }
}

fn of_file(light: &Light, placed: &Placed, origin: DVec3) -> PunctualLight {
    let (kind, inner, outer) = match light.kind {
        LightKind::Directional => (PunctualKind::Directional, 1.0, 0.0),
        LightKind::Point => (PunctualKind::Point, 1.0, 0.0),
        LightKind::Spot { inner_cone, outer_cone } => (PunctualKind::Spot, inner_cone.cos(), outer_cone.cos()),
    };
    let direction = placed.world.transform_vector3(DVec3::NEG_Z).normalize_or(DVec3::NEG_Z);
    PunctualLight {
        position: (placed.world.translation - origin).as_vec3().to_array(),
        kind: kind as u32,
        direction: direction.as_vec3().to_array(),
        range: light.range.unwrap_or(f32::INFINITY),
        intensity: light.intensity.to_array(),
        inner,
        outer,
        pad: [0.0; 3],
    }
}

enum Given {
    Punctual(PunctualLight),
    Ambient(Vec3),
}

fn of_request(light: &LightParams, origin: DVec3) -> Given {
    let place = |position: &[f64; 3]| (DVec3::from_array(*position) - origin).as_vec3().to_array();
    let unit = |direction: &[f64; 3]| DVec3::from_array(*direction).normalize_or(DVec3::NEG_Z).as_vec3().to_array();
    let scaled = |color: &[f32; 3], intensity: f32| color.map(|c| c * intensity);
    let blank = PunctualLight { range: f32::INFINITY, inner: 1.0, direction: [0.0, 0.0, -1.0], ..Default::default() };
    Given::Punctual(match light {
        LightParams::Ambient { color, intensity } => return Given::Ambient(Vec3::from_array(*color) * *intensity),
        LightParams::Directional { direction, color, intensity } => PunctualLight {
            kind: PunctualKind::Directional as u32,
            direction: unit(direction),
            intensity: scaled(color, *intensity),
            ..blank
        },
        LightParams::Point { position, color, intensity, range } => PunctualLight {
            kind: PunctualKind::Point as u32,
            position: place(position),
            intensity: scaled(color, *intensity),
            range: range.unwrap_or(f32::INFINITY),
            ..blank
        },
        LightParams::Spot {
            position,
            direction,
            color,
            intensity,
            range,
            inner_cone_degrees,
            outer_cone_degrees,
            falloff,
        } => {
            let (kind, edge): (_, fn(f32) -> f32) = match falloff {
                SpotFalloff::Gltf => (PunctualKind::Spot, f32::cos),
                SpotFalloff::Linear => (PunctualKind::SpotLinear, |angle| angle),
            };
            PunctualLight {
                kind: kind as u32,
                position: place(position),
                direction: unit(direction),
                intensity: scaled(color, *intensity),
                range: range.unwrap_or(f32::INFINITY),
                inner: edge(inner_cone_degrees.to_radians()),
                outer: edge(outer_cone_degrees.to_radians()),
                ..blank
            }
        }
    })
}

/// Whether the light has power, and the scene is within its range.
fn reaches(light: &PunctualLight, compiled: &CompiledScene) -> bool {
    let position = Vec3::from_array(light.position).as_dvec3();
    let near = light.kind == PunctualKind::Directional as u32
        || light.range.is_infinite()
        || compiled.bounds.distance(position) < f64::from(light.range);
    near && light.intensity.iter().any(|i| *i > 0.0)
}

/// The alias table over punctual lights, then (on paths) emitters.
///
/// Weights estimate luminous flux into the sphere around the scene: lux times the sphere's disc for a directional
/// light; candela times the solid angle of the sphere for a point, or of the cone if that is smaller for a spot; pi
/// times luminance and area for each side of an emitter. Any positive weights are unbiased; these keep noise low.
fn picks(lights: &[PunctualLight], compiled: &CompiledScene, emitters: bool) -> Vec<LightPick> {
    let emitters = if emitters { &compiled.emitters[..] } else { &[] };
    let punctual = lights.iter().map(|light| flux(light, compiled));
    let emitting = emitters.iter().map(|emitter| {
        let sides = if emitter.double_sided { 2.0 } else { 1.0 };
        PI * f64::from(emitter.area) * f64::from(emitter.luminance) * sides
    });
    let mut weights: Vec<f64> = punctual.chain(emitting).collect();
    let total: f64 = weights.iter().sum();
    let floor = if total > 0.0 { total / weights.len() as f64 * UNIFORM_SHARE / (1.0 - UNIFORM_SHARE) } else { 1.0 };
    for weight in &mut weights {
        *weight += floor;
    }
    let (entries, probabilities) = alias::table(&weights);
    let shapes = (0..lights.len() as u32)
        .map(|index| (0.0, index, 0))
        .chain(emitters.iter().map(|emitter| (emitter.area, emitter.instance, emitter.triangle)));
    let parts = shapes.zip(entries).zip(probabilities);
    parts
        .map(|(((area, index, triangle), entry), probability)| LightPick {
            keep: entry.keep,
            alias: entry.alias,
            probability: probability as f32,
            area,
            index,
            triangle,
            pad: [0; 2],
        })
        .collect()
}

fn flux(light: &PunctualLight, compiled: &CompiledScene) -> f64 {
    let strength = f64::from(luminance(Vec3::from_array(light.intensity)));
    let radius = compiled.bounds.radius();
    if light.kind == PunctualKind::Directional as u32 {
        return strength * PI * radius * radius;
    }
    let distance = Vec3::from_array(light.position).as_dvec3().distance(compiled.bounds.centre());
    let cap = |cosine: f64| TAU * (1.0 - cosine);
    let sphere = if distance > radius { cap((1.0 - (radius / distance).powi(2)).sqrt()) } else { 2.0 * TAU };
    let cone = match light.kind {
        kind if kind == PunctualKind::Spot as u32 => cap(f64::from(light.outer)),
        kind if kind == PunctualKind::SpotLinear as u32 => cap(f64::from(light.outer).cos()),
        _ => 2.0 * TAU,
    };
    strength * sphere.min(cone)
}
