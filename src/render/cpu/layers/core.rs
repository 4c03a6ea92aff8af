//! The lobes of the core material (`cpu::material` has the formulas) with the reflectances that extensions ask for: those of a
//! dielectric of any index, strength and colour, of a thin film, and of facets with a grain.

use super::Facets;
use crate::render::cpu::material::{Albedo, Layers, Scattered, luminance};
use crate::render::cpu::sampling::cosine_hemisphere;
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;

/// The dielectric part of a material, and its metal's reflectance, where extensions say other than the core.
#[derive(Debug, Clone, Copy)]
pub struct Dielectric {
    /// Reflectance at normal incidence.
    pub f0: DVec3,
    /// At the horizon.
    pub f90: f64,
    /// Of the metal, at normal incidence.
    pub metal: DVec3,
    /// Part of the light below the interface that is reflected diffusely.
    pub base: f64,
    /// Facets; none: a mirror.
    pub facets: Option<Facets>,
    /// Roughness of facets as wide in all directions that lose as much between them.
    pub roughness: f64,
}

/// The reflection of a point towards one viewer.
#[derive(Debug)]
pub struct Core {
    metallic: f64,
    dielectric: Dielectric,
    multiple_scattering: bool,
    wo: DVec3,
    /// Reflectance of the Lambert base.
    base: DVec3,
    /// Reflectance of the facets at normal incidence, and at the horizon.
    f0: DVec3,
    f90: f64,
    towards: Albedo,
    below: Below,
    /// Probability of sampling the facet lobe.
    facets: f64,
    /// Luminance of what is reflected of a uniform surrounding, mirrors included.
    reflectance: f64,
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
    /// What the interface lets out towards the viewer, over what it lets through in the mean.
    leaves: f64,
}

impl Core {
    /// Seen from `wo`; the roughness is the dielectric's.
    pub fn new(layers: Layers, dielectric: Dielectric, multiple_scattering: bool, wo: DVec3) -> Self {
        let metallic = layers.metallic;
        let f90 = dielectric.f90 + (1.0 - dielectric.f90) * metallic;
        let base = layers.color * ((1.0 - metallic) * dielectric.base);
        let mut core = Self {
            metallic,
            dielectric,
            multiple_scattering,
            wo,
            base,
            f0: dielectric.f0.lerp(dielectric.metal, metallic),
            f90,
            towards: Albedo::towards(wo.z, dielectric.roughness),
            below: Below { base, between: DVec3::ZERO, kept: 0.0, leaves: 1.0 },
            facets: 0.0,
            reflectance: 0.0,
        };
        let rest;
        (core.below, rest) = core.below_facets();
        let (facets, rest) = (luminance(core.reflected()), luminance(rest));
        core.facets = if facets + rest > 0.0 { facets / (facets + rest) } else { 0.0 };
        core.reflectance = facets + rest;
        core
    }

    /// Reflected part of the radiance from `wi`, cosine included, and the density of sampling `wi`. A mirror's only
    /// direction is left out.
    pub fn evaluate(&self, wi: DVec3) -> (DVec3, f64) {
        if wi.z <= 0.0 || self.wo.z <= 0.0 {
            return (DVec3::ZERO, 0.0);
        }
        let mut value = self.diffuse(wi) * wi.z;
        let mut pdf = (1.0 - self.facets) * wi.z * FRAC_1_PI;
        if let Some(facets) = self.dielectric.facets {
            let h = (self.wo + wi).normalize();
            let cosine = self.wo.dot(h);
            // The density of reflected visible normals (Heitz 2018, eq. 17), and the lobe over it, Fresnel's term apart: G2 / G1.
            let density = facets.visible(self.wo, h) / (4.0 * cosine);
            let masking = facets.masking_both(self.wo, wi) / facets.masking(self.wo);
            value += schlick(self.f0, self.f90, cosine) * (density * masking);
            pdf += self.facets * density;
        }
        (value, pdf)
    }

    /// Draws a direction; none: absorbed.
    pub fn sample(&self, choice: f64, u: [f64; 2]) -> Option<Scattered> {
        if choice >= self.facets {
            return self.scattered(cosine_hemisphere(u));
        }
        let Some(facets) = self.dielectric.facets else {
            let weight = schlick(self.f0, self.f90, self.wo.z) / self.facets;
            let wi = DVec3::new(-self.wo.x, -self.wo.y, self.wo.z);
            return (wi.z > 0.0).then_some(Scattered { wi, weight, pdf: None });
        };
        let h = facets.sample(self.wo, u);
        self.scattered(2.0 * self.wo.dot(h) * h - self.wo)
    }

    /// Part of the light of a uniform surrounding that is reflected, mirrors left out.
    pub fn albedo(&self) -> DVec3 {
        let (_, rest) = self.below_facets();
        if self.dielectric.facets.is_some() { rest + self.reflected() } else { rest }
    }

    /// By one facet.
    fn reflected(&self) -> DVec3 {
        self.f0 * (self.towards.single - self.towards.grazing) + self.f90 * self.towards.grazing
    }

    /// Luminance of the same, mirrors included.
    pub fn reflectance(&self) -> f64 {
        self.reflectance
    }

    /// Part of the light from the viewer's side that passes the dielectric interface.
    pub fn below(&self) -> f64 {
        self.passes_interface(self.towards, self.below.kept)
    }

    /// Part of the light that passes the interface at a cosine and again towards the viewer, relative to its mean.
    pub fn base_passes(&self, cosine: f64) -> f64 {
        self.below.leaves * self.passes_interface(Albedo::towards(cosine, self.dielectric.roughness), self.below.kept)
    }

    /// Directional albedo of the facets towards the viewer if they reflected all.
    pub fn wall_albedo(&self) -> f64 {
        self.towards.single
    }

    /// Part of the light that the dielectric interface lets through to the base, or out; `kept`: of what is lost to other
    /// facets, the part that stays out. Of a coloured interface, by its strongest colour (KHR_materials_specular).
    fn passes_interface(&self, albedo: Albedo, kept: f64) -> f64 {
        let Dielectric { f0, f90, .. } = self.dielectric;
        let once = f0.max_element() * (albedo.single - albedo.grazing) + f90 * albedo.grazing;
        1.0 - once - kept * (1.0 - albedo.single)
    }

    fn scattered(&self, wi: DVec3) -> Option<Scattered> {
        let (value, pdf) = self.evaluate(wi);
        (pdf > 0.0).then(|| Scattered { wi, weight: value / pdf, pdf: Some(pdf) })
    }

    /// What is below single facets, and its part of the light of a uniform surrounding.
    fn below_facets(&self) -> (Below, DVec3) {
        let (base, towards) = (self.base, self.towards);
        let Dielectric { f0, f90, metal, .. } = self.dielectric;
        if !self.multiple_scattering {
            let passes = self.passes_interface(towards, 0.0);
            return (Below { base, between: DVec3::ZERO, kept: 0.0, leaves: passes }, base * passes);
        }
        let mean = Albedo::mean(self.dielectric.roughness);
        let dielectric = between_facets(f0, f90, mean.single);
        let metal = between_facets(metal, 1.0, mean.single);
        let kept = dielectric.max_element();
        let passes = self.passes_interface(towards, kept);
        let leaves = passes / self.passes_interface(mean, kept).max(1e-6);
        let between = dielectric.lerp(metal, self.metallic) * (1.0 - towards.single);
        let below = Below { base: base * leaves, between: between / (1.0 - mean.single).max(1e-6), kept, leaves };
        (below, base * passes + between)
    }

    /// The base and what facets scatter more than once, without the cosine.
    fn diffuse(&self, wi: DVec3) -> DVec3 {
        let Below { base, between, kept, .. } = self.below;
        if !self.multiple_scattering {
            let cos_h = self.wo.dot((self.wo + wi).normalize());
            let reflected = schlick(self.dielectric.f0, self.dielectric.f90, cos_h);
            return base * ((1.0 - reflected.max_element()) * FRAC_1_PI);
        }
        let from = Albedo::towards(wi.z, self.dielectric.roughness);
        (base * self.passes_interface(from, kept) + between * (1.0 - from.single)) * FRAC_1_PI
    }
}

/// Reflectance of what leaves the facets after two or more bounces, relative to a white metal's; `mean`: albedo of one bounce
/// over the hemisphere (Kulla and Conty 2017, with Schlick's term averaged over the cosine).
fn between_facets(f0: DVec3, f90: f64, mean: f64) -> DVec3 {
    let average = f0 + (f90 - f0) / 21.0;
    average * average * mean / (1.0 - average * (1.0 - mean))
}

/// Fresnel reflectance (Schlick 1994).
fn schlick(f0: DVec3, f90: f64, cosine: f64) -> DVec3 {
    f0 + (f90 - f0) * (1.0 - cosine).powi(5)
}
