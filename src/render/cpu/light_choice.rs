//! Which light is looked for, and how much what is found counts where a scattered ray could find it too.

use super::bvh::TriangleId;
use super::environment;
use super::extended_light::Shape;
use super::integrator::{Integrator, Path, Vertex};
use super::light::{self, LightSample};
use super::light_tree::Receiver;
use super::place::Place;
use super::sampler::{Dimension, Sampler};
use super::sampling::power_heuristic;
use crate::compile::{ANY_FACING, ENVIRONMENT_GROUP, EnvironmentKind, Features, Hdri, PunctualLight};
use crate::params::Mode;
use crate::render::Strategy;
use glam::DVec3;

impl Integrator {
    /// Weight of sampled light that a scattered ray can find too.
    pub(super) fn sampled_weight(&self, taken: f64, other: f64) -> f64 {
        let Strategy { light_samples, scattered_light, .. } = self.work.settings.strategy;
        if light_samples && scattered_light {
            power_heuristic(taken, other)
        } else {
            f64::from(u8::from(light_samples))
        }
    }

    /// Weight of light that a scattered ray has found, and a sample could have.
    pub(super) fn scattered_weight(&self, taken: f64, other: f64) -> f64 {
        let Strategy { light_samples, scattered_light, .. } = self.work.settings.strategy;
        if light_samples && scattered_light {
            power_heuristic(taken, other)
        } else {
            f64::from(u8::from(scattered_light))
        }
    }

    /// Light for a place, at the vertex of this index; `facing`: that of its surface.
    pub(super) fn light_sample(
        &self,
        place: &Place,
        facing: usize,
        vertex: u32,
        sampler: &Sampler,
    ) -> Option<LightSample> {
        let share = self.environment_share();
        if self.lights.is_empty() && share == 0.0 {
            return None;
        }
        // A lamp that is alone is not chosen.
        let chosen = share > 0.0 || self.work.lighting.picks.len() > 1;
        let [strategy, pick] = if chosen { sampler.pair(Dimension::Pick(vertex)) } else { [0.0; 2] };
        let u = sampler.pair(Dimension::Light(vertex));
        if let Some(hdri) = self.sampled_picture().filter(|_| strategy < share) {
            return Some(self.picture_sample(hdri, place, facing, share, u));
        }
        let lighting = &self.work.lighting;
        let picked = self.lights.pick(&Receiver::of(place), pick)?;
        let probability = picked.probability * (1.0 - share);
        match lighting.lights.get(picked.index) {
            Some(light) if light.has_extent() => light::from_extended(light, probability, place, u),
            Some(_) => {
                let light = place.moment.light(lighting, picked.index);
                let sample = light::from_punctual(&light, place);
                let candela = if self.work.features.profiles {
                    lighting.profile_factor(&light, -sample.direction.normalize())
                } else {
                    1.0
                };
                Some(LightSample { weight: sample.weight * (candela / probability), ..sample })
            }
            None => {
                let pick = &lighting.picks[picked.index];
                Some(light::from_emitter(&self.work.scene, pick, probability, place, u))
            }
        }
    }

    fn picture_sample(&self, hdri: &Hdri, place: &Place, facing: usize, share: f64, u: [f64; 2]) -> LightSample {
        let environment = &self.work.lighting.environment;
        let sky = environment::sample(hdri, environment.rotation, facing, u);
        let pdf = sky.pdf * share;
        LightSample {
            origin: place.leave(sky.direction),
            direction: sky.direction,
            t_max: f64::INFINITY,
            end: TriangleId::NONE,
            weight: environment::radiance(environment, sky.direction) / pdf,
            pdf: Some(pdf),
            group: ENVIRONMENT_GROUP,
        }
    }

    /// By which table directions of the picture are drawn at a vertex.
    pub(super) fn facing(&self, vertex: &Vertex) -> usize {
        let Features { transmission, diffuse_transmission, .. } = self.work.features;
        let both_sides = (transmission || diffuse_transmission) && !vertex.bsdf.is_opaque();
        if both_sides || self.sampled_picture().is_none() {
            return ANY_FACING;
        }
        environment::facing(self.work.lighting.environment.rotation, vertex.surface.shading_normal)
    }

    /// Part of the light samples that go to the environment: only a picture is worth any.
    pub(super) fn environment_share(&self) -> f64 {
        f64::from(self.work.lighting.environment_probability)
    }

    pub(super) fn sampled_picture(&self) -> Option<&Hdri> {
        match &self.work.lighting.environment.kind {
            EnvironmentKind::Hdri(hdri) if self.work.settings.mode == Mode::Path => Some(hdri),
            _ => None,
        }
    }

    /// Light that the path's ray meets on its way from lights with an extent, which it passes.
    pub(super) fn extended_light(&self, path: &Path, t_max: f64) -> DVec3 {
        let lights = &self.work.lighting.lights[..self.work.lighting.extended as usize];
        lights.iter().enumerate().map(|(index, light)| self.met_light(index, light, path, t_max)).sum()
    }

    /// The same from one of them.
    pub(super) fn met_light(&self, index: usize, light: &PunctualLight, path: &Path, t_max: f64) -> DVec3 {
        if path.bounce == 0 && light.kind & PunctualLight::VISIBLE == 0 {
            return DVec3::ZERO;
        }
        let shape = Shape::new(light);
        let (origin, direction) = (path.ray.origin, path.ray.direction);
        let Some(t) = shape.meet(origin, direction).filter(|t| *t <= t_max) else { return DVec3::ZERO };
        let part = path.pdf.map_or(1.0, |pdf| {
            let density = shape.pdf(path.drawn_at.position, direction, path.passed + t);
            self.scattered_weight(pdf, self.lights.of_light(index) * (1.0 - self.environment_share()) * density)
        });
        let clear = self.work.features.volume.then(|| path.media.transmittance(&self.work.scene, None, t));
        part * clear.unwrap_or(DVec3::ONE) * light::radiance(light)
    }
}
