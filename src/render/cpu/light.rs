//! Lights that are sampled one at a time: punctual ones and emitting triangles.

use super::bvh::TriangleId;
use super::sampling::uniform_triangle;
use super::surface::{Place, Surface, emitted_at, material};
use crate::compile::{CompiledScene, LightPick, Lighting, Material, PunctualKind, PunctualLight};
use glam::DVec3;

/// Light that arrives at a point, unless something is in the way.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// Where the shadow ray begins.
    pub origin: DVec3,
    /// Towards the light; not of unit length.
    pub direction: DVec3,
    /// The light is at this multiple of the direction.
    pub t_max: f64,
    /// Radiance over density; of a punctual light irradiance at normal incidence over probability.
    pub weight: DVec3,
    /// What the shadow ray ends on.
    pub end: TriangleId,
    /// Over solid angle; none: a punctual light, which no ray can hit.
    pub pdf: Option<f64>,
}

/// Picks lights by their probabilities.
#[derive(Debug)]
pub struct LightSampler {
    /// Probability of each entry of `Lighting::picks` or one before it.
    cumulative: Vec<f64>,
    /// Of all before rounding.
    total: f64,
    inverse_total: f64,
}

impl LightSampler {
    /// Over all lights of a request.
    pub fn new(lighting: &Lighting) -> Self {
        let mut total = 0.0;
        let cumulative = (lighting.picks.iter())
            .map(|pick| {
                total += f64::from(pick.probability);
                total
            })
            .collect();
        Self { cumulative, total, inverse_total: total.recip() }
    }

    /// Whether there are any.
    pub fn is_empty(&self) -> bool {
        self.cumulative.is_empty()
    }

    /// Index of a light.
    pub fn pick(&self, u: f64) -> usize {
        self.cumulative.partition_point(|&sum| sum <= u * self.total).min(self.cumulative.len() - 1)
    }

    /// Probability of a light.
    pub fn probability(&self, lighting: &Lighting, index: usize) -> f64 {
        f64::from(lighting.picks[index].probability) * self.inverse_total
    }
}

/// Light from a punctual light.
pub fn from_punctual(light: &PunctualLight, surface: &Surface) -> LightSample {
    let intensity = DVec3::from(light.intensity.map(f64::from));
    let axis = DVec3::from(light.direction.map(f64::from));
    if light.kind == PunctualKind::Directional as u32 {
        let direction = -axis;
        let origin = surface.leave(direction);
        return LightSample {
            origin,
            direction,
            t_max: f64::INFINITY,
            weight: intensity,
            end: TriangleId::NONE,
            pdf: None,
        };
    }
    let position = DVec3::from(light.position.map(f64::from));
    let origin = surface.leave(position - surface.position);
    let direction = position - origin;
    let distance2 = direction.length_squared();
    let cosine = -axis.dot(direction) / distance2.sqrt();
    let part = window(distance2, f64::from(light.range)) * cone(light, cosine);
    LightSample {
        origin,
        direction,
        t_max: 1.0,
        weight: intensity * part / distance2,
        end: TriangleId::NONE,
        pdf: None,
    }
}

/// Light from a uniform place on an emitting triangle; `probability` is that of the triangle.
pub fn from_emitter(
    scene: &CompiledScene,
    pick: &LightPick,
    probability: f64,
    surface: &Surface,
    u: [f64; 2],
) -> LightSample {
    let triangle = &scene.triangles[pick.triangle as usize];
    let weights = uniform_triangle(u);
    let place = Place::new(scene, triangle, &scene.instances[pick.index as usize], weights);
    let away = surface.position - place.position;
    let origin = surface.leave(-away);
    let direction = place.leave(away) - origin;
    let distance2 = direction.length_squared();
    let cosine = -direction.dot(place.normal) / distance2.sqrt();
    let shines = cosine > 0.0 || material(scene, triangle).flags & Material::DOUBLE_SIDED != 0;
    let pdf = emitter_pdf(pick, probability, distance2, cosine);
    let visible = shines && pdf > 0.0;
    let radiance = || emitted_at(scene, pick.triangle, weights, cosine) * pdf.recip();
    let weight = if visible { radiance() } else { DVec3::ZERO };
    let end = TriangleId { triangle: pick.triangle, instance: pick.index };
    LightSample { origin, direction, t_max: 1.0, weight, end, pdf: Some(pdf) }
}

/// Density over solid angle of a place on an emitting triangle that is seen at this distance and angle; 0 from its edge.
pub fn emitter_pdf(pick: &LightPick, probability: f64, distance2: f64, cosine: f64) -> f64 {
    if cosine == 0.0 { 0.0 } else { probability * distance2 / (f64::from(pick.area) * cosine.abs()) }
}

/// KHR_lights_punctual, "Range Property".
fn window(distance2: f64, range: f64) -> f64 {
    let ratio = distance2 / (range * range);
    (1.0 - ratio * ratio).clamp(0.0, 1.0)
}

/// Part of the intensity towards a direction at this cosine from the axis.
fn cone(light: &PunctualLight, cosine: f64) -> f64 {
    let (inner, outer) = (f64::from(light.inner), f64::from(light.outer));
    match light.kind {
        // KHR_lights_punctual, "Inner and Outer Cone Angles": cosines.
        kind if kind == PunctualKind::Spot as u32 => {
            ((cosine - outer) / (inner - outer).max(1e-7)).clamp(0.0, 1.0).powi(2)
        }
        // Linear in the angle: angles.
        kind if kind == PunctualKind::SpotLinear as u32 => {
            ((outer - cosine.clamp(-1.0, 1.0).acos()) / (outer - inner).max(1e-7)).clamp(0.0, 1.0)
        }
        _ => 1.0,
    }
}
