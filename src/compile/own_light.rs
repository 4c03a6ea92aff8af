//! How well a scene is lit by what it brings along (surfaces that emit, lights of its file), and so whether a request that leaves light
//! open gets the neutral light besides.
//!
//! Presence alone says little: a lamp in a box lights a picture, the glow of a headlight lights none. So the irradiance on
//! points spread over the scene's surfaces is compared with the neutral sky's. Nothing is in the way of either.

use super::{CompiledScene, Emitter, Instance, Lighting, PunctualKind, PunctualLight};
use crate::params::Mode;
use crate::scene::Warning;
use glam::DVec3;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::sync::OnceLock;

/// Points at which light is looked for.
const POINTS: usize = 512;
/// Points of emitting triangles from which it comes.
const SOURCES: usize = 64;
/// Lights of the file times points at the most, so that a file of very many costs little.
const MOST_PAIRS: usize = 1 << 20;
/// Irradiance of the neutral sky on a surface that sees half of it, whichever half: pi times its mean radiance.
const SKY: f64 = PI * 0.7;
/// Share of the sky's light from which on a scene's own light is enough for a picture: white has a radiance of 0.1 then. Scenes that lamps
/// light have 0.2 and more; a glow has 0.01, a panel of displays 0.08 (tests, and the test scenes).
const ENOUGH: f64 = 0.15;

/// The same of lights of the file alone, which are there to light, while emission often decorates: white has a radiance of 0.02 then.
const ENOUGH_OF_LIGHTS: f64 = 0.03;

/// Points of a scene's surfaces with the light that its emitters send there, once somebody has asked for them.
#[derive(Debug, Default)]
pub struct Surface(OnceLock<Vec<Point>>);

/// A point of a surface.
#[derive(Debug, Clone, Copy)]
struct Point {
    position: DVec3,
    normal: DVec3,
    two_sided: bool,
    /// Irradiance by the scene's emitters.
    emitted: f64,
}

/// What a request gets that leaves light open.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Whether neutral light shines, too.
    pub neutral: bool,
    /// What was chosen and why, if the scene brings along light of its own.
    pub warning: Option<Warning>,
}

/// Chooses for a request without lights of its own. `lights`: those of the file that reach the scene.
pub fn choose(compiled: &CompiledScene, lights: &Lighting, mode: Mode) -> Choice {
    let glows = !compiled.emitters.is_empty();
    if lights.lights.is_empty() && !glows {
        return Choice { neutral: true, warning: None };
    }
    let (in_path, of_lights) = (share(compiled, lights, true), share(compiled, lights, false));
    let here = if mode == Mode::Path { in_path } else { of_lights };
    let is_enough = |share: f64| share >= ENOUGH || of_lights >= ENOUGH_OF_LIGHTS;
    let neutral = !is_enough(here);
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let detail = match neutral {
        true if here == in_path => format!(
            "the request leaves light open, and what the scene brings along (surfaces that emit, lights of the file) gives it {} of \
             the neutral sky's light, too little for a picture: neutral light was added. `environment: null` leaves it out",
            percent(here)
        ),
        true => {
            let in_path =
                if in_path < ENOUGH { "there, too, with neutral light" } else { "there without neutral light" };
            format!(
                "the request leaves light open, and surfaces that emit light nothing but themselves in this mode: neutral light was \
                 added. In mode path they give the scene {} of the neutral sky's light; it is shown {in_path}",
                percent(share(compiled, &Lighting::default(), true))
            )
        }
        false if lights.lights.is_empty() => format!(
            "the request leaves light open, and surfaces that emit give the scene {} of the neutral sky's light: it is lit by them \
             alone. Give an `environment` for more",
            percent(here)
        ),
        false => return Choice { neutral, warning: None },
    };
    Choice {
        neutral,
        warning: Some(Warning { code: "automatic_light", pointer: "/params/environment".into(), detail }),
    }
}

/// Light of emitters (if they count) and of lights that reaches the scene's surfaces, in terms of the neutral sky's: on the best lit quarter
/// of them, as what hides from all light, or stretches to the horizon, says nothing of the rest. A point counts for no more than the
/// sky would give it, so that few bright ones do not stand for the whole.
fn share(compiled: &CompiledScene, lights: &Lighting, emission: bool) -> f64 {
    let points = compiled.surface.0.get_or_init(|| points(compiled));
    let step = (points.len() * lights.lights.len()).div_ceil(MOST_PAIRS).max(1);
    let at = |point: &Point| {
        let emitted = if emission { point.emitted } else { 0.0 };
        let lit = lights.lights.iter().map(|light| irradiance(light, lights, point));
        let lit = lit.fold(emitted, |sum, lit| sum + lit);
        (lit / SKY).min(1.0)
    };
    let mut lit: Vec<f64> = points.iter().step_by(step).map(at).collect();
    lit.sort_by(|a, b| b.total_cmp(a));
    let best = &lit[..lit.len().div_ceil(4)];
    best.iter().fold(0.0, |sum, lit| sum + lit) / best.len().max(1) as f64
}

/// Luminous irradiance of a light of a file.
fn irradiance(light: &PunctualLight, lights: &Lighting, point: &Point) -> f64 {
    let strength = f64::from(super::emitters::luminance(light.intensity.into()));
    let axis = DVec3::from(light.direction.map(f64::from));
    if light.kind() == PunctualKind::Directional as u32 {
        return strength * point.facing(-axis);
    }
    let way = DVec3::from(light.position.map(f64::from)) - point.position;
    let distance = way.length();
    let towards = way / distance;
    let window = (1.0 - (distance / f64::from(light.range)).powi(4)).clamp(0.0, 1.0);
    // The edge of a cone is soft; here it is where the light ends.
    let beam = light.kind() != PunctualKind::Spot as u32 || towards.dot(-axis) > f64::from(light.outer);
    let strength = strength * lights.profile_factor(light, -towards);
    let lit = strength * point.facing(towards) * window / (distance * distance);
    if beam && lit.is_finite() { lit } else { 0.0 }
}

impl Point {
    /// Cosine at which light from that side arrives; of surfaces that show one side alone, at that side.
    fn facing(&self, towards: DVec3) -> f64 {
        let cosine = self.normal.dot(towards);
        if self.two_sided { cosine.abs() } else { cosine.max(0.0) }
    }

    /// Irradiance by a part of the flux of a scene's emitters that leaves another point.
    fn from(&self, source: &Self, flux: f64) -> f64 {
        let way = source.position - self.position;
        let distance = way.length();
        let towards = way / distance;
        let sides = if source.two_sided { TAU } else { PI };
        let lit = flux / sides * source.facing(-towards) * self.facing(towards) / (distance * distance);
        if lit.is_finite() { lit } else { 0.0 }
    }
}

/// Points spread over the scene by area.
fn points(scene: &CompiledScene) -> Vec<Point> {
    let meshes = meshes(scene);
    let area = |instance: &Instance| {
        let sums = meshes.get(&instance.first_triangle);
        sums.and_then(|sums| sums.last()).map_or(0.0, |area| area * instance.scale().powi(2))
    };
    let instances = running(scene.instances.iter().map(area));
    let point = |number: usize| {
        let (instance, rest) = pick(&instances, middle(number, POINTS))?;
        let instance = scene.instances.get(instance)?;
        let (triangle, _) = pick(meshes.get(&instance.first_triangle)?, rest)?;
        point_of(scene, instance, instance.first_triangle as usize + triangle, number)
    };
    let mut points: Vec<Point> = (0..POINTS).filter_map(point).collect();
    let sources = sources(scene);
    let flux = scene.emitters.iter().map(Emitter::power).sum::<f64>() / sources.len() as f64;
    for point in &mut points {
        point.emitted = sources.iter().map(|source| point.from(source, flux)).sum();
    }
    points
}

/// Points spread over what emits, by flux.
fn sources(scene: &CompiledScene) -> Vec<Point> {
    let powers = running(scene.emitters.iter().map(Emitter::power));
    let source = |number: usize| {
        let (emitter, _) = pick(&powers, middle(number, SOURCES))?;
        let emitter = scene.emitters.get(emitter)?;
        let point =
            point_of(scene, scene.instances.get(emitter.instance as usize)?, emitter.triangle as usize, number)?;
        Some(Point { two_sided: emitter.double_sided, ..point })
    };
    (0..SOURCES).filter_map(source).collect()
}

/// Of each mesh, by its first triangle, the running sums of the areas of its triangles.
fn meshes(scene: &CompiledScene) -> BTreeMap<u32, Vec<f64>> {
    let mut meshes: BTreeMap<u32, Vec<f64>> =
        scene.instances.iter().map(|instance| (instance.first_triangle, Vec::new())).collect();
    // What moves lies last, and behind it where it is later.
    let moving = scene.motion;
    let mut end = match moving.pieces {
        0 => scene.triangles.len(),
        _ => (moving.first_triangle + moving.triangles) as usize,
    };
    for (first, sums) in meshes.iter_mut().rev() {
        let first = *first as usize;
        *sums = running(scene.triangles.get(first..end).unwrap_or_default().iter().map(super::Triangle::area));
        end = first;
    }
    meshes
}

/// The `number`-th point of a triangle, in the world.
fn point_of(scene: &CompiledScene, instance: &Instance, triangle: usize, number: usize) -> Option<Point> {
    let triangle = scene.triangles.get(triangle)?;
    let two_sided = scene.materials.get(triangle.material())?.flags & super::Material::DOUBLE_SIDED != 0;
    // The sequence R2 of M. Roberts, whose points keep their distance.
    let [u, v] = [0.754_877_666_246_69, 0.569_840_290_998_05].map(|step| (0.5 + step * number as f64).fract());
    let (position, normal) = if triangle.is_sphere() {
        let (height, angle) = (1.0 - 2.0 * u, TAU * v);
        let flat = (1.0 - height * height).max(0.0).sqrt();
        let out = DVec3::new(flat * angle.cos(), height, flat * angle.sin());
        (DVec3::from(triangle.v0.map(f64::from)) + out * f64::from(triangle.v1[0]), out)
    } else {
        let [a, b, c] = [triangle.v0, triangle.v1, triangle.v2].map(|v| instance.point(v));
        let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
        (a + (b - a) * u + (c - a) * v, (b - a).cross(c - a).try_normalize()? * instance.handedness())
    };
    Some(Point { position, normal, two_sided, emitted: 0.0 })
}

/// Sums of the numbers up to each.
fn running(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sum = 0.0;
    numbers
        .map(|number| {
            sum += number;
            sum
        })
        .collect()
}

/// The entry at a part of the whole, and the part within that entry.
fn pick(sums: &[f64], part: f64) -> Option<(usize, f64)> {
    let at = part * sums.last().filter(|total| **total > 0.0 && total.is_finite())?;
    let index = sums.partition_point(|sum| *sum <= at).min(sums.len() - 1);
    let before = index.checked_sub(1).map_or(0.0, |before| sums[before]);
    Some((index, ((at - before) / (sums[index] - before)).clamp(0.0, 1.0)))
}

/// Of that many equal parts of 1, the middle of one.
fn middle(number: usize, count: usize) -> f64 {
    (number as f64 + 0.5) / count as f64
}

#[cfg(test)]
mod tests {
    use super::super::{EnvironmentKind, LightFiles, Lit, compile_scene, light};
    use super::*;
    use crate::params::RenderParams;
    use crate::scene::{self, Limits, Package, Scene};
    use std::path::Path;

    fn demo(name: &str) -> Scene {
        let limits = Limits::default();
        let package = Package::from_bytes(crate::demo::by_name(name).unwrap(), &limits).unwrap();
        scene::import(&package, &limits).unwrap()
    }

    /// As it is lit by default; and its own light's share of the sky's.
    fn by_default(scene: &Scene, mode: Mode) -> (Lit, f64) {
        let compiled = compile_scene(scene, None).unwrap();
        let params = RenderParams { mode, ..RenderParams::default() };
        let lit = light(scene, &compiled, &params, LightFiles::default()).unwrap();
        let none = Lighting::default();
        let lights = if scene.lights.is_empty() { &none } else { &lit.lighting };
        let share = share(&compiled, lights, mode == Mode::Path);
        (lit, share)
    }

    fn has_sky(lit: &Lit) -> bool {
        matches!(lit.lighting.environment.kind, EnvironmentKind::Gradient { .. })
    }

    fn why(lit: &Lit) -> &str {
        lit.warning.as_ref().map_or("", |warning| &warning.detail)
    }

    #[test]
    fn lamps_light_their_scene_alone() {
        for name in ["box", "still-life", "grid", "emitters"] {
            let (lit, share) = by_default(&demo(name), Mode::Path);
            eprintln!("{name}: {share:.3}");
            assert!(share > ENOUGH && !has_sky(&lit), "{name}: {share}");
            assert!(why(&lit).contains("lit by them alone"), "{name}: {}", why(&lit));
        }
        let (lit, _) = by_default(&demo("plane"), Mode::Path);
        assert!(!has_sky(&lit) && lit.warning.is_none(), "a light of the file");
    }

    #[test]
    fn where_emission_lights_nothing_neutral_light_stands_in() {
        for mode in [Mode::Preview, Mode::Direct] {
            let (lit, _) = by_default(&demo("box"), mode);
            assert_eq!(
                (has_sky(&lit), lit.lighting.lights.len()),
                (mode == Mode::Preview, usize::from(mode == Mode::Direct))
            );
            assert!(why(&lit).contains("nothing but themselves") && why(&lit).contains("without neutral light"));
        }
    }

    #[test]
    fn the_share_is_that_of_the_closed_form() {
        // Below the middle of a disk of radius 1 a height of 1 above, the irradiance is L pi / 2; the floor is small.
        let at = |normal: DVec3, position: DVec3| Point { position, normal, two_sided: false, emitted: 0.0 };
        let count = 4096;
        let disk = (0..count).map(|number| {
            let (radius, angle) = (middle(number, count).sqrt(), TAU * (0.618_033_988_749_9 * number as f64).fract());
            at(DVec3::NEG_Y, DVec3::new(radius * angle.cos(), 1.0, radius * angle.sin()))
        });
        let below = at(DVec3::Y, DVec3::ZERO);
        let flux = PI * PI / count as f64;
        let lit: f64 = disk.map(|source| below.from(&source, flux)).sum();
        assert!((lit - PI / 2.0).abs() < 1e-3, "{lit}");
        let point = PunctualLight {
            kind: PunctualKind::Point as u32,
            position: [0.0, 2.0, 0.0],
            range: f32::INFINITY,
            intensity: [8.0; 3],
            ..PunctualLight::default()
        };
        let irradiance = |light: &PunctualLight, at: &Point| irradiance(light, &Lighting::default(), at);
        assert!((irradiance(&point, &below) - 2.0).abs() < 1e-6);
        assert_eq!(irradiance(&point, &Point { normal: DVec3::NEG_Y, ..below }), 0.0);
        assert!(irradiance(&PunctualLight { range: 2.0, ..point }, &below) == 0.0);
    }

    #[test]
    fn a_glow_is_no_lamp() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/fidelity/models/ToyCar/ToyCar.gltf");
        let limits = Limits::default();
        let Ok(package) = Package::from_path(&file, &limits) else {
            eprintln!("SKIPPED: no {}", file.display());
            return;
        };
        let car = scene::import(&package, &limits).unwrap();
        for mode in [Mode::Path, Mode::Preview] {
            let (lit, share) = by_default(&car, mode);
            eprintln!("ToyCar: {share:.4}");
            assert!(share < 0.1 * ENOUGH && has_sky(&lit), "{share}");
            assert_eq!(lit.warning.as_ref().map(|warning| warning.code), Some("automatic_light"));
        }
        assert!(why(&by_default(&car, Mode::Path).0).contains("neutral light was added"));
    }
}
