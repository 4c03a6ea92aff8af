//! Facets whose width differs along x and y (Heitz 2014, "Understanding the Masking-Shadowing Function in Microfacet-Based
//! BRDFs", 5.3 and appendix A; Heitz 2018 for sampling).

use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// GGX widths along x and y.
#[derive(Debug, Clone, Copy)]
pub struct Facets(pub DVec2);

impl Facets {
    /// Perceptual roughness of facets as wide in all directions that lose about as much light by scattering it more than once,
    /// and not less: the root mean square of the widths, and somewhat below it where they differ much.
    pub fn round_roughness(self) -> f64 {
        let DVec2 { x, y } = self.0;
        let apart = (x - y) / (x + y);
        ((0.5 * (x * x + y * y)).sqrt() * (1.0 - 0.08 * apart * apart)).sqrt()
    }

    /// Density of normals.
    pub fn distribution(self, h: DVec3) -> f64 {
        let stretched = DVec3::new(h.x / self.0.x, h.y / self.0.y, h.z);
        1.0 / (PI * self.0.x * self.0.y * stretched.length_squared().powi(2))
    }

    /// Smith's Lambda; the same for directions below.
    pub fn lambda(self, w: DVec3) -> f64 {
        let across = (self.0.x * w.x).powi(2) + (self.0.y * w.y).powi(2);
        0.5 * ((1.0 + across / (w.z * w.z)).sqrt() - 1.0)
    }

    /// Masking of one direction.
    pub fn masking(self, w: DVec3) -> f64 {
        1.0 / (1.0 + self.lambda(w))
    }

    /// Masking and shadowing of two directions on the same side.
    pub fn masking_both(self, wo: DVec3, wi: DVec3) -> f64 {
        1.0 / (1.0 + self.lambda(wo) + self.lambda(wi))
    }

    /// Density of the normals that `wo` sees.
    pub fn visible(self, wo: DVec3, h: DVec3) -> f64 {
        self.masking(wo) * wo.dot(h).max(0.0) * self.distribution(h) / wo.z
    }

    /// Draws one of them.
    pub fn sample(self, wo: DVec3, u: [f64; 2]) -> DVec3 {
        let up = DVec3::new(self.0.x * wo.x, self.0.y * wo.y, wo.z).normalize();
        let (radius, angle) = (u[0].sqrt(), 2.0 * PI * u[1]);
        let (x, y) = (radius * angle.cos(), radius * angle.sin());
        let x_axis = DVec3::new(-up.y, up.x, 0.0).try_normalize().unwrap_or(DVec3::X);
        let y_axis = up.cross(x_axis);
        let s = 0.5 * (1.0 + up.z);
        let y = (1.0 - s) * (1.0 - x * x).max(0.0).sqrt() + s * y;
        let z = (1.0 - x * x - y * y).max(0.0).sqrt();
        let h = x * x_axis + y * y_axis + z * up;
        DVec3::new(self.0.x * h.x, self.0.y * h.y, h.z.max(0.0)).normalize()
    }
}
