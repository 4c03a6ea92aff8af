//! The material of glTF 2.0, appendix B, with Kulla and Conty's energy compensation, written in f64 from the papers and
//! in their terms rather than the shader's.

use super::quadrature::{Rectangle, integrate_evenly};
use candela::render::albedo::albedo_table;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Reflectance of a dielectric of index 1.5 at normal incidence.
const DIELECTRIC: f64 = 0.04;

/// Surface parameters; the base colour is grey.
#[derive(Debug, Clone, Copy)]
pub struct Material {
    /// Base colour of all channels.
    pub color: f64,
    /// 0 to 1.
    pub metallic: f64,
    /// Perceptual.
    pub roughness: f64,
    /// Energy compensation.
    pub multiple_scattering: bool,
}

/// Width of GGX.
fn alpha(roughness: f64) -> f64 {
    roughness * roughness
}

/// Smith's Lambda of GGX (Heitz 2014, eq. 72).
fn lambda(alpha: f64, cosine: f64) -> f64 {
    let tan2 = (1.0 - cosine * cosine).max(0.0) / (cosine * cosine);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// GGX (Walter et al. 2007, eq. 33), by the tangent of the angle.
fn ggx(alpha: f64, h: DVec3) -> f64 {
    let tan2 = (h.x * h.x + h.y * h.y) / (h.z * h.z);
    let cos4 = h.z.powi(4);
    alpha * alpha / (PI * cos4 * (alpha * alpha + tan2).powi(2))
}

fn schlick(f0: f64, cosine: f64) -> f64 {
    f0 + (1.0 - f0) * (1.0 - cosine).powi(5)
}

/// Density of `wo` reflected by visible normals (Heitz 2018, eq. 3 and 17), for directions below the horizon as well.
pub fn reflected_density(roughness: f64, wo: DVec3) -> impl Fn(DVec3) -> f64 {
    let a = alpha(roughness);
    let scale = 1.0 / (1.0 + lambda(a, wo.z)) / (4.0 * wo.z);
    move |wi| {
        let h = (wo + wi).normalize();
        if h.z > 0.0 { scale * ggx(a, h) } else { 0.0 }
    }
}

/// Albedo of the single-scattering lobe with Fresnel term 1, and with `(1 - V.H)^5`, by quadrature over half vectors.
///
/// `D cos` is integrated out by its distribution function `q = tan^2 / (alpha^2 + tan^2)`. Narrow lobes meet the horizon
/// where q is next to 1, so the first coordinate is `t` of `1 - q = (1 - t)^4`.
pub fn albedo(roughness: f64, cosine: f64) -> [f64; 2] {
    let a = alpha(roughness);
    let wo = DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
    [0, 5].map(|power| {
        let integrand = |t: f64, turn: f64| {
            let rest = (1.0 - t).powi(4);
            let tan = a * ((1.0 - rest) / rest).sqrt();
            let z = 1.0 / (1.0 + tan * tan).sqrt();
            let h = DVec3::new(tan * z * (PI * turn).cos(), tan * z * (PI * turn).sin(), z);
            let cos_h = wo.dot(h);
            let cos_i = 2.0 * cos_h * z - wo.z;
            if cos_h <= 0.0 || cos_i <= 0.0 {
                return 0.0;
            }
            let g2 = 1.0 / (1.0 + lambda(a, wo.z) + lambda(a, cos_i));
            4.0 * (1.0 - t).powi(3) * g2 * cos_h / (wo.z * z) * (1.0 - cos_h).powi(power)
        };
        integrate_evenly(&integrand, Rectangle::UNIT)
    })
}

/// The renderer's table of the same, bilinear, in f64.
pub fn tabulated_albedo(roughness: f64, cosine: f64) -> [f64; 2] {
    look_up(cosine.clamp(0.0, 1.0).sqrt() * 63.0, roughness * 63.0)
}

/// Its cosine-weighted means over the hemisphere.
pub fn tabulated_mean(roughness: f64) -> [f64; 2] {
    let x = roughness * 63.0;
    let i = (x as usize).min(62);
    let row = &albedo_table().texels[64 * 64..];
    std::array::from_fn(|k| lerp(f64::from(row[i][k]), f64::from(row[i + 1][k]), x - i as f64))
}

fn look_up(x: f64, y: f64) -> [f64; 2] {
    let (i, j) = ((x as usize).min(62), (y as usize).min(62));
    let texel = |i: usize, j: usize| albedo_table().texels[j * 64 + i].map(f64::from);
    let (u, v) = (x - i as f64, y - j as f64);
    std::array::from_fn(|k| {
        lerp(lerp(texel(i, j)[k], texel(i + 1, j)[k], u), lerp(texel(i, j + 1)[k], texel(i + 1, j + 1)[k], u), v)
    })
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

impl Material {
    fn f0(&self) -> f64 {
        lerp(DIELECTRIC, self.color, self.metallic)
    }

    fn diffuse(&self) -> f64 {
        self.color * (1.0 - self.metallic)
    }

    fn directional(&self, cosine: f64) -> [f64; 2] {
        tabulated_albedo(self.roughness, cosine)
    }

    /// Fresnel reflection of what is scattered more than once (Kulla and Conty 2017, slides 16 to 21).
    fn multiple_fresnel(&self, f0: f64) -> f64 {
        let mean = tabulated_mean(self.roughness)[0];
        let average = (20.0 * f0 + 1.0) / 21.0;
        average * average * mean / (1.0 - average * (1.0 - mean))
    }

    fn compensation(&self) -> f64 {
        if !self.multiple_scattering {
            return 0.0;
        }
        lerp(self.multiple_fresnel(DIELECTRIC), self.multiple_fresnel(self.color), self.metallic)
    }

    /// What the dielectric interface reflects towards a direction, all scattering together.
    fn interface(&self, [e, b]: [f64; 2]) -> f64 {
        let more = if self.multiple_scattering { self.multiple_fresnel(DIELECTRIC) * (1.0 - e) } else { 0.0 };
        DIELECTRIC * (e - b) + b + more
    }

    /// Probability of sampling the microfacet lobe: its share of the albedo.
    pub fn specular_probability(&self, cos_o: f64) -> f64 {
        let [e, b] = self.directional(cos_o);
        let specular = self.f0() * (e - b) + b;
        let rest = self.diffuse() * (1.0 - self.interface([e, b])) + self.compensation() * (1.0 - e);
        specular / (specular + rest)
    }

    /// Density of the mix of lobes, of directions below the horizon as well.
    pub fn density(&self, wo: DVec3) -> impl Fn(DVec3) -> f64 {
        let share = self.specular_probability(wo.z);
        let reflected = reflected_density(self.roughness, wo);
        move |wi| share * reflected(wi) + (1.0 - share) * wi.z.max(0.0) / PI
    }

    /// f cos.
    pub fn value(&self, wo: DVec3, wi: DVec3) -> f64 {
        let h = (wo + wi).normalize();
        let a = alpha(self.roughness);
        let g2 = 1.0 / (1.0 + lambda(a, wo.z) + lambda(a, wi.z));
        let facets = schlick(self.f0(), wo.dot(h)) * ggx(a, h) * g2 / (4.0 * wo.z * wi.z);
        (facets + self.base(wo, wi, wo.dot(h))) * wi.z
    }

    fn base(&self, wo: DVec3, wi: DVec3, cos_h: f64) -> f64 {
        if !self.multiple_scattering {
            return self.diffuse() * (1.0 - schlick(DIELECTRIC, cos_h)) / PI;
        }
        let through = |albedo| 1.0 - self.interface(albedo);
        let [out, inward] = [wo, wi].map(|w| self.directional(w.z));
        let mean = tabulated_mean(self.roughness);
        let coupled = through(out) * through(inward) / through(mean);
        let lost = (1.0 - out[0]) * (1.0 - inward[0]) / (1.0 - mean[0]).max(1e-6);
        (self.diffuse() * coupled + self.compensation() * lost) / PI
    }

    /// Albedo without energy compensation: what a white furnace must show with it off. Of the facet lobe's albedo and
    /// of the base's, both by quadrature.
    pub fn single_scattering_albedo(&self, [e, b]: [f64; 2], base: f64) -> f64 {
        self.f0() * (e - b) + b + self.diffuse() * base
    }
}

/// Integral of `(1 - F(V.H)) cos / pi` over directions: the albedo of a white base under glTF's interface.
pub fn lambert_below(cos_o: f64) -> f64 {
    let wo = DVec3::new((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o);
    let integrand = |u: f64, turn: f64| {
        let (z, phi) = (u.sqrt(), PI * turn);
        let r = (1.0 - u).sqrt();
        let h = (wo + DVec3::new(r * phi.cos(), r * phi.sin(), z)).normalize();
        1.0 - schlick(DIELECTRIC, wo.dot(h))
    };
    integrate_evenly(&integrand, Rectangle::UNIT)
}

/// Directions of the upper hemisphere as (1 - cos, azimuth from 0 to 2 pi); `wo` lies at azimuth 0.
pub const HEMISPHERE: Rectangle = Rectangle { low: [0.0, 0.0], high: [1.0, TAU] };

/// To these coordinates; none below the horizon. From the distance to the axis, which keeps its digits near it.
pub fn coordinates(w: DVec3) -> Option<[f64; 2]> {
    let squared = w.x * w.x + w.y * w.y;
    let depth = if w.z > 0.5 { squared / (1.0 + w.z) } else { 1.0 - w.z };
    (w.z > 0.0).then(|| [depth.min(1.0), w.y.atan2(w.x).rem_euclid(TAU)])
}

/// And back; depths beyond 1 lie below the horizon.
pub fn direction(depth: f64, azimuth: f64) -> DVec3 {
    let r = (depth * (2.0 - depth)).max(0.0).sqrt();
    DVec3::new(r * azimuth.cos(), r * azimuth.sin(), 1.0 - depth)
}

/// A viewer's direction, rounded as the shader gets it.
pub fn viewer(degrees: f64) -> DVec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    DVec3::new(f64::from(sin as f32), 0.0, f64::from(cos as f32))
}
