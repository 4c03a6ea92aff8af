//! Fibres that stand on a surface (KHR_materials_sheen; Estevez and Kulla 2017, "Production Friendly Microfacet Sheen BRDF").

use crate::render::layer_albedo::{SHEEN_LEAST_ROUGHNESS, sheen_albedo};
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// A sheen.
#[derive(Debug, Clone, Copy)]
pub struct Sheen {
    /// Linear.
    pub color: DVec3,
    /// Width of the distribution: square of the perceptual roughness.
    alpha: f64,
    /// Part of the light that it reflects towards the viewer, if white.
    pub albedo: f64,
}

impl Sheen {
    /// Seen at a cosine.
    pub fn new(color: DVec3, roughness: f64, cosine: f64) -> Self {
        let roughness = roughness.max(SHEEN_LEAST_ROUGHNESS);
        Self { color, alpha: roughness * roughness, albedo: f64::from(sheen_albedo(cosine, roughness)) }
    }

    /// What is left for the layers below.
    pub fn rest(&self) -> f64 {
        1.0 - self.color.max_element() * self.albedo
    }

    /// Reflected part with the cosine; both directions are above.
    pub fn value(&self, wo: DVec3, wi: DVec3) -> DVec3 {
        let h = (wo + wi).normalize();
        let inverse = 1.0 / self.alpha;
        let sine = (1.0 - h.z * h.z).max(0.0).sqrt();
        let distribution = (2.0 + inverse) * sine.powf(inverse) / TAU;
        let masking = 1.0 / (1.0 + self.lambda(wo.z) + self.lambda(wi.z));
        self.color * (distribution * masking / (4.0 * wo.z))
    }

    /// Uniform over the hemisphere: at grazing angles the lobe does not fall with the cosine.
    pub fn pdf(&self) -> f64 {
        1.0 / TAU
    }

    /// Draws a direction.
    pub fn sample(&self, u: [f64; 2]) -> DVec3 {
        let z = u[0];
        let radius = (1.0 - z * z).max(0.0).sqrt();
        let angle = 2.0 * PI * u[1];
        DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
    }

    /// Fit of Smith's Lambda (section 3 of the paper).
    fn lambda(&self, cosine: f64) -> f64 {
        if cosine < 0.5 { self.fit(cosine).exp() } else { (2.0 * self.fit(0.5) - self.fit(1.0 - cosine)).exp() }
    }

    fn fit(&self, x: f64) -> f64 {
        let weight = (1.0 - self.alpha).powi(2);
        let between = |smooth: f64, rough: f64| weight * smooth + (1.0 - weight) * rough;
        let [a, b] = [between(25.3245, 21.5473), between(3.32435, 3.82987)];
        let [c, d, e] = [between(0.16801, 0.19823), between(-1.27393, -1.97760), between(-4.85967, -4.32054)];
        a / (1.0 + b * x.powf(c)) + d * x + e
    }
}
