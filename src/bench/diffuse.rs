//! The yardstick's task on the CPU engine's trees, shaded in f64: tiles of 8 x 8 pixels in Morton order, on all cores.

use super::yardstick::Pinhole;
use crate::compile::CompiledScene;
use crate::render::cpu::bvh::{Bvh, Ray};
use glam::DVec3;
use rayon::prelude::*;

/// Pixels along the side of a tile.
const TILE: u32 = 8;
/// By how much a path leaves the surface that it is on, relative to the scene: far above the error of f64.
const OFFSET: f64 = 1e-10;

/// A scene of opaque triangles in one level, and its tree.
pub struct Diffuse<'a> {
    scene: &'a CompiledScene,
    bvh: Bvh,
}

impl<'a> Diffuse<'a> {
    /// Builds the tree.
    pub fn new(scene: &'a CompiledScene) -> Self {
        Self { scene, bvh: Bvh::new(scene) }
    }

    /// The tree.
    pub fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// Mean radiance of a square picture under a sky of radiance 1; one sample a pixel.
    pub fn render(&self, camera: Pinhole, side: u32, albedo: f64, segments: u32, seed: u32) -> f64 {
        let eye = camera.eye.as_dvec3();
        let forward = -eye.normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let up = right.cross(forward);
        let scale = (0.5 * f64::from(camera.yfov_degrees).to_radians()).tan();
        let pixel = |x: u32, y: u32| {
            let mut random = Random::new(y * side + x, seed);
            let px = ((f64::from(x) + random.next()) / f64::from(side) * 2.0 - 1.0) * scale;
            let py = (1.0 - (f64::from(y) + random.next()) / f64::from(side) * 2.0) * scale;
            let direction = forward + px * right + py * up;
            self.path(eye, direction, albedo, segments, &mut random)
        };
        let tiles = side.div_ceil(TILE).next_power_of_two();
        let tile = |index: u32| -> f64 {
            let corner = [index, index >> 1].map(|bits| even_bits(bits) * TILE);
            let in_picture = |&(x, y): &(u32, u32)| x < side && y < side;
            let pixels = (0..TILE * TILE).map(|i| (corner[0] + even_bits(i), corner[1] + even_bits(i >> 1)));
            pixels.filter(in_picture).map(|(x, y)| pixel(x, y)).sum()
        };
        (0..tiles * tiles).into_par_iter().map(tile).sum::<f64>() / f64::from(side * side)
    }

    fn path(&self, origin: DVec3, direction: DVec3, albedo: f64, segments: u32, random: &mut Random) -> f64 {
        let mut throughput = 1.0;
        let offset = OFFSET * self.scene.bounds.radius();
        let mut ray = Ray { origin: origin - self.scene.origin, direction, t_max: f64::INFINITY };
        for _ in 0..segments {
            let Some(hit) = self.bvh.closest(&ray, |_| true) else { return throughput };
            let triangle = &self.scene.triangles[hit.triangle as usize];
            let [a, b, c] = [triangle.v0, triangle.v1, triangle.v2].map(|v| DVec3::from_array(v.map(f64::from)));
            let mut normal = (b - a).cross(c - a).normalize();
            if normal.dot(ray.direction) > 0.0 {
                normal = -normal;
            }
            ray.origin = a + (b - a) * hit.u + (c - a) * hit.v + normal * offset;
            ray.direction = cosine_direction(normal, random);
            throughput *= albedo;
        }
        0.0
    }
}

/// The bits of even order, moved together: one coordinate of a Morton index.
fn even_bits(morton: u32) -> u32 {
    let bits = morton & 0x5555_5555;
    let bits = (bits | bits >> 1) & 0x3333_3333;
    let bits = (bits | bits >> 2) & 0x0f0f_0f0f;
    let bits = (bits | bits >> 4) & 0x00ff_00ff;
    (bits | bits >> 8) & 0x0000_ffff
}

fn cosine_direction(normal: DVec3, random: &mut Random) -> DVec3 {
    let z = 1.0 - 2.0 * random.next();
    let (sin, cos) = (std::f64::consts::TAU * random.next()).sin_cos();
    let radius = (1.0 - z * z).max(0.0).sqrt();
    (normal + DVec3::new(radius * cos, radius * sin, z)).normalize_or(normal)
}

/// Steele, Lea, Flood 2014, "Fast Splittable Pseudorandom Number Generators" (SplitMix64).
struct Random(u64);

impl Random {
    fn new(pixel: u32, seed: u32) -> Self {
        Self(u64::from(pixel) << 32 | u64::from(seed))
    }

    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((word ^ word >> 31) >> 11) as f64 / (1u64 << 53) as f64
    }
}
