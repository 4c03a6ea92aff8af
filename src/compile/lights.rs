//! What shines: punctual lights, emitters, environment, and how often each is sampled.

use super::alias;
use super::emitters::luminance;
use super::environment;
use super::light_records::{Given, of_file, of_request};
use super::motion;
use super::own_light;
use super::profiles::Profiles;
use super::walk::placed_nodes;
use super::{
    CompileError, CompiledScene, DefaultTaken, Emitter, Environment, EnvironmentKind, Hdri, LIGHTS_GROUP, LightPick,
};
use super::{Lighting, PunctualKind, PunctualLight};
use crate::params::{FieldError, Mode, ProfileParams, RenderParams, STANDING_GROUPS};
use crate::scene::{Profile, Scene, Warning};
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Share of picks that goes to all lights alike: none becomes rare because its estimate is poor.
const UNIFORM_SHARE: f64 = 0.1;

/// Directions in which the power of a light with a profile is looked for.
const PROFILE_POINTS: usize = 128;

/// Files that the light of a request names, read.
#[derive(Debug, Clone, Default)]
pub struct LightFiles {
    /// The picture of `params.environment`.
    pub hdri: Option<Arc<Hdri>>,
    /// Profiles of `params.lights`, by the names that they have there.
    pub profiles: BTreeMap<String, Arc<Profile>>,
}

impl From<Option<Arc<Hdri>>> for LightFiles {
    fn from(hdri: Option<Arc<Hdri>>) -> Self {
        Self { hdri, ..Self::default() }
    }
}

/// What shines in one request, and what is to be said of it.
#[derive(Debug)]
pub struct Lit {
    /// For kernels.
    pub lighting: Lighting,
    /// What the request left open.
    pub defaults: Vec<DefaultTaken>,
    /// Why it was chosen, if the scene brings along light of its own.
    pub warning: Option<Warning>,
}

/// Compiles everything that shines in one request.
///
/// # Errors
/// [`CompileError::Params`] if the environment's fields contradict each other or a file is missing.
pub fn light(
    scene: &Scene,
    compiled: &CompiledScene,
    params: &RenderParams,
    files: LightFiles,
) -> Result<Lit, CompileError> {
    let path = params.mode == Mode::Path;
    let mut lighting = Lighting::default();
    // Each at one moment or at several, the first of which stands for all.
    let mut profiles = Profiles::default();
    let mut lights =
        if params.scene_lights { lights_of_file(scene, compiled, params, &mut profiles)? } else { Vec::new() };
    let reaching = |way: &Vec<PunctualLight>| way.iter().any(|light| reaches(light, compiled));
    let brought_along = lights.iter().filter(|way| reaching(way)).count();
    let mut ambient = Vec3::ZERO;
    for (index, given) in params.lights.iter().enumerate() {
        match of_request(given, compiled.origin, path) {
            Given::Light(mut light) => {
                if let Some(ProfileParams { ies, .. }) = given.profile() {
                    let place = format!("/params/lights/{index}/ies");
                    let missing = || FieldError::new(&place, format!("there is no profile `{ies}`"));
                    let profile = files.profiles.get(ies).ok_or_else(missing)?;
                    profiles.lay(profile, &mut light, &place)?;
                }
                if let Some(group) = named_group(params, index) {
                    light.kind |= (group as u32) << PunctualLight::GROUP_SHIFT;
                }
                lights.push(vec![light]);
            }
            Given::Ambient(radiance) => ambient += radiance,
        }
    }
    let all = lights.len();
    lights.retain(reaching);
    lighting.skipped = (all - lights.len()) as u32;
    lighting.lights = lights.iter().filter_map(|way| way.first().copied()).collect();
    lighting.profiles = profiles.list();
    lighting.environment = environment::given(&params.environment, files.hdri)?;
    lighting.environment.ambient = ambient;
    let is_open = params.environment.is_auto();
    let is_asked_for = lights.len() > brought_along || ambient != Vec3::ZERO;
    let choice = (is_open && !is_asked_for).then(|| own_light::choose(compiled, &lighting, params.mode));
    let defaults = match &choice {
        Some(choice) if choice.neutral => environment::neutral(params.mode, &mut lighting),
        _ if is_open => vec![DefaultTaken { what: "environment".into(), value: serde_json::Value::Null }],
        _ => Vec::new(),
    };
    let neutral = &lighting.lights[lights.len()..];
    lights.extend(neutral.iter().map(|light| vec![*light]));
    if let Some(named) = &params.light_groups {
        let names = STANDING_GROUPS.into_iter().map(str::to_owned);
        lighting.groups = names.chain(named.keys().cloned()).collect();
        let unnamed = lights.iter_mut().flatten().filter(|light| light.group() == 0);
        unnamed.for_each(|light| light.kind |= (LIGHTS_GROUP as u32) << PunctualLight::GROUP_SHIFT);
    }
    lights.sort_by_key(|way| way.iter().any(|light| !light.has_extent()));
    lighting.lights = lights.iter().filter_map(|way| way.first().copied()).collect();
    lighting.way = ways(&lights);
    lighting.extended = lighting.lights.iter().filter(|light| light.has_extent()).count() as u32;
    fill_table(&mut lighting, compiled, path);
    lighting.environment_probability = environment_probability(&lighting, path);
    Ok(Lit { lighting, defaults, warning: choice.and_then(|choice| choice.warning) })
}

/// Which of [`Lighting::groups`] a light of the request was given to by name.
fn named_group(params: &RenderParams, light: usize) -> Option<usize> {
    let place = params.light_groups.as_ref()?.values().position(|lights| lights.contains(&light))?;
    Some(STANDING_GROUPS.len() + place)
}

/// Lights of the file, each at every moment of the shutter at which it is looked at.
fn lights_of_file(
    scene: &Scene,
    compiled: &CompiledScene,
    params: &RenderParams,
    profiles: &mut Profiles,
) -> Result<Vec<Vec<PunctualLight>>, CompileError> {
    let poses = motion::poses(scene, params)?;
    let poses = if poses.is_empty() { std::slice::from_ref(scene) } else { &poses[..] };
    let mut lights = Vec::new();
    for pose in poses {
        let mut index = 0;
        for placed in placed_nodes(pose, params.scene)? {
            let light = pose.nodes[placed.node].light.and_then(|index| pose.lights.get(index));
            let Some(light) = light else { continue };
            if lights.len() == index {
                lights.push(Vec::with_capacity(poses.len()));
            }
            let mut compiled_light = of_file(light, &placed, compiled.origin);
            if let Some(profile) = &light.profile {
                profiles.lay(profile, &mut compiled_light, "/extensions/EXT_lights_ies")?;
            }
            lights[index].push(compiled_light);
            index += 1;
        }
    }
    Ok(lights)
}

/// All lights at each moment, one moment after the other; empty: none moves.
fn ways(lights: &[Vec<PunctualLight>]) -> Vec<PunctualLight> {
    let place = |light: &PunctualLight| (light.position, light.direction, light.axis);
    let moves = |way: &Vec<PunctualLight>| way.windows(2).any(|pair| place(&pair[0]) != place(&pair[1]));
    if !lights.iter().any(moves) {
        return Vec::new();
    }
    let moments = lights.iter().map(Vec::len).max().unwrap_or(0);
    let at = |moment: usize| lights.iter().filter_map(move |way| way.get(moment).or(way.first()).copied());
    (0..moments).flat_map(at).collect()
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

/// Whether the light has power, and the scene is within its range.
fn reaches(light: &PunctualLight, compiled: &CompiledScene) -> bool {
    let position = Vec3::from_array(light.position).as_dvec3();
    let near = light.range.is_infinite() || compiled.bounds.distance(position) < f64::from(light.range);
    near && light.intensity.iter().any(|i| *i > 0.0)
}

/// Fills the alias table over lights, then (on paths) emitters; where there is a tree of emitters, it has the lights alone.
///
/// Weights estimate luminous flux into the sphere around the scene: lux times the sphere's disc for a directional
/// light; candela times the solid angle of the sphere for a point, or of the beam if that is smaller; pi
/// times luminance and area for each side of an emitter. Any positive weights are unbiased; these keep noise low.
fn fill_table(lighting: &mut Lighting, compiled: &CompiledScene, path: bool) {
    let emitters = if path { &compiled.emitters[..] } else { &[] };
    let trails = if path { &compiled.light_tree.trails[..] } else { &[] };
    let lights = lighting.lights.iter().map(|light| flux(light, lighting, compiled));
    let mut weights: Vec<f64> = lights.chain(emitters.iter().map(Emitter::power)).collect();
    add_floor(&mut weights);
    if !trails.is_empty() {
        let of_lights: f64 = weights[..lighting.lights.len()].iter().sum();
        lighting.tree_probability = (1.0 - of_lights / weights.iter().sum::<f64>()) as f32;
        weights.truncate(lighting.lights.len());
    }
    let (entries, probabilities) = alias::table(&weights);
    let shapes = (0..lighting.lights.len() as u32).map(|index| LightPick { index, ..LightPick::default() }).chain(
        emitters.iter().map(|e| LightPick {
            area: e.area,
            index: e.instance,
            triangle: e.triangle,
            ..LightPick::default()
        }),
    );
    lighting.picks = shapes.collect();
    for (pick, (entry, probability)) in lighting.picks.iter_mut().zip(entries.iter().zip(probabilities)) {
        (pick.keep, pick.alias, pick.probability) = (entry.keep, entry.alias, probability as f32);
    }
    for (pick, trail) in lighting.picks.iter_mut().skip(lighting.lights.len()).zip(trails) {
        pick.trail = *trail;
    }
}

/// Gives each of the weights the same in addition, [`UNIFORM_SHARE`] of all in all.
fn add_floor(weights: &mut [f64]) {
    let total: f64 = weights.iter().sum();
    let floor = if total > 0.0 { total / weights.len() as f64 * UNIFORM_SHARE / (1.0 - UNIFORM_SHARE) } else { 1.0 };
    for weight in weights {
        *weight += floor;
    }
}

fn flux(light: &PunctualLight, lighting: &Lighting, compiled: &CompiledScene) -> f64 {
    let strength = f64::from(luminance(Vec3::from_array(light.intensity)));
    let radius = compiled.bounds.radius();
    let kind = light.kind();
    if kind == PunctualKind::Directional as u32 || kind == PunctualKind::Sun as u32 {
        return strength * PI * radius * radius;
    }
    let to_centre = compiled.bounds.centre() - Vec3::from_array(light.position).as_dvec3();
    let distance = to_centre.length();
    let cap = |cosine: f64| TAU * (1.0 - cosine);
    let sphere = if distance > radius { cap((1.0 - (radius / distance).powi(2)).sqrt()) } else { 2.0 * TAU };
    let beam = match kind {
        _ if kind == PunctualKind::Spot as u32 => cap(f64::from(light.outer)),
        _ if kind == PunctualKind::SpotLinear as u32 => cap(f64::from(light.outer).cos()),
        _ if kind == PunctualKind::Cosine as u32 => PI,
        // Luminance times area is candela.
        _ if kind == PunctualKind::Sphere as u32 => return strength * 0.25 * f64::from(light.area()) * sphere,
        _ if light.has_extent() => return strength * f64::from(light.area()) * sphere.min(PI),
        _ => 2.0 * TAU,
    };
    let narrower = sphere.min(beam);
    if light.profile().is_some() {
        let axis = if beam < sphere { Vec3::from_array(light.direction).as_dvec3() } else { to_centre / distance };
        return strength * narrower * mean_candela(light, lighting, axis, 1.0 - narrower / TAU);
    }
    strength * narrower
}

/// Mean over a cone about an axis of unit length, whose edge is at a cosine from it, on a spiral of equal areas.
fn mean_candela(light: &PunctualLight, lighting: &Lighting, axis: DVec3, edge: f64) -> f64 {
    let golden = PI * (3.0 - 5.0f64.sqrt());
    let axis = if axis.is_finite() { axis } else { DVec3::Y };
    let (x, y) = axis.any_orthonormal_pair();
    let towards = |index: usize| {
        let cosine = 1.0 - (1.0 - edge) * (index as f64 + 0.5) / PROFILE_POINTS as f64;
        let (sin, cos) = (golden * index as f64).sin_cos();
        axis * cosine + (x * cos + y * sin) * (1.0 - cosine * cosine).max(0.0).sqrt()
    };
    let sum: f64 = (0..PROFILE_POINTS).map(|index| lighting.profile_factor(light, towards(index))).sum();
    sum / PROFILE_POINTS as f64
}
