//! A native tracer on the `obvhs` crate's own traversal: what the compute tracer's speed is compared with.
//! The same task (diffuse surface, constant sky, up to a number of segments), on all cores, f32.

use glam::{Vec3, Vec3A};
use obvhs::cwbvh::CwBvh;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use rayon::prelude::*;

/// A mesh with its tree.
pub struct Yardstick {
    bvh: CwBvh,
    /// In leaf order.
    triangles: Vec<Triangle>,
}

/// A pinhole camera.
#[derive(Debug, Clone, Copy)]
pub struct Pinhole {
    /// Eye point; it looks at the origin, up is +y.
    pub eye: Vec3,
    /// Vertical field of view.
    pub yfov_degrees: f32,
}

impl Yardstick {
    /// Builds the tree as the crate does it, medium preset.
    pub fn new(positions: &[Vec3], indices: &[[u32; 3]]) -> Self {
        let corner = |i: u32| Vec3A::from(positions[i as usize]);
        let triangles: Vec<Triangle> =
            indices.iter().map(|&[a, b, c]| Triangle { v0: corner(a), v1: corner(b), v2: corner(c) }).collect();
        let mut time = std::time::Duration::default();
        let params = obvhs::BvhBuildParams::medium_build();
        let bvh = obvhs::cwbvh::builder::build_cwbvh_from_tris(&triangles, params, &mut time);
        let triangles = bvh.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        Self { bvh, triangles }
    }

    /// Mean radiance of a square picture under a sky of radiance 1; one sample a pixel.
    pub fn render(&self, camera: Pinhole, side: u32, albedo: f32, segments: u32, seed: u32) -> f64 {
        let forward = -camera.eye.normalize();
        let right = forward.cross(Vec3::Y).normalize();
        let up = right.cross(forward);
        let scale = (0.5 * camera.yfov_degrees.to_radians()).tan();
        let row = |y: u32| -> f64 {
            (0..side)
                .map(|x| {
                    let mut random = Random::new(y * side + x, seed);
                    let px = ((x as f32 + random.next()) / side as f32 * 2.0 - 1.0) * scale;
                    let py = (1.0 - (y as f32 + random.next()) / side as f32 * 2.0) * scale;
                    let direction = (forward + px * right + py * up).normalize();
                    f64::from(self.path(camera.eye, direction, albedo, segments, &mut random))
                })
                .sum()
        };
        (0..side).into_par_iter().map(row).sum::<f64>() / f64::from(side * side)
    }

    fn path(&self, mut origin: Vec3, mut direction: Vec3, albedo: f32, segments: u32, random: &mut Random) -> f32 {
        let mut throughput = 1.0;
        for _ in 0..segments {
            let ray = Ray::new_inf(origin.into(), direction.into());
            let mut hit = RayHit::none();
            let intersect = |ray: &Ray, id: usize| self.triangles[id].intersect(ray);
            if !self.bvh.ray_traverse(ray, &mut hit, intersect) {
                return throughput;
            }
            let triangle = &self.triangles[hit.primitive_id as usize];
            let mut normal = Vec3::from((triangle.v1 - triangle.v0).cross(triangle.v2 - triangle.v0).normalize());
            if normal.dot(direction) > 0.0 {
                normal = -normal;
            }
            origin += direction * hit.t + normal * 1e-4;
            direction = cosine_direction(normal, random);
            throughput *= albedo;
        }
        0.0
    }
}

fn cosine_direction(normal: Vec3, random: &mut Random) -> Vec3 {
    let z = 1.0 - 2.0 * random.next();
    let (sin, cos) = (std::f32::consts::TAU * random.next()).sin_cos();
    let radius = (1.0 - z * z).max(0.0).sqrt();
    (normal + Vec3::new(radius * cos, radius * sin, z)).normalize_or(normal)
}

/// PCG (O'Neill 2014).
struct Random(u64);

impl Random {
    fn new(pixel: u32, seed: u32) -> Self {
        let mut random = Self(u64::from(pixel) << 32 | u64::from(seed));
        random.next();
        random
    }

    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let word = (((self.0 >> 18) ^ self.0) >> 27) as u32;
        (word.rotate_right((self.0 >> 59) as u32) >> 8) as f32 / 16_777_216.0
    }
}
