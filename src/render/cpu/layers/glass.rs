//! An interface that lets light through: facets that reflect and refract (Walter et al. 2007, "Microfacet Models for Refraction
//! through Rough Surfaces"), or thin walls, behind which light goes on as if it had not been bent (KHR_materials_transmission).
//!
//! Radiance is carried divided by the square of the index of refraction, which refraction leaves as it is.

use super::ggx::Facets;
use crate::render::cpu::material::{Scattered, luminance};
use crate::render::layer_albedo::glass_albedo;
use glam::DVec3;

/// Indices of refraction that differ by less, relative to one another, bend nothing.
const UNBENT: f64 = 1e-3;

/// What decides on an interface, besides the viewer.
#[derive(Debug, Clone, Copy)]
pub struct Interface {
    /// Index of refraction beyond the surface over that on the viewer's side.
    pub eta: f64,
    /// Light leaves a wall as it came.
    pub thin: bool,
    /// Reflectance at normal incidence and at the horizon.
    pub f0: DVec3,
    /// At the horizon.
    pub f90: f64,
    /// Factor on what passes.
    pub tint: DVec3,
    /// None: smooth.
    pub facets: Option<Facets>,
    /// Of facets as wide in all directions that lose as much.
    pub roughness: f64,
    /// Energy compensation.
    pub compensated: bool,
}

/// The interface towards one viewer.
#[derive(Debug)]
pub struct Glass {
    interface: Interface,
    wo: DVec3,
    /// Of facets; none: smooth, or without any effect on the direction.
    facets: Option<Facets>,
    /// On all that facets scatter: what they lose by scattering it more than once.
    scale: f64,
}

/// Shares of one facet.
struct Split {
    reflected: DVec3,
    passed: DVec3,
    /// Of sampling the reflection.
    probability: f64,
}

impl Glass {
    /// Seen from `wo`; `wall_albedo` is the directional albedo of facets that only reflect.
    pub fn new(interface: Interface, wo: DVec3, wall_albedo: f64) -> Self {
        let unbent = !interface.thin && (interface.eta - 1.0).abs() < UNBENT;
        let facets = interface.facets.filter(|_| !unbent);
        let albedo = match (facets.is_some() && interface.compensated, interface.thin) {
            (false, _) => 1.0,
            (true, true) => wall_albedo,
            (true, false) => f64::from(glass_albedo(wo.z, interface.roughness, interface.eta)),
        };
        Self { interface, wo, facets, scale: 1.0 / albedo.max(0.1) }
    }

    /// Part of the radiance from straight ahead that passes; zero: light is bent or scattered.
    pub fn straight(&self) -> DVec3 {
        if self.facets.is_some() || !self.interface.thin { DVec3::ZERO } else { self.split(self.wo.z).passed }
    }

    /// With the cosine, and the density.
    pub fn evaluate(&self, wi: DVec3) -> (DVec3, f64) {
        let Some(facets) = self.facets else { return (DVec3::ZERO, 0.0) };
        let Interface { eta, thin, .. } = self.interface;
        let below = wi.z < 0.0;
        if !below || thin {
            let mirrored = wi.with_z(wi.z.abs());
            let h = (self.wo + mirrored).normalize();
            let cosine = self.wo.dot(h);
            let density = facets.visible(self.wo, h) / (4.0 * cosine);
            let split = self.split(cosine);
            let (part, probability) = split.of(below);
            let masking = facets.masking_both(self.wo, mirrored) / facets.masking(self.wo);
            return (part * (density * masking * self.scale), density * probability);
        }
        // Towards the viewer's side, whichever side is denser.
        let h = (self.wo + eta * wi).normalize();
        let h = if h.z < 0.0 { -h } else { h };
        let (cos_o, cos_i) = (self.wo.dot(h), wi.dot(h));
        if cos_o <= 0.0 || cos_i >= 0.0 {
            return (DVec3::ZERO, 0.0);
        }
        let density = facets.visible(self.wo, h) * eta * eta * -cos_i / (cos_o + eta * cos_i).powi(2);
        let (part, probability) = self.split(cos_o).of(true);
        (part * (density * facets.masking(wi) * self.scale), density * probability)
    }

    /// Draws a direction; none: lost between facets.
    pub fn sample(&self, choice: f64, u: [f64; 2]) -> Option<Scattered> {
        let h = self.facets.map_or(DVec3::Z, |facets| facets.sample(self.wo, u));
        let cosine = self.wo.dot(h);
        let split = self.split(cosine);
        let passes = choice >= split.probability;
        let reflected = 2.0 * cosine * h - self.wo;
        let wi = match (passes, self.interface.thin) {
            (false, _) => reflected,
            (true, true) => reflected.with_z(-reflected.z),
            (true, false) => self.refracted(h, cosine)?,
        };
        if (wi.z < 0.0) != passes {
            return None;
        }
        if self.facets.is_none() {
            let (part, probability) = split.of(passes);
            // Exactly straight on, not by way of the normal.
            let wi = if passes && self.bends_nothing() { -self.wo } else { wi };
            return Some(Scattered { wi, weight: part / probability, pdf: None });
        }
        let (value, pdf) = self.evaluate(wi);
        (pdf > 0.0).then(|| Scattered { wi, weight: value / pdf, pdf: Some(pdf) })
    }

    fn bends_nothing(&self) -> bool {
        self.interface.thin || (self.interface.eta - 1.0).abs() < UNBENT
    }

    /// Snell's law; none: all is reflected.
    fn refracted(&self, h: DVec3, cosine: f64) -> Option<DVec3> {
        let eta = self.interface.eta;
        let below2 = 1.0 - (1.0 - cosine * cosine) / (eta * eta);
        (below2 > 0.0).then(|| (cosine / eta - below2.sqrt()) * h - self.wo / eta)
    }

    fn split(&self, cosine: f64) -> Split {
        let reflected = self.reflectance(cosine);
        let passed = (1.0 - reflected.max_element()) * self.interface.tint;
        let (a, b) = (luminance(reflected), luminance(passed));
        Split { reflected, passed, probability: if a + b > 0.0 { a / (a + b) } else { 1.0 } }
    }

    /// The dielectric's, stretched between the reflectances that KHR_materials_specular asks for.
    fn reflectance(&self, cosine: f64) -> DVec3 {
        let Interface { eta, f0, f90, .. } = self.interface;
        let exact = dielectric(cosine, eta);
        if exact >= 1.0 {
            return DVec3::ONE;
        }
        let normal = ((eta - 1.0) / (eta + 1.0)).powi(2);
        let rise = ((exact - normal) / (1.0 - normal)).clamp(0.0, 1.0);
        f0.lerp(DVec3::splat(f90), rise)
    }
}

impl Split {
    fn of(&self, passes: bool) -> (DVec3, f64) {
        if passes { (self.passed, 1.0 - self.probability) } else { (self.reflected, self.probability) }
    }
}

/// Reflectance of an interface for unpolarised light (Fresnel); 1 where nothing passes.
pub fn dielectric(cosine: f64, eta: f64) -> f64 {
    let below2 = 1.0 - (1.0 - cosine * cosine) / (eta * eta);
    if below2 <= 0.0 {
        return 1.0;
    }
    let below = below2.sqrt();
    let along = (eta * cosine - below) / (eta * cosine + below);
    let across = (cosine - eta * below) / (cosine + eta * below);
    0.5 * (along * along + across * across)
}
