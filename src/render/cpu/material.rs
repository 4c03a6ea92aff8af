//! The metallic-roughness material (glTF 2.0, appendix B) made energy conserving, as `docs/accuracy.md` defines it.
//!
//! Directions are unit vectors that point away from the surface, in a frame whose +z is the shading normal.
//! Three lobes: a GGX facet lobe with height-correlated Smith masking and Schlick's Fresnel term; what scatters between facets
//! more than once (Kulla and Conty 2017); a Lambert base that gets what the dielectric interface lets through on the way in and on
//! the way out (Kelemen and Szirmay-Kalos 2001).

use super::sampling::cosine_hemisphere;
use crate::compile::features::MIRROR_ROUGHNESS;
use crate::render::albedo::{AlbedoTable, TABLE_WIDTH, albedo_table};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_1_PI, PI};

/// Normal-incidence reflectance of a dielectric of index 1.5.
const DIELECTRIC: DVec3 = DVec3::splat(0.04);

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
    towards: Albedo,
    mean: Albedo,
    /// Probability of sampling the facet lobe.
    facets: f64,
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
struct Albedo {
    single: f64,
    grazing: f64,
}

impl Bsdf {
    /// Seen from `wo`.
    pub fn new(layers: Layers, model: Model, wo: DVec3) -> Self {
        let mirror = layers.roughness < f64::from(MIRROR_ROUGHNESS);
        let alpha = if mirror { 0.0 } else { layers.roughness * layers.roughness };
        let none = Albedo { single: 0.0, grazing: 0.0 };
        let mut bsdf = Self { layers, model, wo, alpha, towards: none, mean: none, facets: 0.0 };
        if model.specular {
            bsdf.towards = Albedo::towards(wo.z, layers.roughness);
            bsdf.mean = Albedo::mean(layers.roughness);
            let facets = luminance(bsdf.towards.with_fresnel(bsdf.f0()));
            let rest = luminance(bsdf.base() * (1.0 - bsdf.interface(bsdf.towards)) + bsdf.lost(bsdf.towards));
            bsdf.facets = if facets + rest > 0.0 { facets / (facets + rest) } else { 0.0 };
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
            let h = (self.wo + wi).normalize();
            let normals = self.distribution(h);
            let fresnel = schlick(self.f0(), self.wo.dot(h));
            // D F G2 / (4 cos cos) times cos; D G1 / (4 cos), the density of reflected visible normals (Heitz 2018, eq. 3, 17).
            value += fresnel * (normals * self.masking_both(wi.z) / (4.0 * self.wo.z));
            pdf += self.facets * normals * self.masking(self.wo.z) / (4.0 * self.wo.z);
        }
        (value, pdf)
    }

    /// Draws a direction; none: absorbed.
    pub fn sample(&self, choice: f64, u: [f64; 2]) -> Option<Scattered> {
        if choice >= self.facets {
            return self.scattered(cosine_hemisphere(u));
        }
        if self.alpha == 0.0 {
            let weight = schlick(self.f0(), self.wo.z) / self.facets;
            let wi = DVec3::new(-self.wo.x, -self.wo.y, self.wo.z);
            return (wi.z > 0.0).then_some(Scattered { wi, weight, pdf: None });
        }
        let h = self.visible_normal(u);
        self.scattered(2.0 * self.wo.dot(h) * h - self.wo)
    }

    /// Part of the light of a uniform surrounding that is reflected, mirrors left out.
    pub fn albedo(&self) -> DVec3 {
        if !self.model.specular {
            return self.base();
        }
        let base = self.base() * (1.0 - self.interface(self.towards));
        if self.alpha == 0.0 { base } else { base + self.towards.with_fresnel(self.f0()) + self.lost(self.towards) }
    }

    fn scattered(&self, wi: DVec3) -> Option<Scattered> {
        let (value, pdf) = self.evaluate(wi);
        (pdf > 0.0).then(|| Scattered { wi, weight: value / pdf, pdf: Some(pdf) })
    }

    /// Reflectance of the Lambert base.
    fn base(&self) -> DVec3 {
        self.layers.color * (1.0 - self.layers.metallic)
    }

    /// Reflectance at normal incidence.
    fn f0(&self) -> DVec3 {
        DIELECTRIC.lerp(self.layers.color, self.layers.metallic)
    }

    /// The base and what facets scatter more than once, without the cosine.
    fn diffuse(&self, wi: DVec3) -> DVec3 {
        if !self.model.specular {
            return self.base() * FRAC_1_PI;
        }
        if !self.model.multiple_scattering {
            let cos_h = self.wo.dot((self.wo + wi).normalize());
            return self.base() * (DVec3::ONE - schlick(DIELECTRIC, cos_h)) * FRAC_1_PI;
        }
        let from = Albedo::towards(wi.z, self.layers.roughness);
        let passes = |albedo| 1.0 - self.interface(albedo);
        let base = self.base() * (passes(self.towards) * passes(from) / passes(self.mean));
        let between = self.lost(self.towards) * (1.0 - from.single) / (1.0 - self.mean.single).max(1e-6);
        (base + between) * FRAC_1_PI
    }

    /// Energy that leaves towards an albedo's direction after scattering between facets more than once.
    fn lost(&self, albedo: Albedo) -> DVec3 {
        if !self.model.multiple_scattering {
            return DVec3::ZERO;
        }
        let dielectric = between_facets(DIELECTRIC, self.mean.single);
        let metal = between_facets(self.layers.color, self.mean.single);
        dielectric.lerp(metal, self.layers.metallic) * (1.0 - albedo.single)
    }

    /// Part of the light that the dielectric interface keeps from the base.
    fn interface(&self, albedo: Albedo) -> f64 {
        let once = albedo.with_fresnel(DIELECTRIC).x;
        if !self.model.multiple_scattering {
            return once;
        }
        once + between_facets(DIELECTRIC, self.mean.single).x * (1.0 - albedo.single)
    }

    /// GGX (Walter et al. 2007, eq. 33).
    fn distribution(&self, h: DVec3) -> f64 {
        let a2 = self.alpha * self.alpha;
        let spread = h.x * h.x + h.y * h.y + a2 * h.z * h.z;
        a2 / (PI * spread * spread)
    }

    /// Smith's Lambda (Heitz 2014, eq. 72).
    fn lambda(&self, cosine: f64) -> f64 {
        let tangent2 = (1.0 - cosine * cosine).max(0.0) / (cosine * cosine);
        0.5 * ((1.0 + self.alpha * self.alpha * tangent2).sqrt() - 1.0)
    }

    fn masking(&self, cosine: f64) -> f64 {
        1.0 / (1.0 + self.lambda(cosine))
    }

    /// Height-correlated masking and shadowing (Heitz 2014, eq. 99).
    fn masking_both(&self, cos_i: f64) -> f64 {
        1.0 / (1.0 + self.lambda(self.wo.z) + self.lambda(cos_i))
    }

    /// Draws from the visible normals (Heitz 2018, "Sampling the GGX Distribution of Visible Normals", listing 1).
    fn visible_normal(&self, u: [f64; 2]) -> DVec3 {
        let stretched = DVec3::new(self.alpha * self.wo.x, self.alpha * self.wo.y, self.wo.z).normalize();
        let flat = stretched.x * stretched.x + stretched.y * stretched.y;
        let across = if flat > 0.0 { DVec3::new(-stretched.y, stretched.x, 0.0) / flat.sqrt() } else { DVec3::X };
        let up = stretched.cross(across);
        let disk = DVec2::from_angle(2.0 * PI * u[1]) * u[0].sqrt();
        let s = 0.5 * (1.0 + stretched.z);
        let y = (1.0 - s) * (1.0 - disk.x * disk.x).max(0.0).sqrt() + s * disk.y;
        let z = (1.0 - disk.x * disk.x - y * y).max(0.0).sqrt();
        let h = disk.x * across + y * up + z * stretched;
        DVec3::new(self.alpha * h.x, self.alpha * h.y, h.z.max(0.0)).normalize()
    }
}

impl Albedo {
    fn towards(cosine: f64, roughness: f64) -> Self {
        let last = f64::from(TABLE_WIDTH - 1);
        Self::interpolated(cosine.clamp(0.0, 1.0).sqrt() * last, |table, column| {
            let row = roughness * last;
            let above = row.floor().min(last - 1.0);
            let at = |row: f64| table.texels[row as usize * TABLE_WIDTH as usize + column].map(f64::from);
            let (low, high, weight) = (at(above), at(above + 1.0), row - above);
            std::array::from_fn(|i| low[i] + (high[i] - low[i]) * weight)
        })
    }

    /// Cosine-weighted mean over all directions.
    fn mean(roughness: f64) -> Self {
        let means = (TABLE_WIDTH * TABLE_WIDTH) as usize;
        Self::interpolated(roughness * f64::from(TABLE_WIDTH - 1), |table, column| {
            table.texels[means + column].map(f64::from)
        })
    }

    fn interpolated(place: f64, entry: impl Fn(&AlbedoTable, usize) -> [f64; 2]) -> Self {
        let table = albedo_table();
        let column = place.floor().clamp(0.0, f64::from(TABLE_WIDTH - 2));
        let (low, high) = (entry(table, column as usize), entry(table, column as usize + 1));
        let [single, grazing] = std::array::from_fn(|i| low[i] + (high[i] - low[i]) * (place - column));
        Self { single, grazing }
    }

    /// With Schlick's Fresnel term, which is linear in `f0`.
    fn with_fresnel(self, f0: DVec3) -> DVec3 {
        f0 * (self.single - self.grazing) + self.grazing
    }
}

/// Reflectance of what leaves the facets after two or more bounces, relative to a white metal's; `mean`: albedo of one bounce
/// over the hemisphere (Kulla and Conty 2017, with Schlick's term averaged over the cosine).
fn between_facets(f0: DVec3, mean: f64) -> DVec3 {
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
