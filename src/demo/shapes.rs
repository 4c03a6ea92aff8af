//! Surfaces as triangles.

use glam::{DVec3, EulerRot, Mat4, Quat, Vec2, Vec3, Vec3Swizzles, Vec4};
use std::collections::HashMap;
use std::f64::consts::TAU;

/// A triangle mesh; lists of attributes are empty or have an entry per vertex.
#[derive(Default, Clone)]
pub struct Shape {
    /// Object space.
    pub positions: Vec<Vec3>,
    /// Unit length.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, v from the top.
    pub uvs: Vec<Vec2>,
    /// Linear RGBA.
    pub colors: Vec<Vec4>,
    /// Counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// The surface `point(u, v)` over the unit square, `columns` x `rows` cells. Its front is where `du x dv` points.
    pub fn parametric(columns: u32, rows: u32, point: impl Fn(f64, f64) -> DVec3) -> Self {
        let mut shape = Self::default();
        for row in 0..=rows {
            for column in 0..=columns {
                let (u, v) = (f64::from(column) / f64::from(columns), f64::from(row) / f64::from(rows));
                shape.positions.push(point(u, v).as_vec3());
                shape.normals.push(normal(&point, u, v));
                shape.uvs.push(Vec2::new(u as f32, 1.0 - v as f32));
            }
        }
        let vertex = |column: u32, row: u32| row * (columns + 1) + column;
        for row in 0..rows {
            for column in 0..columns {
                let [a, b] = [vertex(column, row), vertex(column + 1, row)];
                let [c, d] = [vertex(column + 1, row + 1), vertex(column, row + 1)];
                shape.add_triangle([a, b, c]);
                shape.add_triangle([a, c, d]);
            }
        }
        shape
    }

    /// A sphere about the origin, poles on y.
    pub fn sphere(radius: f64, columns: u32) -> Self {
        Self::lathe(columns, columns / 2, move |t| {
            let (sin, cos) = (t * TAU / 2.0).sin_cos();
            (radius * sin, -radius * cos)
        })
    }

    /// The surface that a profile of (distance from the axis, height) sweeps about the y axis. Going up, its front is outside.
    pub fn lathe(columns: u32, rows: u32, profile: impl Fn(f64) -> (f64, f64)) -> Self {
        Self::parametric(columns, rows, move |u, v| {
            let (radius, height) = profile(v);
            let (sin, cos) = (u * TAU).sin_cos();
            DVec3::new(radius * sin, height, radius * cos)
        })
    }

    /// A ring about the y axis.
    pub fn torus(radius: f64, thickness: f64, columns: u32) -> Self {
        Self::lathe(columns, columns / 3, move |t| {
            let (sin, cos) = (t * TAU).sin_cos();
            (radius + thickness * cos, thickness * sin)
        })
    }

    /// A flat patch from a corner along two edges; its front is where `across x along` points.
    pub fn patch(corner: Vec3, across: Vec3, along: Vec3) -> Self {
        let [corner, across, along] = [corner, across, along].map(Vec3::as_dvec3);
        Self::parametric(1, 1, move |u, v| corner + across * u + along * v)
    }

    /// A patch of the given size about `centre` whose front faces `target`.
    pub fn panel(centre: Vec3, target: Vec3, width: f32, height: f32) -> Self {
        let front = (target - centre).normalize_or(Vec3::NEG_Y);
        let across = Vec3::Y.cross(front).try_normalize().unwrap_or(Vec3::X) * width;
        let along = front.cross(across).normalize_or(Vec3::Z) * height;
        Self::patch(centre - (across + along) / 2.0, across, along)
    }

    /// A box about the origin with rounded edges.
    pub fn rounded_box(half: Vec3, radius: f32) -> Self {
        let inner = half - radius;
        let mut shape = Self::default();
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for side in [1.0, -1.0] {
                shape.add_box_side(axis * side, inner, radius);
            }
        }
        shape
    }

    /// Bends a grid over one side of a box and half of the edges around it.
    fn add_box_side(&mut self, front: Vec3, inner: Vec3, radius: f32) {
        /// Tangents of the angles at which an edge is cut: a quarter of a circle in 8 steps, half of it from each side.
        const CUTS: [f32; 5] = [1.0, 0.668_178_6, 0.414_213_57, 0.198_912_37, 0.0];
        let across = front.zxy().abs();
        let along = front.cross(across);
        let cuts = |direction: Vec3| -> Vec<f32> {
            let flat = inner.dot(direction.abs());
            let low = CUTS.iter().map(|cut| -flat - radius * cut);
            low.chain(CUTS.iter().rev().map(|cut| flat + radius * cut)).collect()
        };
        let (columns, rows) = (cuts(across), cuts(along));
        let first = self.positions.len() as u32;
        for (row, y) in rows.iter().enumerate() {
            for (column, x) in columns.iter().enumerate() {
                let on_cube = across * *x + along * *y + front * (inner.dot(front.abs()) + radius);
                let core = on_cube.clamp(-inner, inner);
                let normal = (on_cube - core).normalize();
                self.positions.push(core + normal * radius);
                self.normals.push(normal);
                self.uvs.push(Vec2::new(column as f32, row as f32) / (columns.len() - 1) as f32);
            }
        }
        let width = columns.len() as u32;
        for row in 0..rows.len() as u32 - 1 {
            for column in 0..width - 1 {
                let a = first + row * width + column;
                self.add_triangle([a, a + 1, a + width + 1]);
                self.add_triangle([a, a + width + 1, a + width]);
            }
        }
    }

    /// A unit sphere pushed in and out by `radius(direction)`, of `8 * divisions^2` triangles that share their vertices.
    pub fn displaced_sphere(divisions: u32, radius: impl Fn(DVec3) -> f64) -> Self {
        let mut shape = Self::default();
        let mut known = HashMap::new();
        let mut vertex = |shape: &mut Self, lattice: [i32; 3]| {
            *known.entry(lattice).or_insert_with(|| {
                let direction = DVec3::from(lattice.map(f64::from)).normalize();
                shape.positions.push((direction * radius(direction)).as_vec3());
                shape.positions.len() as u32 - 1
            })
        };
        let n = divisions as i32;
        for octant in 0..8 {
            let sign = [0, 1, 2].map(|axis| 1 - 2 * (octant >> axis & 1));
            let mirrored = sign[0] * sign[1] * sign[2] < 0;
            for i in 0..n {
                for j in 0..n - i {
                    let mut corner =
                        |i: i32, j: i32| vertex(&mut shape, [sign[0] * i, sign[1] * j, sign[2] * (n - i - j)]);
                    let [a, b, c] = [corner(i, j), corner(i + 1, j), corner(i, j + 1)];
                    let opposite = (i + j + 2 <= n).then(|| corner(i + 1, j + 1));
                    let mut add =
                        |[a, b, c]: [u32; 3]| shape.triangles.push(if mirrored { [a, c, b] } else { [a, b, c] });
                    add([a, b, c]);
                    if let Some(d) = opposite {
                        add([b, d, c]);
                    }
                }
            }
        }
        shape.smooth_normals();
        shape
    }

    /// The same, moved, turned (degrees about y, then x, then z) and scaled.
    pub fn placed(mut self, position: Vec3, turn: [f32; 3], scale: f32) -> Self {
        let [y, x, z] = turn.map(f32::to_radians);
        let rotation = Quat::from_euler(EulerRot::YXZ, y, x, z);
        let matrix = Mat4::from_scale_rotation_translation(Vec3::splat(scale), rotation, position);
        self.positions.iter_mut().for_each(|p| *p = matrix.transform_point3(*p));
        self.normals.iter_mut().for_each(|n| *n = rotation * *n);
        self
    }

    /// Adds the triangles of another shape, which must have the same attributes.
    pub fn append(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.normals.extend(&other.normals);
        self.uvs.extend(&other.uvs);
        self.colors.extend(&other.colors);
        self.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|index| first + index)));
    }

    /// The same with texture coordinates multiplied, so that textures repeat.
    pub fn tiled(mut self, u: f32, v: f32) -> Self {
        self.uvs.iter_mut().for_each(|uv| *uv *= Vec2::new(u, v));
        self
    }

    /// Lower and upper corner.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        self.positions.iter().fold(empty, |(min, max), p| (min.min(*p), max.max(*p)))
    }

    /// Adds a triangle unless it has no area, as at the poles of a sphere.
    fn add_triangle(&mut self, triangle: [u32; 3]) {
        let [a, b, c] = triangle.map(|index| self.positions[index as usize]);
        if (b - a).cross(c - a).length_squared() > 1e-20 {
            self.triangles.push(triangle);
        }
    }

    /// Normals as the mean of the faces around, weighted by their area.
    fn smooth_normals(&mut self) {
        let mut sums = vec![Vec3::ZERO; self.positions.len()];
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|index| self.positions[index as usize]);
            let face = (b - a).cross(c - a);
            triangle.iter().for_each(|&index| sums[index as usize] += face);
        }
        self.normals = sums.into_iter().map(|sum| sum.normalize_or(Vec3::Y)).collect();
    }
}

/// A smooth curve through points, at `t` from 0 to 1 (Catmull and Rom 1974).
pub fn spline(points: &[(f64, f64)], t: f64) -> (f64, f64) {
    let last = points.len() - 1;
    let place = t.clamp(0.0, 1.0) * last as f64;
    let segment = (place as usize).min(last.saturating_sub(1));
    let x = place - segment as f64;
    let at = |offset: isize| points[segment.saturating_add_signed(offset).min(last)];
    let blend = |a: f64, b: f64, c: f64, d: f64| {
        b + 0.5 * x * (c - a + x * (2.0 * a - 5.0 * b + 4.0 * c - d + x * (3.0 * (b - c) + d - a)))
    };
    let (a, b, c, d) = (at(-1), at(0), at(1), at(2));
    (blend(a.0, b.0, c.0, d.0), blend(a.1, b.1, c.1, d.1))
}

/// By central differences, a little inside of the square so that poles have a direction too.
fn normal(point: &impl Fn(f64, f64) -> DVec3, u: f64, v: f64) -> Vec3 {
    const STEP: f64 = 1e-5;
    let v = v.clamp(2.0 * STEP, 1.0 - 2.0 * STEP);
    let across = point(u + STEP, v) - point(u - STEP, v);
    let along = point(u, v + STEP) - point(u, v - STEP);
    across.cross(along).normalize_or(DVec3::Y).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(shape: &Shape) -> f64 {
        let corner = |index: u32| shape.positions[index as usize].as_dvec3();
        shape.triangles.iter().map(|&[a, b, c]| corner(a).dot(corner(b).cross(corner(c))) / 6.0).sum()
    }

    #[test]
    fn closed_shapes_enclose_their_volume_and_face_outwards() {
        for (name, shape, expected) in [
            ("sphere", Shape::sphere(2.0, 96), 4.0 / 3.0 * TAU / 2.0 * 8.0),
            ("torus", Shape::torus(2.0, 0.5, 96), TAU * TAU / 2.0 * 2.0 * 0.25),
            ("sharp box", Shape::rounded_box(Vec3::new(1.0, 2.0, 3.0), 1e-3), 48.0),
            ("ball", Shape::rounded_box(Vec3::splat(1.0), 1.0), 4.0 / 3.0 * TAU / 2.0),
            ("displaced", Shape::displaced_sphere(40, |_| 1.0), 4.0 / 3.0 * TAU / 2.0),
        ] {
            let ratio = volume(&shape) / expected;
            assert!((0.97..1.001).contains(&ratio), "{name}: {ratio}");
            for &[a, b, c] in &shape.triangles {
                let [p, q, r] = [a, b, c].map(|index| shape.positions[index as usize]);
                let face = (q - p).cross(r - p).normalize();
                assert!(face.dot(shape.normals[a as usize]) > 0.5, "{name}: a normal points to the back");
            }
        }
    }

    #[test]
    fn a_displaced_sphere_has_the_stated_triangles() {
        let shape = Shape::displaced_sphere(35, |_| 1.0);
        assert_eq!(shape.triangles.len(), 8 * 35 * 35);
        assert_eq!(shape.positions.len(), 4 * 35 * 35 + 2, "vertices are shared (Euler)");
    }

    #[test]
    fn a_panel_faces_its_target() {
        let panel = Shape::panel(Vec3::new(1.0, 3.0, 2.0), Vec3::ZERO, 2.0, 1.0);
        assert!(panel.normals[0].dot(-Vec3::new(1.0, 3.0, 2.0).normalize()) > 0.999);
        let above = Shape::panel(Vec3::Y, Vec3::ZERO, 1.0, 1.0);
        assert!(above.normals[0].dot(Vec3::NEG_Y) > 0.999);
    }

    #[test]
    fn splines_pass_through_their_points() {
        let points = [(0.0, 0.0), (1.0, 0.5), (0.5, 2.0), (0.0, 3.0)];
        for (index, point) in points.iter().enumerate() {
            let (x, y) = spline(&points, index as f64 / 3.0);
            assert!((x - point.0).abs() + (y - point.1).abs() < 1e-9);
        }
    }
}
