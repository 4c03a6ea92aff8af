//! Interference in a thin film (KHR_materials_iridescence; Belcour and Barla 2017, "A Practical Extension to Microfacet Theory
//! for the Modeling of Varying Iridescence").

use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// A film on a surface.
#[derive(Debug, Clone, Copy)]
pub struct Film {
    /// 0 to 1.
    pub strength: f64,
    /// Index of refraction.
    pub ior: f64,
    /// Nanometres.
    pub thickness: f64,
}

impl Film {
    /// Reflectance at normal incidence of a surface under the film, such that Schlick's formula gives the film's at `cosine`.
    pub fn over(&self, f0: DVec3, cosine: f64) -> DVec3 {
        let grazing = (1.0 - cosine).powi(5);
        let seen = self.reflectance(f0, cosine);
        let flat = if grazing > 0.999 { seen } else { (seen - grazing) / (1.0 - grazing) };
        f0.lerp(flat.clamp(DVec3::ZERO, DVec3::ONE), self.strength)
    }

    /// Reflectance of air, film and a base of reflectance `f0`.
    fn reflectance(&self, f0: DVec3, cosine: f64) -> DVec3 {
        // Without thickness the film is air.
        let t = (self.thickness / 0.03).clamp(0.0, 1.0);
        let ior = 1.0 + (self.ior - 1.0) * t * t * (3.0 - 2.0 * t);
        let below2 = 1.0 - (1.0 - cosine * cosine) / (ior * ior);
        if below2 <= 0.0 {
            return DVec3::ONE;
        }
        let below = below2.sqrt();
        let air = schlick(at_normal(ior), cosine);
        let base_ior = f0.clamp(DVec3::ZERO, DVec3::splat(0.9999)).map(|f| (1.0 + f.sqrt()) / (1.0 - f.sqrt()));
        let base = base_ior.map(|base| schlick(at_normal(base / ior), below));
        // The film is denser than air: its lower side turns the phase by half, the base does if it is denser than the film.
        let phase = base_ior.map(|base| if base < ior { PI + PI } else { PI });
        let path = 2.0 * ior * self.thickness * 1e-9 * below;
        let through = 1.0 - air;
        let round_trip = (air * base).clamp(DVec3::splat(1e-5), DVec3::splat(0.9999));
        let sum = through * through * base / (1.0 - round_trip);
        let mut total = air + sum;
        let mut amplitude = sum - through;
        for order in [1.0, 2.0] {
            amplitude *= round_trip.map(f64::sqrt);
            total += amplitude * 2.0 * sensitivity(order * path, order * phase);
        }
        total.max(DVec3::ZERO)
    }
}

fn at_normal(ratio: f64) -> f64 {
    ((ratio - 1.0) / (ratio + 1.0)).powi(2)
}

fn schlick(f0: f64, cosine: f64) -> f64 {
    f0 + (1.0 - f0) * (1.0 - cosine).powi(5)
}

/// Fourier transform of the eye's sensitivity, by Gaussians in wave number, as linear Rec. 709.
fn sensitivity(path: f64, shift: DVec3) -> DVec3 {
    let k = TAU * path;
    let bell = |height: f64, centre: f64, variance: f64, shift: f64| {
        height * (TAU * variance).sqrt() * (centre * k + shift).cos() * (-variance * k * k).exp()
    };
    let xyz = DVec3::new(
        bell(5.4856e-13, 1.6810e6, 4.3278e9, shift.x) + bell(9.7470e-14, 2.2399e6, 4.5282e9, shift.x),
        bell(4.4201e-13, 1.7953e6, 9.3046e9, shift.y),
        bell(5.2481e-13, 2.2084e6, 6.6121e9, shift.z),
    );
    let to_rec709 = DMat3::from_cols(
        DVec3::new(3.240_454_2, -0.969_266_0, 0.055_643_4),
        DVec3::new(-1.537_138_5, 1.876_010_8, -0.204_025_9),
        DVec3::new(-0.498_531_4, 0.041_556_0, 1.057_225_2),
    );
    to_rec709 * xyz / 1.0685e-7
}
