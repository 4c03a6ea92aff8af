//! Shadow maps' frusta, fitted to what can cast a shadow and, for suns, to what the camera sees.

use super::layout::Projection;
use crate::compile::{Bounds, Lens, PunctualKind, PunctualLight, View};
use crate::params::MAX_SHADOW_LIGHTS;
use glam::{Vec3, Vec4};

/// Maps of all lights together, as in `shaders/preview/bindings.wesl`: six for each light that may cast shadows.
pub const MAX_FACES: usize = 6 * MAX_SHADOW_LIGHTS as usize;

/// Half angles beyond which one map is too coarse at its middle, and a cube of six is taken.
const WIDEST: f32 = 1.1;
/// Nearest surface that a map shows, in parts of the farthest.
const NEAREST: f32 = 1e-4;
/// Room at the edges of a map.
const MARGIN: f32 = 1.001;
/// Part of the scene's map below which what the camera sees gets a map of its own.
const WORTH_A_MAP: f32 = 0.5;
/// Faces of a cube overlap, so that no direction falls between two of them.
const CUBE_SCALE: f32 = 0.999;

/// The maps of a light, of which the first one that has a place in it tells of it: none if its shadows cannot reach the scene.
pub fn fit(light: &PunctualLight, bounds: &Bounds, view: &View) -> Vec<Projection> {
    let direction = Vec3::from_array(light.direction);
    if light.kind == PunctualKind::Directional as u32 {
        return sun(direction, bounds, view);
    }
    let position = Vec3::from_array(light.position);
    let to_centre = bounds.centre().as_vec3() - position;
    let (distance, radius) = (to_centre.length(), bounds.radius() as f32);
    // Half angle under which the scene is seen.
    let scene_angle = if distance > radius { (radius / distance).asin() } else { f32::INFINITY };
    let towards_centre = to_centre.normalize_or(direction);
    let cone = match light.kind {
        kind if kind == PunctualKind::Point as u32 => None,
        kind if kind == PunctualKind::Spot as u32 => Some(light.outer.clamp(-1.0, 1.0).acos()),
        _ => Some(light.outer),
    };
    if let Some(cone) = cone {
        let off_axis = direction.dot(towards_centre).clamp(-1.0, 1.0).acos();
        if off_axis >= cone + scene_angle {
            return Vec::new();
        }
        let needed = cone.min(off_axis + scene_angle);
        if needed < WIDEST {
            return vec![perspective(position, direction, needed.max(1e-3), bounds)];
        }
    }
    if scene_angle < WIDEST {
        return vec![perspective(position, towards_centre, scene_angle.max(1e-3), bounds)];
    }
    let axes = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let faces = axes.map(|axis| cube_face(position, axis, bounds));
    faces.into_iter().filter(|face| sees(face, bounds)).collect()
}

/// Corners of the box.
fn corners(bounds: &Bounds) -> impl Iterator<Item = Vec3> {
    bounds.corners().into_iter().map(|corner| corner.as_vec3())
}

/// Axes of a view along `forward`.
fn axes(forward: Vec3) -> [Vec3; 3] {
    let forward = forward.normalize_or(Vec3::NEG_Z);
    let (right, up) = forward.any_orthonormal_pair();
    [right, up, forward]
}

fn rows(axes: [Vec3; 3], origin: Vec3) -> [[f32; 4]; 3] {
    axes.map(|axis| axis.extend(-axis.dot(origin)).to_array())
}

/// A map of the whole scene, and before it one of what the camera sees, where that is a small part: the first is still needed for what
/// is seen through glass.
fn sun(direction: Vec3, bounds: &Bounds, view: &View) -> Vec<Projection> {
    let axes = axes(direction);
    let whole = axes.map(|axis| range(corners(bounds), axis));
    let seen = seen(bounds, view);
    let mut part = whole;
    for (range_of, axis) in part.iter_mut().zip(axes).take(2) {
        let [low, high] = range(seen.iter().copied(), axis);
        *range_of = [range_of[0].max(low), range_of[1].min(high)];
    }
    let side = |of: &[[f32; 2]; 3]| (of[0][1] - of[0][0]).max(of[1][1] - of[1][0]);
    let narrower = side(&part) > 0.0 && side(&part) < WORTH_A_MAP * side(&whole);
    narrower.then_some(part).into_iter().chain([whole]).map(|ranges| parallel(axes, ranges)).collect()
}

/// Least and largest coordinate along an axis.
fn range(points: impl Iterator<Item = Vec3>, axis: Vec3) -> [f32; 2] {
    points.map(|p| axis.dot(p)).fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
}

/// Corners of the part of the camera's frustum that holds what it sees of the box; none if it sees nothing of it.
fn seen(bounds: &Bounds, view: &View) -> Vec<Vec3> {
    let eye = Vec3::from(view.to_world.translation);
    let m = view.to_world.matrix3;
    let [right, up, forward] = [m.x_axis, m.y_axis, -m.z_axis].map(Vec3::from);
    let [nearest, farthest] = range(corners(bounds).map(|corner| corner - eye), forward);
    if farthest <= 0.0 {
        return Vec::new();
    }
    // Pixels are filtered over their edges.
    let border = 1.0 + 4.0 / view.height.min(view.width).max(1) as f32;
    let aspect = view.width as f32 / view.height.max(1) as f32;
    let half_height = |ahead: f32| match view.lens {
        Lens::Perspective { tan_half_yfov, .. } => tan_half_yfov * ahead,
        Lens::Orthographic { ymag } => ymag,
    };
    let mut found = Vec::with_capacity(8);
    for ahead in [nearest.max(0.0), farthest] {
        let high = half_height(ahead) * border;
        for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            found.push(eye + forward * ahead + right * (x * high * aspect) + up * (y * high));
        }
    }
    found
}

/// A map of what lies between coordinates along its axes.
fn parallel(axes: [Vec3; 3], ranges: [[f32; 2]; 3]) -> Projection {
    let centre = ranges.map(|[low, high]| 0.5 * (low + high));
    let half = ranges.map(|[low, high]| (0.5 * (high - low) * MARGIN).max(1e-30));
    let side = half[0].max(half[1]);
    let origin = axes[0] * centre[0] + axes[1] * centre[1] + axes[2] * (centre[2] - half[2]);
    Projection {
        rows: rows(axes, origin),
        scale: [1.0 / side; 2],
        offset: [0.0; 2],
        near: 0.0,
        far: 2.0 * half[2],
        pad: [0.0; 2],
    }
}

fn perspective(position: Vec3, axis: Vec3, half_angle: f32, bounds: &Bounds) -> Projection {
    let tangent = half_angle.tan() * MARGIN;
    let axes = axes(axis);
    Projection {
        rows: rows(axes, position),
        scale: [1.0 / tangent; 2],
        offset: [0.0; 2],
        near: nearest(position, axes[2], tangent, bounds),
        far: 0.0,
        pad: [0.0; 2],
    }
}

fn cube_face(position: Vec3, axis: Vec3, bounds: &Bounds) -> Projection {
    let axes = axes(axis);
    let near = nearest(position, axes[2], 1.0, bounds);
    Projection { rows: rows(axes, position), scale: [CUBE_SCALE; 2], offset: [0.0; 2], near, far: 0.0, pad: [0.0; 2] }
}

/// Distance ahead of which nothing lies in the frustum: by the box's nearest corner, and by the distance of the box, which a
/// point at the frustum's edge has under an angle.
fn nearest(position: Vec3, axis: Vec3, tangent: f32, bounds: &Bounds) -> f32 {
    let ahead = || corners(bounds).map(|corner| axis.dot(corner - position));
    let farthest = ahead().fold(0.0, f32::max);
    let by_corner = ahead().fold(f32::INFINITY, f32::min);
    let by_distance = bounds.distance(position.as_dvec3()) as f32 / (1.0 + 2.0 * tangent * tangent).sqrt();
    (by_corner.max(by_distance) / MARGIN).max(NEAREST * farthest).max(f32::MIN_POSITIVE * 1e6)
}

/// Whether some of the box may lie in a cube's face: not all corners are behind the light or on the far side of one of its planes.
fn sees(face: &Projection, bounds: &Bounds) -> bool {
    let [right, up, forward] = face.rows.map(Vec4::from_array);
    let planes = [forward, forward + right, forward - right, forward + up, forward - up];
    planes.iter().all(|plane| corners(bounds).any(|corner| plane.dot(corner.extend(1.0)) >= 0.0))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const BOUNDS: Bounds = Bounds { min: Vec3::new(-1.0, 0.0, -2.0), max: Vec3::new(1.0, 3.0, 2.0) };

    fn light(kind: PunctualKind, position: Vec3, direction: Vec3, outer: f32) -> PunctualLight {
        PunctualLight {
            position: position.to_array(),
            kind: kind as u32,
            direction: direction.normalize().to_array(),
            range: f32::INFINITY,
            intensity: [1.0; 3],
            inner: 1.0,
            outer,
            ..PunctualLight::default()
        }
    }

    /// Looks at a point from a distance along -z.
    pub fn camera(at: Vec3, distance: f32) -> View {
        View {
            to_world: glam::Affine3A::from_translation(at + Vec3::Z * distance),
            way: Vec::new(),
            lens: Lens::Perspective {
                tan_half_yfov: 0.1,
                aperture_radius: 0.0,
                focus_distance: 1.0,
                blades: 0,
                blade_rotation: 0.0,
            },
            width: 200,
            height: 100,
            filter: crate::params::Filter::default(),
            transparent: false,
        }
    }

    fn fit(light: &PunctualLight, bounds: &Bounds) -> Vec<Projection> {
        super::fit(light, bounds, &camera(bounds.centre().as_vec3(), 100.0))
    }

    #[test]
    fn a_sun_has_a_finer_map_of_what_a_camera_sees_from_nearby() {
        let bounds = Bounds { min: Vec3::new(-50.0, 0.0, -50.0), max: Vec3::new(50.0, 20.0, 50.0) };
        let sun = light(PunctualKind::Directional, Vec3::ZERO, Vec3::new(1.0, -2.0, 0.5), 0.0);
        let view = |distance| camera(Vec3::new(10.0, 5.0, -49.0), distance);
        assert_eq!(super::fit(&sun, &bounds, &view(400.0)).len(), 1);
        let maps = super::fit(&sun, &bounds, &view(3.0));
        assert_eq!(maps.len(), 2);
        assert!(maps[0].scale[0] > 5.0 * maps[1].scale[0]);
        // What is in the picture is in the map; what is beside it is in the other one, at the same depth.
        for (point, is_seen) in [(Vec3::new(10.5, 5.2, -49.5), true), (Vec3::new(-40.0, 1.0, 40.0), false)] {
            let [fine, whole] = [0, 1].map(|map| projected(&maps[map], point));
            assert_eq!(fine.0.abs() <= 1.0 && fine.1.abs() <= 1.0, is_seen);
            assert!(whole.0.abs() <= 1.0 && whole.1.abs() <= 1.0);
            assert!((fine.2 - whole.2).abs() < 1e-5);
        }
        // A camera that looks away sees nothing of it, and needs no map of its own.
        assert_eq!(super::fit(&sun, &bounds, &camera(Vec3::new(0.0, 0.0, -200.0), 1.0)).len(), 1);
    }

    /// Clip coordinates and depth.
    fn projected(face: &Projection, p: Vec3) -> (f32, f32, f32) {
        let v = face.rows.map(|row| Vec4::from_array(row).dot(p.extend(1.0)));
        let z = if face.near > 0.0 { v[2] } else { 1.0 };
        let depth = if face.near > 0.0 { face.near / v[2] } else { 1.0 - v[2] / face.far };
        (v[0] * face.scale[0] / z, v[1] * face.scale[1] / z, depth)
    }

    fn assert_all_inside(face: &Projection) {
        for corner in corners(&BOUNDS) {
            let (x, y, depth) = projected(face, corner);
            assert!(x.abs() <= 1.0 && y.abs() <= 1.0, "{corner}: {x}, {y}");
            assert!((0.0..=1.0).contains(&depth), "{corner}: depth {depth}");
        }
    }

    #[test]
    fn maps_hold_the_whole_scene() {
        let far = Vec3::new(9.0, 5.0, 3.0);
        for (kind, outer) in
            [(PunctualKind::Directional, 0.0), (PunctualKind::Point, 0.0), (PunctualKind::SpotLinear, 1.0)]
        {
            let faces = fit(&light(kind, far, BOUNDS.centre().as_vec3() - far, outer), &BOUNDS);
            assert_eq!(faces.len(), 1);
            assert_all_inside(&faces[0]);
        }
    }

    #[test]
    fn a_light_within_the_scene_needs_all_sides_and_one_at_a_wall_fewer() {
        let count = |position| fit(&light(PunctualKind::Point, position, Vec3::X, 0.0), &BOUNDS).len();
        assert_eq!(count(Vec3::new(0.0, 1.0, 0.0)), 6);
        assert_eq!(count(Vec3::new(0.0, 3.5, 0.0)), 5);
    }

    #[test]
    fn a_spot_light_that_looks_away_needs_none() {
        let away = light(PunctualKind::SpotLinear, Vec3::new(9.0, 1.0, 0.0), Vec3::X, 0.5);
        assert!(fit(&away, &BOUNDS).is_empty());
    }

    #[test]
    fn nothing_is_nearer_than_the_near_plane() {
        for position in [Vec3::new(3.0, 1.0, 0.0), Vec3::new(1.5, 4.0, 2.5), Vec3::new(0.2, 1.0, -0.3)] {
            for face in fit(&light(PunctualKind::Point, position, Vec3::X, 0.0), &BOUNDS) {
                for i in 0..1000 {
                    let u = Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) / 9.0;
                    let (x, y, depth) = projected(&face, BOUNDS.min + u * (BOUNDS.max - BOUNDS.min));
                    let is_inside = x.abs() <= 1.0 && y.abs() <= 1.0 && depth > 0.0;
                    assert!(!is_inside || depth <= 1.0 || face.near < 1e-3, "depth {depth}");
                }
            }
        }
    }
}
