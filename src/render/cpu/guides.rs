//! Guides of a picture: reflectance and normal of what its pixels see, found with the camera, filter and moments of the light's own paths.

use super::bvh::Bvh;
use super::environment;
use super::integrator::{Integrator, Path};
use super::sampler::Sampler;
use super::surface::Surface;
use crate::compile::Material;
use crate::film::{Guides, TILE_PIXELS, TileSamples, Tiles};
use crate::render::Work;
use crate::render::slice::SlicePaths;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Samples per pixel at the most: what noise they leave, the denoiser takes from them first.
const SAMPLES: u32 = 4;

/// Mirrors and panes that a path is followed by.
const MOST_MIRRORS: u32 = 8;

/// Albedo and normal.
type Seen = [DVec3; 2];

/// Guides under way, in slices like a picture.
pub struct GuideTracer {
    integrator: Integrator,
    tiles: Tiles,
    seed: u32,
    /// An entry for each tile.
    pass: Vec<TileSamples>,
    /// Of the entries that are done, lane by lane.
    found: Vec<[[f32; 3]; 2]>,
    slice: SlicePaths,
}

impl GuideTracer {
    /// Nothing traced yet.
    pub(super) fn new(work: Work, tree: Arc<Bvh>) -> Self {
        let tiles = Tiles::new(work.view.width, work.view.height);
        let samples = SAMPLES.min(work.settings.max_samples);
        let entry = |tile| TileSamples { tile, replicate: 0, first: 0, samples };
        let (seed, pass) = (work.settings.seed, (0..tiles.count()).map(entry).collect());
        let integrator = Integrator::new(work, tree);
        Self { integrator, tiles, seed, pass, found: Vec::new(), slice: SlicePaths::default() }
    }

    /// Traces one slice; the guides, once they are done.
    pub fn step(&mut self) -> Option<Guides> {
        let begun = Instant::now();
        let done = self.found.len() / TILE_PIXELS;
        let (count, paths) = self.slice.take(&self.pass[done..]);
        let entries = self.pass[done..].par_iter().take(count as usize);
        let lanes = entries.flat_map_iter(|entry| (0..TILE_PIXELS as u32).map(|lane| self.pixel(*entry, lane)));
        let found: Vec<_> = lanes.collect();
        self.found.extend(found);
        self.slice.learn(paths, begun.elapsed());
        (self.found.len() == self.pass.len() * TILE_PIXELS).then(|| self.guides())
    }

    fn pixel(&self, entry: TileSamples, lane: u32) -> [[f32; 3]; 2] {
        let Some((x, y)) = self.tiles.pixel(entry.tile, lane) else { return [[0.0; 3]; 2] };
        let pixel = y * self.tiles.width() + x;
        let samples = entry.first..entry.first + entry.samples;
        let seen = samples.map(|sample| {
            let seen = self.integrator.seen(x, y, &Sampler::new(pixel, sample, entry.replicate, self.seed, true));
            // What is not finite guides nobody; the light's own samples are counted.
            seen.map(|value| if value.is_finite() { value } else { DVec3::ZERO })
        });
        let [albedo, normal] = seen.fold([DVec3::ZERO; 2], |[a, n], [albedo, normal]| [a + albedo, n + normal]);
        [albedo, normal].map(|sum| (sum / f64::from(entry.samples)).as_vec3().to_array())
    }

    fn guides(&self) -> Guides {
        let of = |channel: usize| {
            let pixel = |x, y| {
                let (tile, lane) = self.tiles.place(x, y);
                self.found[tile as usize * TILE_PIXELS + lane as usize][channel]
            };
            let row = |y| (0..self.tiles.width()).map(move |x| pixel(x, y));
            (0..self.tiles.height()).flat_map(row).collect()
        };
        Guides { albedo: of(0), normal: of(1) }
    }
}

impl Integrator {
    /// What a sample of a pixel sees, by way of mirrors and panes.
    fn seen(&self, x: u32, y: u32, sampler: &Sampler) -> Seen {
        let mut path = self.begin(x, y, sampler);
        loop {
            let hit = self.closest(&path, sampler);
            let distance = hit.as_ref().map_or(f64::INFINITY, |hit| hit.t);
            if self.work.features.extended_lights {
                let light = self.extended_light(&path, distance);
                if light != DVec3::ZERO {
                    return [within(path.throughput * light), DVec3::ZERO];
                }
            }
            let Some(hit) = hit else { return [within(self.background(&path)), DVec3::ZERO] };
            let surface = Surface::new(&self.work.scene, &hit, path.ray.direction, path.ray.moment);
            if self.passes_back(&mut path, &surface) {
                continue;
            }
            let normal = surface.shading_normal;
            let shown = path.throughput;
            if surface.material.flags & Material::UNLIT != 0 {
                return [within(shown * surface.base_color().truncate()), normal];
            }
            let emitted = if surface.emitter.is_some() { surface.emitted(path.ray.direction) } else { DVec3::ZERO };
            let vertex = self.vertex(&surface, &mut path, sampler);
            let albedo = vertex.bsdf.albedo() + emitted;
            let goes_on = path.bounce < MOST_MIRRORS && self.scatter(&vertex, &mut path, hit.t, sampler);
            // Only what comes from one direction alone is seen in it.
            if !goes_on || path.pdf.is_some() {
                return [within(shown * albedo), normal];
            }
        }
    }

    fn background(&self, path: &Path) -> DVec3 {
        let (view, lighting) = (&self.work.view, &self.work.lighting);
        let shows = path.seen || (lighting.environment.visible && !view.transparent);
        if shows {
            path.throughput * environment::radiance(&lighting.environment, path.ray.direction)
        } else {
            DVec3::ZERO
        }
    }
}

/// Guides have values of 0 to 1.
fn within(value: DVec3) -> DVec3 {
    value.clamp(DVec3::ZERO, DVec3::ONE)
}

#[cfg(test)]
mod tests {
    use crate::film::Guides;
    use crate::params::from_json;
    use crate::render::cpu::CpuEngine;
    use crate::render::prepare::{prepare, render_to_end};
    use crate::render::{Engines, Work};
    use crate::scene::{self, Limits, Package};
    use crate::{compile, params};
    use glam::Vec3;
    use serde_json::{Value, json};
    use std::sync::Arc;

    const SIDE: usize = 33;

    /// A ball before a camera that looks along -z, in even light.
    fn work(ball: &Value, more: &Value) -> Work {
        let mut params = json!({
            "engine": "cpu", "width": SIDE, "height": SIDE, "max_samples": 4, "environment": {"constant": [0.3, 0.2, 4]},
            "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "yfov_degrees": 40},
            "spheres": [{"center": [0, 0, 0], "radius": 1}],
        });
        let fields = |to: &mut Value, from: &Value| {
            for (name, value) in from.as_object().into_iter().flatten() {
                to[name] = value.clone();
            }
        };
        fields(&mut params["spheres"][0], ball);
        fields(&mut params, more);
        let params: params::RenderParams = from_json(&params.to_string()).unwrap();
        let empty = br#"{"asset": {"version": "2.0"}, "scenes": [{}]}"#.to_vec();
        let limits = Limits::default();
        let scene = scene::import(&Package::from_bytes(empty, &limits).unwrap(), &limits).unwrap();
        let compiled = compile::compile_request(&scene, &params, &compile::MapFiles::default()).unwrap();
        prepare(&scene, Arc::new(compiled), &params, None).unwrap().work
    }

    fn guides(ball: &Value, more: &Value) -> Guides {
        let mut tracer = CpuEngine::new().guides(&work(ball, more));
        loop {
            if let Some(guides) = tracer.step() {
                return guides;
            }
        }
    }

    fn close(found: [f32; 3], expected: [f32; 3], tolerance: f32) {
        let distance = (Vec3::from(found) - Vec3::from(expected)).abs().max_element();
        assert!(distance < tolerance, "{found:?}, and not {expected:?}");
    }

    const MIDDLE: usize = SIDE * SIDE / 2;

    #[test]
    fn what_is_seen_is_told_and_not_how_it_is_lit() {
        let rough = json!({"color": [0.8, 0.4, 0.1], "roughness": 1});
        let found = guides(&rough, &json!({}));
        close(found.albedo[MIDDLE], [0.8, 0.4, 0.1], 0.06);
        close(found.normal[MIDDLE], [0.0, 0.0, 1.0], 0.02);
        // The sky behind it, as far as it goes.
        close(found.albedo[0], [0.3, 0.2, 1.0], 1e-6);
        close(found.normal[0], [0.0; 3], 1e-6);
        assert_eq!(guides(&rough, &json!({"output": {"transparent": true}})).albedo[0], [0.0; 3]);
        let brighter = json!({"lights": [{"type": "directional", "direction": [0, 0, -1], "intensity": 9}]});
        assert_eq!(guides(&rough, &brighter).albedo[MIDDLE], found.albedo[MIDDLE]);
    }

    #[test]
    fn in_a_mirror_that_is_what_it_shows() {
        let found = guides(&json!({"color": [1, 1, 1], "metallic": 1, "roughness": 0}), &json!({}));
        close(found.albedo[MIDDLE], [0.3, 0.2, 1.0], 0.02);
        close(found.normal[MIDDLE], [0.0; 3], 1e-6);
        let gold = guides(&json!({"color": [1, 0.8, 0.2], "metallic": 1, "roughness": 0.5}), &json!({}));
        close(gold.normal[MIDDLE], [0.0, 0.0, 1.0], 0.02);
    }

    #[test]
    fn guides_come_with_a_picture_that_is_the_same_without_them() {
        let rendered = |denoise: bool| {
            let work = work(&json!({}), &json!({ "denoise": denoise }));
            render_to_end(&mut Engines::new(), work, &mut |_| {}).unwrap()
        };
        let (with, without) = (rendered(true), rendered(false));
        assert_eq!(with.film.picture(), without.film.picture());
        assert_eq!((with.guides, without.guides), (Some(guides(&json!({}), &json!({}))), None));
    }
}
