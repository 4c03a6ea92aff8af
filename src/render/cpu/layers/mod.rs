//! Materials with extensions: layers over, and ways through, the core material.
//!
//! From the outside in: a coat, then sheen, then the core material, of whose dielectric part a share is glass and a share of the
//! base passes light diffusely. Each layer leaves to those below it what it does not reflect towards the viewer
//! (docs/gltf.md); within a filled mesh there are no coat and no sheen.

mod core;
mod film;
mod ggx;
mod glass;
pub mod media;
pub mod scatter;
mod sheen;
mod values;

use super::material::{Bsdf, Layers, Model, Scattered, luminance};
use super::phong::Phong;
use super::sampling::cosine_hemisphere;
use super::surface::Surface;
use crate::compile::Extended;
use crate::compile::features::MIRROR_ROUGHNESS;
use core::{Core, Dielectric};
pub use ggx::Facets;
use glam::{DMat3, DVec2, DVec3};
pub use glass::{Glass, Interface, dielectric};
pub use media::{Crossing, Media};
use sheen::Sheen;
use std::f64::consts::FRAC_1_PI;
use values::{Values, reflectance};

/// Reflectance of a coat at normal incidence: an index of 1.5.
const COAT: f64 = 0.04;

/// Least GGX width across a grain.
const LEAST_WIDTH: f64 = 1e-4;

/// Stands for an infinite index of refraction.
const INFINITE: f64 = 1e6;

/// The scattering of a point towards one viewer.
#[derive(Debug)]
pub enum Reflection {
    /// Of a core material.
    Core(Bsdf),
    /// Of one with extensions.
    Layered(Box<Layered>),
    /// Phong's.
    Phong(Phong),
}

impl Reflection {
    /// See [`Bsdf::evaluate`].
    pub fn evaluate(&self, wi: DVec3) -> (DVec3, f64) {
        match self {
            Self::Core(bsdf) => bsdf.evaluate(wi),
            Self::Layered(layered) => layered.evaluate(wi),
            Self::Phong(phong) => (phong.evaluate(wi), 0.0),
        }
    }

    /// See [`Bsdf::sample`].
    pub fn sample(&self, choice: f64, u: [f64; 2]) -> Option<Scattered> {
        match self {
            Self::Core(bsdf) => bsdf.sample(choice, u),
            Self::Layered(layered) => layered.sample(choice, u),
            Self::Phong(phong) => phong.sample(),
        }
    }

    /// See [`Bsdf::albedo`].
    pub fn albedo(&self) -> DVec3 {
        match self {
            Self::Core(bsdf) => bsdf.albedo(),
            Self::Layered(layered) => layered.albedo(),
            Self::Phong(phong) => phong.albedo(),
        }
    }

    /// Whether it is certain that no light gets to the other side.
    pub fn is_opaque(&self) -> bool {
        matches!(self, Self::Core(_) | Self::Phong(_))
    }
}

/// Lobes of a material with extensions.
#[derive(Debug)]
pub struct Layered {
    wo: DVec3,
    coat: Option<Coat>,
    sheen: Option<Sheen>,
    /// Of the sheen, and of all below it.
    sheen_share: f64,
    base_share: f64,
    core: Core,
    core_share: f64,
    glass: Option<(Glass, f64)>,
    /// Lambert lobe of the other side.
    behind: DVec3,
    /// Of sampling coat, sheen, glass, the other side and the core.
    probabilities: [f64; 5],
}

#[derive(Debug)]
struct Coat {
    /// From the shading frame to the coat's.
    frame: DMat3,
    coverage: f64,
    bsdf: Core,
}

impl Layered {
    /// Of a point seen from `wo`, in the frame of [`frame`]; `crossing`: of a filled mesh; `inside`: from within it.
    pub fn new(
        surface: &Surface,
        extended: &Extended,
        model: Model,
        frame: &DMat3,
        wo: DVec3,
        crossing: Option<&Crossing>,
        wavelength: Option<f64>,
    ) -> Self {
        let values = Values::new(surface, extended, wavelength);
        let inside = crossing.is_some() && surface.back;
        let coat = (values.coat[0] > 0.0 && !inside).then(|| {
            let normal = surface.coat_normal(extended, -(*frame * wo));
            Coat::new(frame.transpose() * normal, values.coat, model, wo)
        });
        let sheen =
            (values.sheen.0 != DVec3::ZERO && !inside).then(|| Sheen::new(values.sheen.0, values.sheen.1, wo.z));
        let sheen_share = coat.as_ref().map_or(1.0, Coat::rest);
        let base_share = sheen_share * sheen.map_or(1.0, |sheen| sheen.rest());
        let alpha = widths(values.core.roughness, values.grain);
        let glass_share = (1.0 - values.core.metallic) * values.transmission;
        let core_share = 1.0 - glass_share;
        let core = core_lobes(&values, core_share, alpha, model, wo);
        let glass = (glass_share > 0.0).then(|| {
            let interface = interface(&values, extended, crossing, alpha, model, wavelength, wo);
            (Glass::new(interface, wo, core.wall_albedo()), glass_share)
        });
        let (through, color) = values.diffuse_transmission;
        let behind = color * (through * (1.0 - values.core.metallic) * (1.0 - values.transmission));
        let mut layered =
            Self { wo, coat, sheen, sheen_share, base_share, core, core_share, glass, behind, probabilities: [0.0; 5] };
        layered.probabilities = layered.probabilities();
        layered
    }

    /// Whether a ray that goes on in this direction is one that shadow rays follow too.
    pub fn is_straight(&self, wi: DVec3) -> bool {
        wi == -self.wo && self.straight() != DVec3::ZERO
    }

    /// Part of the radiance from straight ahead that passes thin, smooth walls.
    pub fn straight(&self) -> DVec3 {
        self.glass.as_ref().map_or(DVec3::ZERO, |(glass, share)| glass.straight() * (share * self.base_share))
    }

    fn probabilities(&self) -> [f64; 5] {
        let coat = self.coat.as_ref().map_or(0.0, |coat| 1.0 - coat.rest());
        let sheen = self.sheen.map_or(0.0, |sheen| luminance(sheen.color) * sheen.albedo * self.sheen_share);
        let glass = self.glass.as_ref().map_or(0.0, |(_, share)| share * self.base_share);
        let behind = luminance(self.behind) * self.core.below() * self.base_share;
        let core = self.core.reflectance() * self.core_share * self.base_share;
        let all = [coat, sheen, glass, behind, core];
        let sum: f64 = all.iter().sum();
        if sum > 0.0 { all.map(|weight| weight / sum) } else { [0.0, 0.0, 0.0, 0.0, 1.0] }
    }

    #[inline(never)]
    fn evaluate(&self, wi: DVec3) -> (DVec3, f64) {
        if self.wo.z <= 0.0 || wi.z == 0.0 {
            return (DVec3::ZERO, 0.0);
        }
        let [coat_p, sheen_p, glass_p, behind_p, core_p] = self.probabilities;
        let (mut value, mut pdf) = (DVec3::ZERO, 0.0);
        let mut add = |share: f64, probability: f64, (lobe, density): (DVec3, f64)| {
            value += lobe * share;
            pdf += density * probability;
        };
        if let Some((glass, share)) = &self.glass {
            add(share * self.base_share, glass_p, glass.evaluate(wi));
        }
        if wi.z < 0.0 {
            if self.behind != DVec3::ZERO {
                let lambert = self.behind * (self.core.base_passes(-wi.z) * -wi.z * FRAC_1_PI);
                add(self.base_share, behind_p, (lambert, -wi.z * FRAC_1_PI));
            }
            return (value, pdf);
        }
        if let Some(coat) = &self.coat {
            add(coat.coverage, coat_p, coat.bsdf.evaluate(coat.frame * wi));
        }
        if let Some(sheen) = &self.sheen {
            add(self.sheen_share, sheen_p, (sheen.value(self.wo, wi), sheen.pdf()));
        }
        add(self.core_share * self.base_share, core_p, self.core.evaluate(wi));
        (value, pdf)
    }

    #[inline(never)]
    fn sample(&self, choice: f64, u: [f64; 2]) -> Option<Scattered> {
        if self.wo.z <= 0.0 {
            return None;
        }
        let (mut lobe, mut below) = (0, 0.0);
        while lobe < 4 && choice >= below + self.probabilities[lobe] {
            below += self.probabilities[lobe];
            lobe += 1;
        }
        let probability = self.probabilities[lobe];
        let choice = ((choice - below) / probability).clamp(0.0, 1.0 - f64::EPSILON);
        let (share, scattered) = match (lobe, &self.coat, &self.glass) {
            (0, Some(coat), _) => {
                let scattered = coat.bsdf.sample(choice, u)?;
                (coat.coverage, Scattered { wi: coat.frame.transpose() * scattered.wi, ..scattered })
            }
            (1, ..) => (self.sheen_share, directed(self.sheen.as_ref()?.sample(u))),
            (2, _, Some((glass, share))) => (share * self.base_share, glass.sample(choice, u)?),
            (3, ..) => (self.base_share, directed(-cosine_hemisphere(u))),
            _ => (self.core_share * self.base_share, self.core.sample(choice, u)?),
        };
        // Facets of the coat and the core do not scatter to the other side.
        if scattered.wi.z <= 0.0 && (lobe == 0 || lobe == 4) {
            return None;
        }
        if scattered.pdf.is_none() {
            return Some(Scattered { weight: scattered.weight * (share / probability), ..scattered });
        }
        let (value, pdf) = self.evaluate(scattered.wi);
        (pdf > 0.0).then(|| Scattered { wi: scattered.wi, weight: value / pdf, pdf: Some(pdf) })
    }

    /// What is reflected; what passes is left out.
    #[inline(never)]
    fn albedo(&self) -> DVec3 {
        let coat = self.coat.as_ref().map_or(DVec3::ZERO, |coat| coat.bsdf.albedo() * coat.coverage);
        let sheen = self.sheen.map_or(DVec3::ZERO, |sheen| sheen.color * (sheen.albedo * self.sheen_share));
        coat + sheen + self.core.albedo() * (self.core_share * self.base_share)
    }
}

impl Coat {
    /// Facets of a clear dielectric of index 1.5 (KHR_materials_clearcoat) around a normal of their own.
    fn new(normal: DVec3, [coverage, roughness]: [f64; 2], model: Model, wo: DVec3) -> Self {
        let (x, y) = normal.any_orthonormal_pair();
        let frame = DMat3::from_cols(x, y, normal).transpose();
        let layers = Layers { color: DVec3::ZERO, metallic: 0.0, roughness };
        let alpha = DVec2::splat(roughness * roughness);
        let facets = (roughness >= f64::from(MIRROR_ROUGHNESS)).then_some(Facets(alpha));
        let f0 = DVec3::splat(COAT);
        let dielectric = Dielectric { f0, f90: 1.0, metal: f0, base: 0.0, facets, roughness };
        Self { frame, coverage, bsdf: Core::new(layers, dielectric, model.multiple_scattering, frame * wo) }
    }

    /// What is left for the layers below.
    fn rest(&self) -> f64 {
        1.0 - self.coverage * (1.0 - self.bsdf.below())
    }
}

/// A direction whose weight is found by evaluating all lobes.
fn directed(wi: DVec3) -> Scattered {
    Scattered { wi, weight: DVec3::ZERO, pdf: Some(0.0) }
}

/// The frame of a point's lobes: +z is the shading normal, +x the grain's direction if the material has a grain.
pub fn frame(surface: &Surface, extended: Option<&Extended>) -> DMat3 {
    let z = surface.shading_normal;
    let grain = extended.filter(|extended| extended.anisotropy > 0.0);
    let along = grain.and_then(|extended| {
        let [tangent, bitangent] = surface.tangents()?;
        let direction = values::grain(surface, extended).1;
        // Seen from behind, the normal is turned and the bitangent with it; the grain's line stays.
        (tangent * direction.x + bitangent * direction.y).reject_from_normalized(z).try_normalize()
    });
    let Some(x) = along else {
        let (x, y) = z.any_orthonormal_pair();
        return DMat3::from_cols(x, y, z);
    };
    DMat3::from_cols(x, z.cross(x), z)
}

/// GGX widths along and across the grain (KHR_materials_anisotropy).
fn widths(roughness: f64, strength: f64) -> DVec2 {
    let alpha = roughness * roughness;
    let across = if strength > 0.0 { alpha.max(LEAST_WIDTH) } else { alpha };
    DVec2::new(alpha + (1.0 - alpha) * strength * strength, across)
}

/// What is left of the core material beside the glass.
fn core_lobes(values: &Values, share: f64, alpha: DVec2, model: Model, wo: DVec3) -> Core {
    let metallic = if share > 0.0 { (values.core.metallic / share).min(1.0) } else { 0.0 };
    let layers = Layers { metallic, ..values.core };
    let filmed = |f0: DVec3| values.film.map_or(f0, |film| film.over(f0, wo.z.max(0.0)));
    let dielectric = Dielectric {
        f0: filmed(values.f0),
        f90: values.f90,
        metal: filmed(values.core.color),
        base: 1.0 - values.diffuse_transmission.0,
        facets: (!values.is_mirror()).then_some(Facets(alpha)),
        roughness: values.lost_like(alpha),
    };
    Core::new(layers, dielectric, model.multiple_scattering, wo)
}

/// The interface of the share that is glass.
fn interface(
    values: &Values,
    extended: &Extended,
    crossing: Option<&Crossing>,
    alpha: DVec2,
    model: Model,
    wavelength: Option<f64>,
    wo: DVec3,
) -> Interface {
    let ior = media::index_of(extended, wavelength);
    // A wall's other side is air again; an infinite index reflects all.
    let eta = if ior == 0.0 { INFINITE } else { crossing.map_or(ior, |crossing| crossing.eta) };
    let (strength, color) = values.specular;
    let f0 = match extended.flags & Extended::SPECULAR_GLOSSINESS {
        0 => reflectance(eta, strength, color),
        _ => values.f0,
    };
    Interface {
        eta,
        thin: crossing.is_none(),
        f0: values.film.map_or(f0, |film| film.over(f0, wo.z.max(0.0))),
        f90: values.f90,
        tint: values.core.color,
        facets: (!values.is_mirror()).then_some(Facets(alpha)),
        roughness: values.lost_like(alpha),
        compensated: model.multiple_scattering,
    }
}
