//! Lights of the file and of the request, as kernels read them.

use super::{PunctualKind, PunctualLight};
use crate::params::{LightParams, ProfileParams, SpotFalloff};
use crate::scene::{Light, LightKind, Placed};
use glam::{DVec3, Vec3};
use std::f32::consts::FRAC_PI_2;

/// Where luminaires that hang shine.
const DOWN: [f64; 3] = [0.0, -1.0, 0.0];

/// What a light of the request becomes.
pub enum Given {
    /// One of the lights.
    Light(PunctualLight),
    /// Radiance from all sides.
    Ambient(Vec3),
}

/// A light of the file.
pub fn of_file(light: &Light, placed: &Placed, origin: DVec3) -> PunctualLight {
    let (kind, inner, outer) = match light.kind {
        LightKind::Directional => (PunctualKind::Directional, 1.0, 0.0),
        LightKind::Point => (PunctualKind::Point, 1.0, 0.0),
        LightKind::Spot { inner_cone, outer_cone } => (PunctualKind::Spot, inner_cone.cos(), outer_cone.cos()),
    };
    let direction = placed.world.transform_vector3(DVec3::NEG_Z).normalize_or(DVec3::NEG_Z);
    let zero = light.profile.as_ref().map(|_| aside(direction, placed.world.transform_vector3(DVec3::X)));
    PunctualLight {
        position: (placed.world.translation - origin).as_vec3().to_array(),
        kind: kind as u32,
        direction: direction.as_vec3().to_array(),
        range: light.range.unwrap_or(f32::INFINITY),
        intensity: light.intensity.to_array(),
        inner,
        outer,
        axis: zero.unwrap_or(DVec3::ZERO).as_vec3().to_array(),
    }
}

/// A light of the request. `with_extent`: lights may have one; otherwise points stand in for them that send the same light afar.
pub fn of_request(light: &LightParams, origin: DVec3, with_extent: bool) -> Given {
    let place = |position: &[f64; 3]| (DVec3::from_array(*position) - origin).as_vec3().to_array();
    let scaled = |color: &[f32; 3], intensity: f32| color.map(|c| c * intensity);
    let blank = PunctualLight { range: f32::INFINITY, inner: 1.0, direction: [0.0, 0.0, -1.0], ..Default::default() };
    let light = match light {
        LightParams::Ambient { color, intensity } => return Given::Ambient(Vec3::from_array(*color) * *intensity),
        LightParams::Directional { direction, color, intensity, angular_diameter_degrees, visible } => PunctualLight {
            kind: PunctualKind::Sun.record(*visible),
            direction: unit(direction).as_vec3().to_array(),
            intensity: scaled(color, *intensity),
            inner: versine(0.5 * f64::from(*angular_diameter_degrees).to_radians()),
            ..blank
        },
        LightParams::Point { position, direction, color, intensity, range, profile } => PunctualLight {
            kind: PunctualKind::Point as u32,
            position: place(position),
            direction: unit(&direction.unwrap_or(DOWN)).as_vec3().to_array(),
            axis: zero(profile.as_ref(), unit(&direction.unwrap_or(DOWN))),
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
            profile,
        } => {
            let (kind, edge): (_, fn(f32) -> f32) = match falloff {
                SpotFalloff::Gltf => (PunctualKind::Spot, f32::cos),
                SpotFalloff::Linear => (PunctualKind::SpotLinear, |angle| angle),
            };
            PunctualLight {
                kind: kind as u32,
                position: place(position),
                direction: unit(direction).as_vec3().to_array(),
                intensity: scaled(color, *intensity),
                range: range.unwrap_or(f32::INFINITY),
                inner: edge(inner_cone_degrees.to_radians()),
                outer: edge(outer_cone_degrees.to_radians()),
                axis: zero(profile.as_ref(), unit(direction)),
            }
        }
        LightParams::Rect { position, direction, up, width, height, color, intensity, visible } => PunctualLight {
            kind: PunctualKind::Rect.record(*visible),
            position: place(position),
            direction: unit(direction).as_vec3().to_array(),
            intensity: scaled(color, *intensity),
            inner: 0.5 * width,
            outer: 0.5 * height,
            axis: across(unit(direction), unit(up)).as_vec3().to_array(),
            ..blank
        },
        LightParams::Disk { position, direction, radius, color, intensity, visible } => PunctualLight {
            kind: PunctualKind::Disk.record(*visible),
            position: place(position),
            direction: unit(direction).as_vec3().to_array(),
            intensity: scaled(color, *intensity),
            inner: *radius,
            ..blank
        },
        LightParams::Sphere { position, radius, color, intensity, visible } => PunctualLight {
            kind: PunctualKind::Sphere.record(*visible),
            position: place(position),
            intensity: scaled(color, *intensity),
            inner: *radius,
            ..blank
        },
    };
    Given::Light(if light.has_extent() && (light.inner == 0.0 || !with_extent) { stand_in(&light) } else { light })
}

/// The light without an extent that lights what is far away alike: parallel light, a point, or a point whose intensity goes with
/// the cosine from its axis.
fn stand_in(light: &PunctualLight) -> PunctualLight {
    let area = light.area();
    let (kind, intensity, inner, outer) = match light.kind() {
        kind if kind == PunctualKind::Sun as u32 => (PunctualKind::Directional, light.intensity, 1.0, 0.0),
        kind if kind == PunctualKind::Sphere as u32 => (PunctualKind::Point, times(light, 0.25 * area), 1.0, 0.0),
        _ => (PunctualKind::Cosine, times(light, area), 0.0, FRAC_PI_2),
    };
    PunctualLight { kind: kind as u32, intensity, inner, outer, axis: [0.0; 3], ..*light }
}

/// Radiance times an area, no more than f32 holds.
fn times(light: &PunctualLight, area: f32) -> [f32; 3] {
    light.intensity.map(|radiance| (radiance * area).min(f32::MAX))
}

/// Of unit length.
fn unit(direction: &[f64; 3]) -> DVec3 {
    DVec3::from_array(*direction).normalize_or(DVec3::NEG_Z)
}

/// The zero azimuth of a light's profile, if it has one.
fn zero(profile: Option<&ProfileParams>, direction: DVec3) -> [f32; 3] {
    profile.map_or([0.0; 3], |profile| aside(direction, unit(&profile.zero_azimuth)).as_vec3().to_array())
}

/// The part of a vector at right angles to a direction, of unit length; any such, if there is none.
fn aside(direction: DVec3, vector: DVec3) -> DVec3 {
    let rest = vector.normalize_or_zero();
    let rest = rest - rest.dot(direction) * direction;
    if rest.length() > 1e-6 { rest.normalize() } else { direction.any_orthonormal_vector() }
}

/// At right angles to both; if they are parallel, to the first.
fn across(direction: DVec3, up: DVec3) -> DVec3 {
    direction.cross(up).try_normalize().unwrap_or_else(|| direction.any_orthonormal_vector())
}

/// 1 - cos, without cancellation.
fn versine(angle: f64) -> f32 {
    (2.0 * (0.5 * angle).sin().powi(2)) as f32
}
