//! Light along one path: from the camera, with a sample of a light at each vertex, both ways of finding a light weighted.

use super::bvh::{Bvh, Hit, Ray, TriangleId};
use super::camera::Camera;
use super::environment;
use super::layers::{self, Crossing, Layered, Media, Reflection, media, scatter};
use super::light::{self, LightSampler};
use super::light_tree::Receiver;
use super::material::{Bsdf, Model};
use super::motion::Moment;
use super::phong::Phong;
use super::place::{Place, area};
use super::sampler::{Dimension, Sampler};
use super::surface::{Surface, coverage};
use crate::compile::{ANY_FACING, ENVIRONMENT_GROUP, Extended, Material, SURFACES_GROUP};
use crate::params::Mode;
use crate::render::Work;
use glam::{DMat3, DVec3, DVec4};

/// Scattering events before a path may end by chance.
const ROULETTE_START: u32 = 3;
/// Most probable survival.
const ROULETTE_MOST: f64 = 0.95;
/// The same within a medium, where walks are long.
const ROULETTE_MOST_WITHIN: f64 = 0.999;

/// Thin walls that light comes through; behind more it is dark.
const MOST_WALLS: u32 = 1000;

/// Key of the random number for the colour that a path follows.
const DISPERSION: u64 = 0x6469_7370;

/// Everything that a path reads.
#[derive(Debug)]
pub struct Integrator {
    pub(super) work: Work,
    bvh: std::sync::Arc<Bvh>,
    camera: Camera,
    pub(super) lights: LightSampler,
    model: Model,
}

/// A point where light is scattered, seen from where the path came.
pub(super) struct Vertex<'a> {
    pub surface: &'a Surface<'a>,
    pub bsdf: Reflection,
    /// From the shading frame to the world.
    frame: DMat3,
    /// The surface of a filled mesh.
    crossing: Option<Crossing>,
    /// What the path is in.
    media: Media,
    pub bounce: u32,
}

/// A path under way.
pub(super) struct Path {
    pub ray: Ray,
    pub throughput: DVec3,
    radiance: DVec3,
    /// The same by what emitted it; empty: it is not split.
    groups: Vec<DVec3>,
    pub bounce: u32,
    /// Density of the ray's direction over solid angle; none: no light sample could have found it.
    pub pdf: Option<f64>,
    /// Where that direction was drawn, and light samples were taken too.
    pub drawn_at: Receiver,
    /// Facing of the surface there.
    facing: usize,
    /// Way from there, past walls that a shadow ray passes too, to where the ray begins.
    pub passed: f64,
    /// What the ray is in.
    pub media: Media,
    /// The camera sees a surface.
    pub seen: bool,
    /// The camera sees a light.
    lit: bool,
    /// Colour that is followed from the first dispersion on: place in the visible range.
    wavelength: Option<f64>,
}

impl Path {
    /// Takes up light of a group that the path carries to the camera.
    fn gather(&mut self, group: usize, light: DVec3) {
        let arriving = self.throughput * light;
        self.radiance += arriving;
        if let Some(sum) = self.groups.get_mut(group) {
            *sum += arriving;
        }
    }
}

/// What a ray is for.
#[derive(Clone, Copy)]
enum RayKind {
    Path,
    Shadow,
}

impl Integrator {
    /// Of a picture.
    pub fn new(work: Work, bvh: std::sync::Arc<Bvh>) -> Self {
        let model = Model { specular: work.features.specular, multiple_scattering: work.settings.multiple_scattering };
        Self { camera: Camera::new(&work.view), lights: LightSampler::new(&work), model, bvh, work }
    }

    /// Radiance (premultiplied) and coverage of one sample of a pixel, and its radiance by group if light is split.
    pub fn sample(&self, x: u32, y: u32, sampler: &Sampler) -> (DVec4, Vec<DVec3>) {
        let mut path = self.begin(x, y, sampler);
        self.follow(&mut path, sampler);
        let view = &self.work.view;
        if !path.seen && !view.transparent && self.work.lighting.environment.visible {
            path.gather(ENVIRONMENT_GROUP, environment::radiance(&self.work.lighting.environment, path.ray.direction));
        }
        let coverage = f64::from(u8::from(path.seen || path.lit || !view.transparent));
        (path.radiance.extend(coverage), path.groups)
    }

    /// A path that leaves the camera.
    pub(super) fn begin(&self, x: u32, y: u32, sampler: &Sampler) -> Path {
        let moment = match self.work.features.motion {
            true => Moment::draw(self.work.settings.pieces, sampler),
            false => Moment::OPEN,
        };
        let ray = self.camera.ray(x, y, moment, sampler);
        Path {
            ray,
            throughput: DVec3::ONE,
            radiance: DVec3::ZERO,
            groups: vec![DVec3::ZERO; self.work.lighting.groups.len()],
            bounce: 0,
            pdf: None,
            drawn_at: Receiver { position: ray.origin, normal: ray.direction },
            facing: ANY_FACING,
            passed: 0.0,
            media: Media::default(),
            seen: false,
            lit: false,
            wavelength: None,
        }
    }

    /// From the camera to the path's end.
    fn follow(&self, path: &mut Path, sampler: &Sampler) {
        loop {
            let hit = self.closest(path, sampler);
            if self.work.features.extended_lights {
                self.meet_lights(path, hit.as_ref().map_or(f64::INFINITY, |hit| hit.t));
            }
            let Some(hit) = hit else { break };
            let surface = Surface::new(&self.work.scene, &hit, path.ray.direction, path.ray.moment);
            if self.passes_back(path, &surface) {
                continue;
            }
            if !self.interact(path, &surface, &hit, sampler) {
                return;
            }
        }
        if path.seen {
            path.gather(ENVIRONMENT_GROUP, self.distant(path));
        }
    }

    /// Takes up light from lights with an extent that the path's ray passes.
    fn meet_lights(&self, path: &mut Path, t_max: f64) {
        let lights = &self.work.lighting.lights[..self.work.lighting.extended as usize];
        for (index, light) in lights.iter().enumerate() {
            let met = self.met_light(index, light, path, t_max);
            path.gather(light.group(), met);
            path.lit |= met != DVec3::ZERO;
        }
    }

    /// Leads a path past a surface that the camera does not see: the backs of one-sided ones (glTF 2.0, 3.9.6).
    pub(super) fn passes_back(&self, path: &mut Path, surface: &Surface) -> bool {
        let one_sided = surface.material.flags & (Material::DOUBLE_SIDED | Material::FILLED) == 0;
        if path.seen || !surface.back || !one_sided {
            path.seen = true;
            return false;
        }
        path.ray.origin = surface.leave(path.ray.direction);
        path.ray.ends[0] = surface.primitive;
        true
    }

    /// Takes up the light that a surface sends along the path, and turns the path to where it goes on; false: it ends.
    fn interact(&self, path: &mut Path, surface: &Surface, hit: &Hit, sampler: &Sampler) -> bool {
        if self.work.features.volume {
            let filled = surface.material.flags & Material::FILLED != 0;
            let left = (surface.back && filled).then(|| media::id(surface.material));
            if path.throughput == DVec3::ZERO {
                return false;
            }
            if let Some(medium) = path.media.scattering(&self.work.scene, left).filter(|_| self.work.features.scatter) {
                let flight = scatter::fly(medium, path.throughput, hit.t, sampler.pair(Dimension::Flight(path.bounce)));
                path.throughput *= flight.weight;
                if let Some(distance) = flight.scattered_at {
                    path.media = path.media.within(left);
                    return self.scatter_within(path, medium, distance, sampler);
                }
            } else {
                path.throughput *= path.media.transmittance(&self.work.scene, left, hit.t);
            }
        }
        if surface.material.flags & Material::UNLIT != 0 {
            path.gather(SURFACES_GROUP, surface.base_color().truncate());
            return false;
        }
        path.gather(SURFACES_GROUP, self.emission(path, surface, hit));
        if path.bounce >= self.work.settings.max_bounces.unwrap_or(u32::MAX) {
            return false;
        }
        let vertex = self.vertex(surface, path, sampler);
        if self.work.settings.mode == Mode::Direct {
            let ambient = self.work.lighting.environment.ambient.as_dvec3();
            path.gather(ENVIRONMENT_GROUP, ambient * vertex.bsdf.albedo());
        }
        if let Some((group, light)) = self.direct_light(&vertex, sampler) {
            path.gather(group, light);
        }
        self.scatter(&vertex, path, hit.t, sampler)
    }

    /// Scatters the path inside of what it is in, after a distance; false: it ends.
    #[inline(never)]
    fn scatter_within(&self, path: &mut Path, medium: &Extended, distance: f64, sampler: &Sampler) -> bool {
        if path.bounce >= self.work.settings.max_bounces.unwrap_or(u32::MAX) {
            return false;
        }
        let (g, moment) = (f64::from(medium.scatter_anisotropy), path.ray.moment);
        let place = Place::within(path.ray.origin + distance * path.ray.direction, moment);
        if let Some((group, light)) = self.light_within(path, &place, g, sampler) {
            path.gather(group, light);
        }
        let direction = scatter::sample_phase(g, path.ray.direction, sampler.pair(Dimension::Lobe(path.bounce)));
        path.pdf = Some(scatter::phase(g, direction.dot(path.ray.direction)));
        (path.drawn_at, path.passed, path.facing) = (Receiver::of(&place), 0.0, ANY_FACING);
        let [_, survival] = sampler.pair(Dimension::Choice(path.bounce));
        path.bounce += 1;
        path.ray = Ray { origin: place.position, direction, t_max: f64::INFINITY, ends: [TriangleId::NONE; 2], moment };
        self.survives(path, survival, ROULETTE_MOST_WITHIN)
    }

    /// Light that arrives straight at a place in a medium, by one sample, scattered into the path's way; with its group.
    fn light_within(&self, path: &Path, place: &Place, g: f64, sampler: &Sampler) -> Option<(usize, DVec3)> {
        let light = self.light_sample(place, ANY_FACING, path.bounce, sampler)?;
        if light.weight.max_element() <= 0.0 {
            return None;
        }
        let phase = scatter::phase(g, light.direction.normalize().dot(path.ray.direction));
        let contribution = light.weight * phase * light.pdf.map_or(1.0, |taken| self.sampled_weight(taken, phase));
        if contribution.max_element() <= 0.0 {
            return None;
        }
        let ends = [TriangleId::NONE, light.end];
        let (direction, moment) = (light.direction, place.moment);
        let ray = Ray { origin: light.origin, direction, t_max: light.t_max, ends, moment };
        Some((light.group, contribution * self.transmittance(path.media, path.bounce, ray, sampler)))
    }

    /// Whether a path that dims goes on; it is brighter then.
    fn survives(&self, path: &mut Path, chance: f64, most: f64) -> bool {
        if !self.work.settings.strategy.roulette || path.bounce < ROULETTE_START {
            return true;
        }
        let probability = path.throughput.max_element().min(most);
        path.throughput *= probability.recip();
        chance < probability
    }

    pub(super) fn vertex<'a>(&self, surface: &'a Surface, path: &mut Path, sampler: &Sampler) -> Vertex<'a> {
        if self.work.settings.is_phong() {
            return self.phong_vertex(surface, path);
        }
        if let Some(extended) = surface.material.extended(&self.work.scene).filter(|_| self.model.specular) {
            return self.layered_vertex(surface, extended, path, sampler);
        }
        let z = surface.shading_normal;
        let (x, y) = z.any_orthonormal_pair();
        let frame = DMat3::from_cols(x, y, z);
        let bsdf = Reflection::Core(Bsdf::new(surface.layers(), self.model, frame.transpose() * -path.ray.direction));
        Vertex { surface, bsdf, frame, crossing: None, media: path.media, bounce: path.bounce }
    }

    #[inline(never)]
    fn phong_vertex<'a>(&self, surface: &'a Surface, path: &Path) -> Vertex<'a> {
        let z = surface.shading_normal;
        let (x, y) = z.any_orthonormal_pair();
        let frame = DMat3::from_cols(x, y, z);
        let (specular, wo) = (self.work.settings.direct.specular, frame.transpose() * -path.ray.direction);
        let phong = Phong::new(surface.layers(), surface.material.extended(&self.work.scene), specular, wo);
        let bsdf = Reflection::Phong(phong);
        Vertex { surface, bsdf, frame, crossing: None, media: path.media, bounce: path.bounce }
    }

    /// Of a material with extensions; apart, so that the way of all others stays short.
    #[inline(never)]
    fn layered_vertex<'a>(
        &self,
        surface: &'a Surface,
        extended: &Extended,
        path: &mut Path,
        sampler: &Sampler,
    ) -> Vertex<'a> {
        let (media, bounce) = (path.media, path.bounce);
        if extended.dispersion > 0.0 && path.wavelength.is_none() {
            let place = sampler.chance([u64::from(bounce), DISPERSION]);
            path.throughput *= media::colors_at(place);
            path.wavelength = Some(place);
        }
        let filled = surface.material.flags & Material::FILLED != 0;
        let id = media::id(surface.material);
        let crossing = filled.then(|| media.crossing(&self.work.scene, id, surface.back, path.wavelength));
        let frame = layers::frame(surface, Some(extended));
        let wo = frame.transpose() * -path.ray.direction;
        let layered = Layered::new(surface, extended, self.model, &frame, wo, crossing.as_ref(), path.wavelength);
        Vertex { surface, bsdf: Reflection::Layered(Box::new(layered)), frame, crossing, media, bounce }
    }

    /// Turns the path to where it goes on; false: it ends.
    /// `distance`: length of the ray that led here.
    pub(super) fn scatter(&self, vertex: &Vertex, path: &mut Path, distance: f64, sampler: &Sampler) -> bool {
        let [choice, survival] = sampler.pair(Dimension::Choice(vertex.bounce));
        let Some(scattered) = vertex.bsdf.sample(choice, sampler.pair(Dimension::Lobe(vertex.bounce))) else {
            return false;
        };
        let direction = vertex.frame * scattered.wi;
        let only_mirrors = self.work.settings.mode == Mode::Direct;
        // On the same side of the mesh as of the shading normal.
        let above = direction.dot(vertex.surface.geometric_normal);
        if (above > 0.0) != (scattered.wi.z > 0.0) || above == 0.0 || only_mirrors && scattered.pdf.is_some() {
            return false;
        }
        if vertex.surface.relief_shadows(direction) {
            return false;
        }
        path.throughput *= scattered.weight;
        match &vertex.bsdf {
            Reflection::Layered(layered) if layered.is_straight(scattered.wi) => path.passed += distance,
            _ => {
                (path.pdf, path.passed, path.facing) = (scattered.pdf, 0.0, self.facing(vertex));
                path.drawn_at = Receiver::of(&vertex.surface.place());
            }
        }
        if let Some(crossing) = vertex.crossing.as_ref().filter(|_| scattered.wi.z < 0.0) {
            path.media = crossing.beyond;
        }
        path.bounce += 1;
        if !self.survives(path, survival, ROULETTE_MOST) {
            return false;
        }
        let ends = [vertex.surface.primitive, TriangleId::NONE];
        let (origin, moment) = (vertex.surface.leave(direction), path.ray.moment);
        path.ray = Ray { origin, direction, t_max: f64::INFINITY, ends, moment };
        true
    }

    /// Emission that the path has come upon.
    fn emission(&self, path: &Path, surface: &Surface, hit: &Hit) -> DVec3 {
        let Some(emitter) = surface.emitter else { return DVec3::ZERO };
        let radiance = surface.emitted(path.ray.direction);
        let (Some(pdf), Mode::Path) = (path.pdf, self.work.settings.mode) else { return radiance };
        let lighting = &self.work.lighting;
        let probability = self.lights.of_emitter(emitter, &path.drawn_at) * (1.0 - self.environment_share());
        let (cosine, distance) = (path.ray.direction.dot(surface.geometric_normal), path.passed + hit.t);
        let pick = &lighting.picks[lighting.lights.len() + emitter];
        let area = area(&self.work.scene, pick.triangle, pick.area, path.ray.moment);
        radiance * self.scattered_weight(pdf, light::emitter_pdf(area, probability, distance * distance, cosine))
    }

    /// Light from infinity that a scattered path has come upon.
    fn distant(&self, path: &Path) -> DVec3 {
        let environment = &self.work.lighting.environment;
        let mut radiance = environment::radiance(environment, path.ray.direction);
        if let (Some(pdf), Some(hdri)) = (path.pdf, self.sampled_picture()) {
            let other = environment::pdf(hdri, environment.rotation, path.facing, path.ray.direction)
                * self.environment_share();
            radiance *= self.scattered_weight(pdf, other);
        }
        radiance + environment.ambient.as_dvec3()
    }

    /// Light that arrives straight from a light or the environment, by one sample; with its group.
    fn direct_light(&self, vertex: &Vertex, sampler: &Sampler) -> Option<(usize, DVec3)> {
        let place = vertex.surface.place();
        let light = self.light_sample(&place, self.facing(vertex), vertex.bounce, sampler)?;
        let above = light.direction.dot(vertex.surface.geometric_normal);
        if above <= 0.0 && vertex.bsdf.is_opaque() || light.weight.max_element() <= 0.0 {
            return None;
        }
        let wi = vertex.frame.transpose() * light.direction.normalize();
        if (above > 0.0) != (wi.z > 0.0) {
            return None;
        }
        let (value, pdf) = vertex.bsdf.evaluate(wi);
        let weight = light.pdf.map_or(1.0, |taken| self.sampled_weight(taken, pdf));
        let contribution = value * light.weight * weight;
        if contribution.max_element() <= 0.0 || vertex.surface.relief_shadows(light.direction.normalize()) {
            return None;
        }
        let ends = [vertex.surface.primitive, light.end];
        let (direction, moment) = (light.direction, place.moment);
        let ray = Ray { origin: light.origin, direction, t_max: light.t_max, ends, moment };
        if self.work.features.thin || self.work.features.volume {
            let beyond = vertex.crossing.as_ref().filter(|_| wi.z < 0.0).map(|crossing| crossing.beyond);
            let media = beyond.unwrap_or(vertex.media);
            return Some((light.group, contribution * self.transmittance(media, vertex.bounce, ray, sampler)));
        }
        let blocked = self.bvh.occluded(&ray, |hit| self.stops(hit, RayKind::Shadow, vertex.bounce, sampler));
        (!blocked).then_some((light.group, contribution))
    }

    /// Part of the light that comes through along a shadow ray, past thin and smooth walls and what the ray is in.
    #[inline(never)]
    fn transmittance(&self, media: Media, bounce: u32, mut ray: Ray, sampler: &Sampler) -> DVec3 {
        let end = ray.origin + ray.direction * ray.t_max;
        let mut part = DVec3::ONE;
        for _ in 0..MOST_WALLS {
            let hit = self.bvh.closest(&ray, |hit| self.stops(hit, RayKind::Shadow, bounce, sampler));
            let distance = hit.as_ref().map_or(ray.t_max, |hit| hit.t) * ray.direction.length();
            part *= media.transmittance(&self.work.scene, None, distance);
            let Some(hit) = hit else { return part };
            let direction = ray.direction.normalize();
            let surface = Surface::new(&self.work.scene, &hit, direction, ray.moment);
            part *= self.straight(&surface, direction);
            if part == DVec3::ZERO {
                return part;
            }
            ray.origin = surface.leave(direction);
            ray.ends[0] = surface.primitive;
            if ray.t_max.is_finite() {
                (ray.direction, ray.t_max) = (end - ray.origin, 1.0);
            }
        }
        DVec3::ZERO
    }

    /// Part of the light from straight ahead that passes a surface.
    fn straight(&self, surface: &Surface, direction: DVec3) -> DVec3 {
        let extended = surface.material.extended(&self.work.scene).filter(|extended| extended.passes_straight());
        let Some(extended) = extended.filter(|_| self.model.specular) else { return DVec3::ZERO };
        let frame = layers::frame(surface, Some(extended));
        Layered::new(surface, extended, self.model, &frame, frame.transpose() * -direction, None, None).straight()
    }

    pub(super) fn closest(&self, path: &Path, sampler: &Sampler) -> Option<Hit> {
        self.bvh.closest(&path.ray, |hit| self.stops(hit, RayKind::Path, path.bounce, sampler))
    }

    /// Whether a surface with alpha stops a ray: by chance, as much as it covers.
    fn stops(&self, hit: &Hit, kind: RayKind, bounce: u32, sampler: &Sampler) -> bool {
        let place = u64::from(hit.instance) << 32 | u64::from(hit.triangle);
        sampler.chance([u64::from(bounce) << 1 | kind as u64, place]) < coverage(&self.work.scene, hit)
    }
}
