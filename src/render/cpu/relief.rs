//! Reliefs that are finer than the mesh: height, normal and parallax maps.

use super::texture::{Encoding, sample, sample_texels, size, texel_position};
use crate::compile::{Detail, TexturePages};
use glam::{DVec2, DVec3};

/// Halvings that follow the steps of a search.
const REFINEMENTS: u32 = 10;

/// Rounding of a height that is interpolated between texels of 16 bits; as wide as where numbers are f32.
const HEIGHT_ROUNDING: f64 = 4e-6;

/// Cosine of the view below which a relief is looked at as if at this one: the way through it would have no end.
const LEAST_COSINE: f64 = 0.02;

/// Gradients of the texture coordinates over a surface, per scene unit, in the world.
#[derive(Debug, Clone, Copy, Default)]
pub struct Chart {
    /// Of u.
    pub u: DVec3,
    /// Of v.
    pub v: DVec3,
}

impl Chart {
    /// Of a triangle in the world, from its edges out of one corner and the change of the coordinates along them.
    pub fn of_triangle(edges: [DVec3; 2], change: [DVec2; 2]) -> Self {
        let normal = edges[0].cross(edges[1]);
        let squared = normal.length_squared();
        if squared == 0.0 {
            return Self::default();
        }
        let along = [edges[1].cross(normal) / squared, normal.cross(edges[0]) / squared];
        Self { u: change[0].x * along[0] + change[1].x * along[1], v: change[0].y * along[0] + change[1].y * along[1] }
    }
}

/// A material's relief at one point.
#[derive(Debug)]
pub struct Relief<'a> {
    /// What it is.
    pub detail: &'a Detail,
    /// Where its texels are.
    pub pages: &'a TexturePages,
    /// How the texture lies on the surface.
    pub chart: Chart,
    /// Of the front, without the relief.
    pub normal: DVec3,
}

impl Relief<'_> {
    /// Which set of texture coordinates it is laid out by.
    pub fn uv_set(detail: &Detail) -> usize {
        (detail.map.info >> 16 & 1) as usize
    }

    /// Whether it moves what is seen.
    pub fn has_parallax(&self) -> bool {
        self.detail.kind >= Detail::OFFSET
    }

    /// Normal of the front at texture coordinates.
    pub fn bent_normal(&self, uvs: [DVec2; 2]) -> DVec3 {
        if self.detail.kind == Detail::NORMAL { self.read_normal(uvs) } else { self.raised_normal(uvs) }
    }

    /// Mikkelsen 2010, "Bump Mapping Unparametrized Surfaces on the GPU".
    fn raised_normal(&self, uvs: [DVec2; 2]) -> DVec3 {
        let slope = f64::from(self.detail.scale) * self.gradient(uvs);
        (self.normal - slope.reject_from_normalized(self.normal)).normalize()
    }

    /// Slope of the height over the surface, by central differences (Blinn 1978).
    fn gradient(&self, uvs: [DVec2; 2]) -> DVec3 {
        let map = &self.detail.map;
        let p = texel_position(map, uvs);
        let slope = |axis: DVec2, texels: f64| 0.5 * texels * (self.height(p + axis) - self.height(p - axis));
        let [x, y] = [slope(DVec2::X, size(map).x), slope(DVec2::Y, size(map).y)];
        let by_uv = |i: usize| x * f64::from(map.row_u[i]) + y * f64::from(map.row_v[i]);
        by_uv(0) * self.chart.u + by_uv(1) * self.chart.v
    }

    /// 0 to 1, at a position in texels.
    fn height(&self, position: DVec2) -> f64 {
        let texel = sample_texels(self.pages, Encoding::Linear, &self.detail.map, position);
        (texel.x * 65280.0 + texel.y * 255.0) / 65535.0
    }

    /// x and y of the map, z from them.
    fn read_normal(&self, uvs: [DVec2; 2]) -> DVec3 {
        let xy = sample(self.pages, Encoding::Linear, &self.detail.map, uvs).truncate().truncate() * 2.0 - 1.0;
        let z = (1.0 - xy.length_squared()).max(0.0).sqrt();
        let (u, v, normal) = (self.chart.u, self.chart.v, self.normal);
        let side = if u.cross(v).dot(normal) > 0.0 { 1.0 } else { -1.0 };
        let Some(tangent) = (v.cross(normal) * side).reject_from_normalized(normal).try_normalize() else {
            return normal;
        };
        // Up in the picture is against v.
        let up = -normal.cross(tangent) * side;
        let mapped = f64::from(self.detail.scale) * (xy.x * tangent + xy.y * up) + z * normal;
        mapped.try_normalize().unwrap_or(normal)
    }

    /// Way in texture coordinates from where a ray of this direction enters the relief to the point of it that is seen.
    pub fn parallax(&self, uvs: [DVec2; 2], direction: DVec3) -> DVec2 {
        let map = &self.detail.map;
        let cosine = (-self.normal.dot(direction)).max(LEAST_COSINE);
        let sideways = direction.reject_from_normalized(self.normal) * f64::from(self.detail.scale);
        // Down to the depth of black, the relief's lowest.
        let limited = DVec2::new(sideways.dot(self.chart.u), sideways.dot(self.chart.v));
        let whole = limited / cosine;
        let row = |row: [f32; 3]| f64::from(row[0]) * whole.x + f64::from(row[1]) * whole.y;
        let way = DVec2::new(row(map.row_u), row(map.row_v)) * size(map);
        let start = texel_position(map, uvs);
        let depth = |part: f64| 1.0 - self.height(start + part * way);
        match self.detail.kind {
            Detail::OFFSET => whole * depth(0.0),
            Detail::OFFSET_LIMITED => limited * depth(0.0),
            kind => whole * search(self.detail.steps, kind == Detail::RELIEF, depth),
        }
    }

    /// Whether it stands between the point of it at these coordinates and light from a direction of unit length (Tatarchuk 2006,
    /// "Dynamic Parallax Occlusion Mapping with Approximate Soft Shadows", its hard form).
    pub fn blocks(&self, uvs: [DVec2; 2], direction: DVec3) -> bool {
        let cosine = self.normal.dot(direction);
        if cosine <= 0.0 {
            return false;
        }
        let map = &self.detail.map;
        let start = texel_position(map, uvs);
        let height = self.height(start);
        // Up to the surface, the relief's highest.
        let depth = f64::from(self.detail.scale) * (1.0 - height);
        let sideways = direction.reject_from_normalized(self.normal) * (depth / cosine.max(LEAST_COSINE));
        let whole = DVec2::new(sideways.dot(self.chart.u), sideways.dot(self.chart.v));
        let row = |row: [f32; 3]| f64::from(row[0]) * whole.x + f64::from(row[1]) * whole.y;
        let way = DVec2::new(row(map.row_u), row(map.row_v)) * size(map);
        let mut parts = (1..self.detail.steps).map(|step| f64::from(step) / f64::from(self.detail.steps));
        parts.any(|part| self.height(start + part * way) > height + part * (1.0 - height) + HEIGHT_ROUNDING)
    }
}

/// The first part of the way, in steps, that is not above the depth there; if wanted, halved to where the way goes below.
fn search(steps: u32, refined: bool, depth: impl Fn(f64) -> f64) -> f64 {
    let part = |step: u32| f64::from(step) / f64::from(steps);
    let first = (0..=steps).find(|&step| part(step) >= depth(part(step)));
    let (mut below, mut above) = match first {
        Some(0) => return 0.0,
        Some(step) => (part(step), part(step - 1)),
        None => (1.0, 1.0),
    };
    for _ in 0..if refined { REFINEMENTS } else { 0 } {
        let middle = 0.5 * (above + below);
        if middle >= depth(middle) { below = middle } else { above = middle }
    }
    below
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A relief's search against a march of a hundred thousand steps.
    #[test]
    fn a_search_finds_what_a_fine_march_finds() {
        let depths: [fn(f64) -> f64; 4] =
            [|t| 0.5 + 0.4 * (9.0 * t).sin(), |t| if t < 0.3 { 0.9 } else { 0.1 }, |t| 0.2 + 0.6 * t, |_| 1.0];
        for depth in depths {
            let fine = (0..=100_000).map(|i| f64::from(i) / 1e5).find(|&t| t >= depth(t)).unwrap_or(1.0);
            let found = search(64, true, depth);
            assert!((found - fine).abs() < 3e-5, "{found} for {fine}");
            let steep = search(64, false, depth);
            assert!((0.0..=1.0 / 64.0 + 1e-9).contains(&(steep - fine)), "{steep} for {fine}");
        }
        assert_eq!(search(8, true, |_| 0.0), 0.0);
    }

    #[test]
    fn a_chart_measures_along_the_edges() {
        let edges = [DVec3::new(2.0, 1.0, 0.5), DVec3::new(-0.3, 1.5, 1.0)];
        let change = [DVec2::new(0.2, -0.7), DVec2::new(0.9, 0.4)];
        let chart = Chart::of_triangle(edges, change);
        for (edge, change) in edges.iter().zip(change) {
            assert!((chart.u.dot(*edge) - change.x).abs() < 1e-12 && (chart.v.dot(*edge) - change.y).abs() < 1e-12);
        }
        assert_eq!(Chart::of_triangle([DVec3::X; 2], change).u, DVec3::ZERO);
    }
}
