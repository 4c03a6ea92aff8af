//! Phong's reflection for `mode: direct`: a mirror, and of what it leaves a diffuse part and a highlight.

use super::material::{Layers, Scattered};
use crate::compile::Extended;
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;

/// Least GGX width that a shininess is made of.
const LEAST_WIDTH: f64 = 1e-3;

/// The reflection of a point towards one viewer; directions in the frame of the shading normal.
#[derive(Debug)]
pub struct Phong {
    wo: DVec3,
    diffuse: DVec3,
    mirror: DVec3,
    shininess: f64,
    specular: f64,
}

impl Phong {
    /// Metals mirror in their colour, dielectrics by the index of refraction that their material states. The shininess is that
    /// of a highlight as wide as the facets'.
    pub fn new(layers: Layers, extended: Option<&Extended>, specular: f32, wo: DVec3) -> Self {
        let reflectance = extended.map_or(0.0, |extended| {
            let ior = f64::from(extended.ior);
            let root = if ior == 0.0 { 1.0 } else { (ior - 1.0) / (ior + 1.0) };
            root * root * f64::from(extended.specular)
        });
        let alpha = (layers.roughness * layers.roughness).max(LEAST_WIDTH);
        Self {
            wo,
            diffuse: layers.color * (1.0 - layers.metallic),
            mirror: DVec3::splat(reflectance).lerp(layers.color, layers.metallic),
            shininess: 0.5 / (alpha * alpha) - 0.5,
            specular: f64::from(specular),
        }
    }

    /// BRDF times the cosine, the mirror left out.
    pub fn evaluate(&self, wi: DVec3) -> DVec3 {
        if wi.z <= 0.0 {
            return DVec3::ZERO;
        }
        let along = DVec3::new(-wi.x, -wi.y, wi.z).dot(self.wo).max(0.0);
        let highlight = self.specular * along.powf(self.shininess);
        (DVec3::ONE - self.mirror) * (self.diffuse * wi.z + highlight) * FRAC_1_PI
    }

    /// The mirror's direction, if anything is mirrored.
    pub fn sample(&self) -> Option<Scattered> {
        let wi = DVec3::new(-self.wo.x, -self.wo.y, self.wo.z);
        (self.mirror.max_element() > 0.0).then_some(Scattered { wi, weight: self.mirror, pdf: None })
    }

    /// Part of light from all sides that is reflected diffusely.
    pub fn albedo(&self) -> DVec3 {
        (DVec3::ONE - self.mirror) * self.diffuse
    }
}
