//! The metallic-roughness material (glTF 2.0, appendix B) made energy conserving, as `docs/accuracy.md` defines it.
//!
//! Directions are unit vectors that point away from the surface, in a frame whose +z is the shading normal.
//! Three lobes: a GGX facet lobe with height-correlated Smith masking and Schlick's Fresnel term; what scatters between facets
//! more than once (Kulla and Conty 2017); a Lambert base that gets what the dielectric interface lets through on the way in and on
//! the way out (Kelemen and Szirmay-Kalos 2001).

use super::sampling::cosine_hemisphere;
use crate::compile::features::MIRROR_ROUGHNESS;
use crate::render::albedo::{TABLE_WIDTH, albedo_table};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_1_PI, TAU};

/// Normal-incidence reflectance of a dielectric of index 1.5.
const DIELECTRIC: f64 = 0.04;

/// What a material is made of at one point.
#[derive(Debug, Clone, Copy)]
pub struct Layers {
    /// Linear.
    pub color: DVec3,
    /// 0 to 1.
    pub metallic: f64,
    /// Perceptual.
    pub roughness: f64,
}

/// Which lobes there are.
#[derive(Debug, Clone, Copy)]
pub struct Model {
    /// Facets at all; without, the base alone is left.
    pub specular: bool,
    /// Energy compensation; without, the formulas of glTF's appendix.
    pub multiple_scattering: bool,
}

/// The reflection of a point towards one viewer.
#[derive(Debug)]
pub struct Bsdf {
    layers: Layers,
    model: Model,
    wo: DVec3,
    /// Width of the GGX distribution; 0: a mirror.
    alpha: f64,
    /// Reflectance of the facets at normal incidence.
    f0: DVec3,
    towards: Albedo,
    below: Below,
    /// Root of `cos^2 + alpha^2 sin^2` of the viewer: Smith's masking, as [`Bsdf::reach`] has it.
    reach: f64,
    /// Probability of sampling the facet lobe.
    facets: f64,
    /// What that takes the density of facets to that of directions with: `facets G1 / (4 cos)`.
    density: f64,
}

/// What is scattered otherwise than by one facet, from any direction towards the viewer: all but what depends on where
/// the light comes from.
#[derive(Debug, Clone, Copy)]
struct Below {
    /// Reflectance of the Lambert base, times what the interface lets out, over what it lets through in the mean.
    base: DVec3,
    /// Reflectance by several facets, over the part that the mean loses.
    between: DVec3,
    /// Part of what facets lose that the dielectric interface keeps from the base.
    kept: f64,
}

/// A direction that light is scattered from.
#[derive(Debug, Clone, Copy)]
pub struct Scattered {
    /// Where the light comes from.
    pub wi: DVec3,
    /// Reflected part of the radiance from there, over the density.
    pub weight: DVec3,
    /// Over solid angle; none: the only direction of a mirror.
    pub pdf: Option<f64>,
}

/// Directional albedo of the facet lobe: `single` with Fresnel term 1, `grazing` with `(1 - cos)^5` in its place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Albedo {
    pub single: f64,
    pub grazing: f64,
}

impl Bsdf {
    /// Seen from `wo`.
    pub fn new(layers: Layers, model: Model, wo: DVec3) -> Self {
        let mirror = layers.roughness < f64::from(MIRROR_ROUGHNESS);
        let alpha = if mirror { 0.0 } else { layers.roughness * layers.roughness };
        let base = layers.color * (1.0 - layers.metallic);
        let f0 = DVec3::splat(DIELECTRIC).lerp(layers.color, layers.metallic);
        let below = Below { base, between: DVec3::ZERO, kept: 0.0 };
        let none = Albedo { single: 0.0, grazing: 0.0 };
        let mut bsdf =
            Self { layers, model, wo, alpha, f0, towards: none, below, reach: 0.0, facets: 0.0, density: 0.0 };
        if model.specular {
            bsdf.towards = Albedo::towards(wo.z, layers.roughness);
            let rest;
            (bsdf.below, rest) = bsdf.below_facets(base);
            let (facets, rest) = (luminance(bsdf.towards.with_fresnel(f0)), luminance(rest));
            bsdf.facets = if facets + rest > 0.0 { facets / (facets + rest) } else { 0.0 };
            bsdf.reach = bsdf.reach(wo.z);
            bsdf.density = 0.5 * bsdf.facets / (wo.z + bsdf.reach);
        }
        bsdf
    }

    /// Reflected part of the radiance from `wi`, cosine included, and the density of sampling `wi`. A mirror's only
    /// direction is left out.
    pub fn evaluate(&self, wi: DVec3) -> (DVec3, f64) {
        if wi.z <= 0.0 || self.wo.z <= 0.0 {
            return (DVec3::ZERO, 0.0);
        }
        let mut value = self.diffuse(wi) * wi.z;
        let mut pdf = (1.0 - self.facets) * wi.z * FRAC_1_PI;
        if self.model.specular && self.alpha > 0.0 {
            let (single, normals) = self.single_facet(wi);
            value += single;
            pdf += self.density * normals;
        }
        (value, pdf)
    }

    /// Draws a direction; none: absorbed.
    pub fn sample(&self, choice: f64, u: [f64; 2]) -> Option<Scattered> {
        if choice >= self.facets {
            return self.scattered(cosine_hemisphere(u));
        }
        if self.alpha == 0.0 {
            let weight = schlick(self.f0, self.wo.z) * self.facets.recip();
            let wi = DVec3::new(-self.wo.x, -self.wo.y, self.wo.z);
            return (wi.z > 0.0).then_some(Scattered { wi, weight, pdf: None });
        }
        let h = self.visible_normal(u);
        self.scattered(2.0 * self.wo.dot(h) * h - self.wo)
    }

    /// Part of the light of a uniform surrounding that is reflected, mirrors left out.
    pub fn albedo(&self) -> DVec3 {
        let base = self.layers.color * (1.0 - self.layers.metallic);
        if !self.model.specular {
            return base;
        }
        let (_, rest) = self.below_facets(base);
        if self.alpha == 0.0 { rest } else { rest + self.towards.with_fresnel(self.f0) }
    }

    fn scattered(&self, wi: DVec3) -> Option<Scattered> {
        let (value, pdf) = self.evaluate(wi);
        (pdf > 0.0).then(|| Scattered { wi, weight: value * pdf.recip(), pdf: Some(pdf) })
    }

    /// What is below single facets, and its part of the light of a uniform surrounding.
    fn below_facets(&self, base: DVec3) -> (Below, DVec3) {
        let towards = self.towards;
        if !self.model.multiple_scattering {
            return (Below { base, between: DVec3::ZERO, kept: 0.0 }, base * (1.0 - towards.dielectric()));
        }
        let mean = Albedo::mean(self.layers.roughness);
        let dielectric = between_facets(DIELECTRIC, mean.single);
        let mut between = DVec3::splat(dielectric);
        if self.layers.metallic > 0.0 {
            let metal = self.layers.color.map(|f0| between_facets(f0, mean.single));
            between = between.lerp(metal, self.layers.metallic);
        }
        let passes = |albedo| passes_interface(albedo, dielectric);
        let (base, between) = (base * passes(towards), between * (1.0 - towards.single));
        let (through, lost) = (passes(mean), (1.0 - mean.single).max(1e-6));
        let inverse = (through * lost).recip();
        let below = Below { base: base * (lost * inverse), between: between * (through * inverse), kept: dielectric };
        (below, base + between)
    }

    /// The base and what facets scatter more than once, without the cosine.
    fn diffuse(&self, wi: DVec3) -> DVec3 {
        let Below { base, between, kept } = self.below;
        if !self.model.specular {
            return base * FRAC_1_PI;
        }
        if !self.model.multiple_scattering {
            let cos_h = self.wo.dot((self.wo + wi).normalize());
            return base * (DVec3::ONE - schlick(DVec3::splat(DIELECTRIC), cos_h)) * FRAC_1_PI;
        }
        let from = Albedo::towards(wi.z, self.layers.roughness);
        (base * passes_interface(from, kept) + between * (1.0 - from.single)) * FRAC_1_PI
    }

    /// D F G2 / (4 cos), and D: GGX (Walter et al. 2007, eq. 33), height-correlated Smith masking (Heitz 2014, eq. 99) by way of
    /// `G2 = 2 cos_i cos_o / (cos_i reach_o + cos_o reach_i)`, all over one denominator.
    ///
    /// The density of reflected visible normals is D G1 / (4 cos) (Heitz 2018, eq. 3 and 17), where `G1 = 2 cos / (cos + reach)`.
    fn single_facet(&self, wi: DVec3) -> (DVec3, f64) {
        let a2 = self.alpha * self.alpha;
        let h = self.wo + wi;
        let length2 = h.length_squared();
        let spread = h.x * h.x + h.y * h.y + a2 * h.z * h.z;
        let masked = wi.z * self.reach + self.wo.z * self.reach(wi.z);
        let shared = FRAC_1_PI * a2 * length2 * length2 / (spread * spread * masked);
        // Half the length is the cosine between the half vector and either direction.
        (schlick(self.f0, 0.5 * length2.sqrt()) * (0.5 * wi.z * shared), masked * shared)
    }

    fn reach(&self, cosine: f64) -> f64 {
        let a2 = self.alpha * self.alpha;
        (a2 + (1.0 - a2) * cosine * cosine).sqrt()
    }

    /// Draws from the visible normals (Heitz 2018, "Sampling the GGX Distribution of Visible Normals", listing 1).
    fn visible_normal(&self, u: [f64; 2]) -> DVec3 {
        let stretched = DVec3::new(self.alpha * self.wo.x, self.alpha * self.wo.y, self.wo.z).normalize();
        let flat = stretched.x * stretched.x + stretched.y * stretched.y;
        let across = if flat > 0.0 { DVec3::new(-stretched.y, stretched.x, 0.0) / flat.sqrt() } else { DVec3::X };
        let up = stretched.cross(across);
        let disk = DVec2::from_angle(TAU * u[1]) * u[0].sqrt();
        let s = 0.5 * (1.0 + stretched.z);
        let y = (1.0 - s) * (1.0 - disk.x * disk.x).max(0.0).sqrt() + s * disk.y;
        let z = (1.0 - disk.x * disk.x - y * y).max(0.0).sqrt();
        let h = disk.x * across + y * up + z * stretched;
        DVec3::new(self.alpha * h.x, self.alpha * h.y, h.z.max(0.0)).normalize()
    }
}

impl Albedo {
    pub fn towards(cosine: f64, roughness: f64) -> Self {
        let (column, across) = step(cosine.clamp(0.0, 1.0).sqrt());
        let (row, down) = step(roughness);
        let above = row * TABLE_WIDTH as usize + column;
        let below = above + TABLE_WIDTH as usize;
        let texels = &albedo_table().texels;
        let [high, low] = [above, below].map(|first| between(texels[first], texels[first + 1], across));
        Self { single: high[0] + (low[0] - high[0]) * down, grazing: high[1] + (low[1] - high[1]) * down }
    }

    /// Cosine-weighted mean over all directions.
    pub fn mean(roughness: f64) -> Self {
        let (row, down) = step(roughness);
        let first = (TABLE_WIDTH * TABLE_WIDTH) as usize + row;
        let texels = &albedo_table().texels;
        let [single, grazing] = between(texels[first], texels[first + 1], down);
        Self { single, grazing }
    }

    /// With Schlick's Fresnel term, which is linear in `f0`.
    fn with_fresnel(self, f0: DVec3) -> DVec3 {
        f0 * (self.single - self.grazing) + self.grazing
    }

    /// With that of a dielectric.
    fn dielectric(self) -> f64 {
        DIELECTRIC * (self.single - self.grazing) + self.grazing
    }
}

/// The entry of a table's row that lies below a number from 0 to 1, but not the last, and how far it is from there to the next.
fn step(x: f64) -> (usize, f64) {
    let place = x * f64::from(TABLE_WIDTH - 1);
    let entry = (place as usize).min(TABLE_WIDTH as usize - 2);
    (entry, place - entry as f64)
}

/// Linear between two entries of the table.
fn between(low: [f32; 2], high: [f32; 2], weight: f64) -> [f64; 2] {
    std::array::from_fn(|i| f64::from(low[i]) + (f64::from(high[i]) - f64::from(low[i])) * weight)
}

/// Part of the light that the dielectric interface lets through to the base, or out; `kept`: of what is lost to other facets,
/// the part that stays out.
fn passes_interface(albedo: Albedo, kept: f64) -> f64 {
    1.0 - albedo.dielectric() - kept * (1.0 - albedo.single)
}

/// Reflectance of what leaves the facets after two or more bounces, relative to a white metal's; `mean`: albedo of one bounce
/// over the hemisphere (Kulla and Conty 2017, with Schlick's term averaged over the cosine).
fn between_facets(f0: f64, mean: f64) -> f64 {
    let average = f0 + (1.0 - f0) / 21.0;
    average * average * mean / (1.0 - average * (1.0 - mean))
}

/// Fresnel reflectance (Schlick 1994).
fn schlick(f0: DVec3, cosine: f64) -> DVec3 {
    f0 + (1.0 - f0) * (1.0 - cosine).powi(5)
}

/// Of linear Rec. 709.
pub fn luminance(color: DVec3) -> f64 {
    color.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}
