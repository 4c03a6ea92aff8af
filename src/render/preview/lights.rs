//! Lights as a preview reads them: where each ends, in which order, and which cast shadows.

use super::faces;
use super::layout::{PreviewLight, Projection};
use crate::compile::{CompiledScene, Lighting, PunctualKind, PunctualLight, View};
use crate::params::{AttenuationKind, PreviewParams, ShadowAlgorithm};
use glam::Vec3;
use std::cmp::Reverse;

/// Where the brightest channel falls to, of an author's lights that have no range.
const USUAL_CUTOFF: f32 = 5.0 / 256.0;

/// Lights in the order in which their light is added up.
#[derive(Debug, Default)]
pub struct PreviewLights {
    /// Those without an end first.
    pub lights: Vec<PreviewLight>,
    /// Number of those.
    pub unbounded: u32,
    /// Shadow maps of all of them.
    pub faces: Vec<Projection>,
}

impl PreviewLights {
    /// The lights of a scene under the given choices. A light that ends where it begins is left out.
    pub fn new(scene: &CompiledScene, lighting: &Lighting, params: &PreviewParams, view: &View) -> Self {
        let begin = |source: &PunctualLight| PreviewLight {
            source: PunctualLight { kind: source.kind(), ..*source },
            radius: 0.0,
            first_face: 0,
            face_count: 0,
            profile: source.profile().map_or(0, |index| index as u32 + 1),
        };
        let mut lights: Vec<_> = lighting.lights.iter().map(begin).collect();
        lights.iter_mut().for_each(|light| light.radius = radius(&brightest(light, lighting), params));
        lights.retain(|light| light.radius > 0.0);
        lights.sort_by_key(|light| light.radius.is_finite());
        let unbounded = lights.iter().filter(|light| !light.radius.is_finite()).count() as u32;
        let mut all = Self { lights, unbounded, faces: Vec::new() };
        all.cast_shadows(scene, lighting, params, view);
        all
    }

    fn cast_shadows(&mut self, scene: &CompiledScene, lighting: &Lighting, params: &PreviewParams, view: &View) {
        if params.shadows.algorithm == ShadowAlgorithm::None || scene.triangles.is_empty() {
            return;
        }
        let mut order: Vec<usize> = (0..self.lights.len()).collect();
        let strength = |index: &usize| strength(&brightest(&self.lights[*index], lighting), scene);
        order.sort_by(|a, b| strength(b).total_cmp(&strength(a)).then(a.cmp(b)));
        order.truncate(params.shadows.max_lights as usize);
        order.sort_by_key(|&index| Reverse(index));
        while let Some(index) = order.pop() {
            let light = &mut self.lights[index];
            let fitted = faces::fit(&light.source, &scene.bounds, view);
            light.first_face = self.faces.len() as u32;
            light.face_count = fitted.len() as u32;
            self.faces.extend(fitted);
        }
    }
}

/// A light as bright on all sides as its profile is at the most.
fn brightest(light: &PreviewLight, lighting: &Lighting) -> PunctualLight {
    let profile = light.profile.checked_sub(1).and_then(|index| lighting.profiles.get(index as usize));
    let peak = profile.map_or(1.0, |profile| profile.peak);
    PunctualLight { intensity: light.source.intensity.map(|channel| channel * peak), ..light.source }
}

/// Distance at which a light ends.
fn radius(light: &PunctualLight, params: &PreviewParams) -> f32 {
    if light.kind == PunctualKind::Directional as u32 {
        return f32::INFINITY;
    }
    let brightest = light.intensity.into_iter().fold(0.0, f32::max);
    let cutoff = params.cutoff();
    let falls_to = |cutoff: f32| (brightest / cutoff).sqrt();
    match params.attenuation.kind {
        AttenuationKind::Physical => light.range.min(falls_to(cutoff)),
        AttenuationKind::Polynomial => light.range.min(polynomial_radius(params, brightest / cutoff)),
        AttenuationKind::Range if light.range.is_finite() => light.range,
        AttenuationKind::Range => falls_to(USUAL_CUTOFF),
    }
}

/// Distance at which `1 / (Kc + Kl d + Kq d^2)` is `1 / ratio`, the larger root without cancellation; 0 if it is smaller
/// everywhere.
fn polynomial_radius(params: &PreviewParams, ratio: f32) -> f32 {
    let (c, l, q) = (params.attenuation.constant, params.attenuation.linear, params.attenuation.quadratic);
    let rest = f64::from(ratio) - f64::from(c);
    if rest <= 0.0 {
        return 0.0;
    }
    let (l, q) = (f64::from(l), f64::from(q));
    // The same as (-l + sqrt(l^2 + 4 q rest)) / 2 q, and true where q is 0.
    (2.0 * rest / (l + (l * l + 4.0 * q * rest).sqrt())) as f32
}

/// Illuminance at the scene's centre, or at its edge if the light is nearer than that.
fn strength(light: &PunctualLight, scene: &CompiledScene) -> f64 {
    let brightest = f64::from(light.intensity.into_iter().fold(0.0, f32::max));
    if light.kind == PunctualKind::Directional as u32 {
        return brightest;
    }
    let distance = Vec3::from_array(light.position).as_dvec3().distance(scene.bounds.centre());
    brightest / distance.max(scene.bounds.radius()).max(1e-30).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Attenuation;

    fn point(intensity: f32, range: f32) -> PunctualLight {
        PunctualLight { kind: PunctualKind::Point as u32, intensity: [intensity; 3], range, ..PunctualLight::default() }
    }

    fn with(kind: AttenuationKind) -> PreviewParams {
        PreviewParams { attenuation: Attenuation { kind, ..Attenuation::default() }, ..PreviewParams::default() }
    }

    #[test]
    fn a_light_ends_where_its_brightest_channel_falls_to_the_cutoff() {
        let params = with(AttenuationKind::Polynomial);
        for intensity in [0.1, 1.0, 50.0, 1e6] {
            let r = radius(&point(intensity, f32::INFINITY), &params);
            // The author's formula.
            let (c, l, q) = (1.0f64, 0.7f64, 1.8f64);
            let formula = (-l + (l * l - 4.0 * q * (c - f64::from(intensity) * 256.0 / 5.0)).sqrt()) / (2.0 * q);
            assert!((f64::from(r) - formula).abs() < 1e-5 * formula, "{r} for {formula}");
        }
        assert_eq!(radius(&point(0.01, f32::INFINITY), &params), 0.0);
        let line = Attenuation { kind: AttenuationKind::Polynomial, constant: 1.0, linear: 2.0, quadratic: 0.0 };
        let r = radius(&point(1.0, f32::INFINITY), &PreviewParams { attenuation: line, ..params });
        assert!((r - (256.0 / 5.0 - 1.0) / 2.0).abs() < 1e-4, "{r}");
    }

    #[test]
    fn physical_lights_end_at_their_range_or_nowhere() {
        let params = with(AttenuationKind::Physical);
        assert_eq!(radius(&point(1.0, f32::INFINITY), &params), f32::INFINITY);
        assert_eq!(radius(&point(1.0, 3.0), &params), 3.0);
        let cut = PreviewParams { cutoff: Some(0.25), ..params };
        assert_eq!(radius(&point(1.0, 3.0), &cut), 2.0);
    }

    #[test]
    fn lights_without_an_end_come_first_and_the_strongest_cast_shadows() {
        let scene = CompiledScene {
            bounds: crate::compile::Bounds { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) },
            triangles: vec![crate::compile::Triangle::default()],
            ..CompiledScene::default()
        };
        let view = faces::tests::camera(Vec3::ZERO, 9.0);
        let lights = vec![point(1.0, 3.0), point(2.0, f32::INFINITY), point(9.0, 5.0), point(3.0, f32::INFINITY)];
        let lights = Lighting { lights, ..Lighting::default() };
        let mut params = with(AttenuationKind::Physical);
        params.shadows.max_lights = 2;
        let all = PreviewLights::new(&scene, &lights, &params, &view);
        assert_eq!(all.lights.iter().map(|light| light.source.intensity[0]).collect::<Vec<_>>(), [2.0, 3.0, 1.0, 9.0]);
        assert_eq!(all.unbounded, 2);
        assert_eq!(all.lights.iter().map(|light| light.face_count).collect::<Vec<_>>(), [0, 6, 0, 6]);
        assert_eq!(all.faces.len(), 12);
        params.shadows.algorithm = ShadowAlgorithm::None;
        assert!(PreviewLights::new(&scene, &lights, &params, &view).faces.is_empty());
    }
}
