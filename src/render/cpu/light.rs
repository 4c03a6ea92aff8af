//! Lights that are sampled one at a time: punctual ones, those with an extent, and emitting triangles.

use super::bvh::TriangleId;
use super::extended_light::Shape;
use super::light_tree::{Receiver, Tree};
use super::place::{Place, area};
use super::sampling::uniform_triangle;
use super::surface::{emitted_at, material};
use crate::compile::{CompiledScene, LightPick, Lighting, Material, PunctualKind, PunctualLight, SURFACES_GROUP};
use crate::render::Work;
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::Arc;

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
    /// Index into `Lighting::groups`.
    pub group: usize,
}

/// A light that has been chosen.
#[derive(Debug, Clone, Copy)]
pub struct Picked {
    /// Into `Lighting::picks`.
    pub index: usize,
    /// Of it having been chosen.
    pub probability: f64,
}

/// Picks lights: emitters by their tree, if there is one, all others by their flux.
#[derive(Debug)]
pub struct LightSampler {
    scene: Arc<CompiledScene>,
    lighting: Arc<Lighting>,
    /// Probability of each entry of the table or one before it.
    cumulative: Vec<f64>,
    /// Of all before rounding.
    total: f64,
    inverse_total: f64,
    /// Of the tree.
    share: f64,
    both_sides: bool,
}

impl LightSampler {
    /// Over all lights of a request.
    pub fn new(work: &Work) -> Self {
        let mut total = 0.0;
        let cumulative = (work.lighting.table().iter())
            .map(|pick| {
                total += f64::from(pick.probability);
                total
            })
            .collect();
        Self {
            scene: Arc::clone(&work.scene),
            lighting: Arc::clone(&work.lighting),
            cumulative,
            total,
            inverse_total: total.recip(),
            share: f64::from(work.lighting.tree_probability),
            both_sides: work.features.transmission || work.features.diffuse_transmission,
        }
    }

    /// Whether there are any.
    pub fn is_empty(&self) -> bool {
        self.lighting.picks.is_empty()
    }

    /// A light for a place; none: those that were looked among do not reach it.
    pub fn pick(&self, receiver: &Receiver, u: f64) -> Option<Picked> {
        if u < self.share {
            let (emitter, probability) = self.tree().sample(receiver, u / self.share)?;
            return Some(Picked { index: self.lighting.lights.len() + emitter, probability: probability * self.share });
        }
        let u = (u - self.share) / (1.0 - self.share);
        let last = self.cumulative.len().checked_sub(1)?;
        let index = self.cumulative.partition_point(|&sum| sum <= u * self.total).min(last);
        Some(Picked { index, probability: self.in_table(index) })
    }

    /// Probability of picking one of the lights.
    pub fn of_light(&self, index: usize) -> f64 {
        self.in_table(index)
    }

    /// Probability of picking an emitter.
    pub fn of_emitter(&self, emitter: usize, receiver: &Receiver) -> f64 {
        let index = self.lighting.lights.len() + emitter;
        if self.share == 0.0 {
            return self.in_table(index);
        }
        self.share * self.tree().probability(receiver, self.lighting.picks[index].trail)
    }

    fn in_table(&self, index: usize) -> f64 {
        f64::from(self.lighting.picks[index].probability) * self.inverse_total * (1.0 - self.share)
    }

    fn tree(&self) -> Tree<'_> {
        Tree { nodes: &self.scene.light_tree.nodes, both_sides: self.both_sides }
    }
}

/// Light from a punctual light.
pub fn from_punctual(light: &PunctualLight, at: &Place) -> LightSample {
    let intensity = DVec3::from(light.intensity.map(f64::from));
    let axis = DVec3::from(light.direction.map(f64::from));
    if light.kind() == PunctualKind::Directional as u32 {
        let direction = -axis;
        let origin = at.leave(direction);
        return LightSample {
            origin,
            direction,
            t_max: f64::INFINITY,
            weight: intensity,
            end: TriangleId::NONE,
            pdf: None,
            group: light.group(),
        };
    }
    let position = DVec3::from(light.position.map(f64::from));
    let origin = at.leave(position - at.position);
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
        group: light.group(),
    }
}

/// Light from a place on a light with an extent; `probability` is that of the light. None: it does not shine here.
pub fn from_extended(light: &PunctualLight, probability: f64, at: &Place, u: [f64; 2]) -> Option<LightSample> {
    let found = Shape::new(light).sample(at.position, u)?;
    let pdf = found.pdf * probability;
    Some(LightSample {
        origin: at.leave(found.direction),
        direction: found.direction,
        t_max: found.distance,
        weight: radiance(light) / pdf,
        end: TriangleId::NONE,
        pdf: Some(pdf),
        group: light.group(),
    })
}

/// Of a light with an extent.
pub fn radiance(light: &PunctualLight) -> DVec3 {
    let intensity = DVec3::from(light.intensity.map(f64::from));
    match Shape::new(light) {
        // Lux over pi sin^2.
        Shape::Sun { versine, .. } => intensity / (PI * versine * (2.0 - versine)),
        Shape::Sphere { .. } | Shape::Disk { .. } | Shape::Rect(_) => intensity,
    }
}

/// Light from a uniform place on an emitting triangle; `probability` is that of the triangle.
pub fn from_emitter(scene: &CompiledScene, pick: &LightPick, probability: f64, at: &Place, u: [f64; 2]) -> LightSample {
    let triangle = &scene.triangles[pick.triangle as usize];
    let weights = uniform_triangle(u);
    let end = TriangleId { triangle: pick.triangle, instance: pick.index };
    let place = Place::new(scene, end, weights, at.moment);
    let away = at.position - place.position;
    let origin = at.leave(-away);
    let direction = place.leave(away) - origin;
    let distance2 = direction.length_squared();
    let cosine = -direction.dot(place.normal) / distance2.sqrt();
    let shines = cosine > 0.0 || material(scene, triangle).flags & Material::DOUBLE_SIDED != 0;
    let area = area(scene, pick.triangle, pick.area, at.moment);
    let pdf = emitter_pdf(area, probability, distance2, cosine);
    let visible = shines && pdf > 0.0;
    let radiance = || emitted_at(scene, pick.triangle, weights, cosine) * pdf.recip();
    let weight = if visible { radiance() } else { DVec3::ZERO };
    LightSample { origin, direction, t_max: 1.0, weight, end, pdf: Some(pdf), group: SURFACES_GROUP }
}

/// Density over solid angle of a place on an emitting triangle of this area that is seen at this distance and angle; 0 from its edge.
pub fn emitter_pdf(area: f64, probability: f64, distance2: f64, cosine: f64) -> f64 {
    if cosine == 0.0 { 0.0 } else { probability * distance2 / (area * cosine.abs()) }
}

/// KHR_lights_punctual, "Range Property".
fn window(distance2: f64, range: f64) -> f64 {
    let ratio = distance2 / (range * range);
    (1.0 - ratio * ratio).clamp(0.0, 1.0)
}

/// Part of the intensity towards a direction at this cosine from the axis.
fn cone(light: &PunctualLight, cosine: f64) -> f64 {
    let (inner, outer) = (f64::from(light.inner), f64::from(light.outer));
    match light.kind() {
        // KHR_lights_punctual, "Inner and Outer Cone Angles": cosines.
        kind if kind == PunctualKind::Spot as u32 => {
            ((cosine - outer) / (inner - outer).max(1e-7)).clamp(0.0, 1.0).powi(2)
        }
        // Linear in the angle: angles.
        kind if kind == PunctualKind::SpotLinear as u32 => {
            ((outer - cosine.clamp(-1.0, 1.0).acos()) / (outer - inner).max(1e-7)).clamp(0.0, 1.0)
        }
        kind if kind == PunctualKind::Cosine as u32 => cosine.max(0.0),
        _ => 1.0,
    }
}
