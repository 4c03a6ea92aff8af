//! What the extensions of a material say at one point.

use super::film::Film;
use super::ggx::Facets;
use super::media::index_of;
use crate::compile::features::MIRROR_ROUGHNESS;
use crate::compile::{Extended, Slot};
use crate::render::cpu::material::Layers;
use crate::render::cpu::surface::Surface;
use crate::render::cpu::texture::Encoding;
use glam::{DVec2, DVec3};

/// Values of a point, textures included.
#[derive(Debug)]
pub struct Values {
    /// Of the core material.
    pub core: Layers,
    /// Reflectance of the dielectric at normal incidence, and at the horizon.
    pub f0: DVec3,
    /// At the horizon.
    pub f90: f64,
    /// Strength and colour of the dielectric's reflection, as KHR_materials_specular has them.
    pub specular: (f64, DVec3),
    /// Part of the light below the interface that passes.
    pub transmission: f64,
    /// Coverage and perceptual roughness.
    pub coat: [f64; 2],
    /// Colour and perceptual roughness.
    pub sheen: (DVec3, f64),
    /// Strength of the anisotropy.
    pub grain: f64,
    /// If its strength is not zero.
    pub film: Option<Film>,
    /// Part of the diffuse light that passes, and its colour.
    pub diffuse_transmission: (f64, DVec3),
}

impl Values {
    /// Of a material with extensions.
    pub fn new(surface: &Surface, extended: &Extended, wavelength: Option<f64>) -> Self {
        let data = |slot: Slot| surface.texel(Encoding::Linear, extended.texture(slot));
        let color = |slot: Slot| surface.texel(Encoding::Srgb, extended.texture(slot));
        let tinted = |factor: [f32; 3], slot: Slot| DVec3::from(factor.map(f64::from)) * color(slot).truncate();
        let mut core = surface.layers();
        let specular = f64::from(extended.specular) * data(Slot::Specular).w;
        let specular_color = tinted(extended.specular_color, Slot::SpecularColor);
        let ior = index_of(extended, wavelength);
        let mut f0 = reflectance(ior, specular, specular_color);
        let mut f90 = specular;
        if extended.flags & Extended::SPECULAR_GLOSSINESS != 0 {
            (f0, f90) = (specular_color.min(DVec3::ONE), 1.0);
            core.color *= 1.0 - f0.max_element();
            let glossiness = (1.0 - core.roughness) * color(Slot::SpecularColor).w;
            core.roughness = 1.0 - glossiness;
        }
        let strength = f64::from(extended.iridescence) * data(Slot::Iridescence).x;
        let [thinnest, thickest] = extended.iridescence_thickness.map(f64::from);
        let thickness = thinnest + (thickest - thinnest) * data(Slot::IridescenceThickness).y;
        let film = Film { strength, ior: f64::from(extended.iridescence_ior), thickness };
        Self {
            core,
            f0,
            f90,
            specular: (specular, specular_color),
            transmission: f64::from(extended.transmission) * data(Slot::Transmission).x,
            coat: [
                f64::from(extended.clearcoat) * data(Slot::Clearcoat).x,
                f64::from(extended.clearcoat_roughness) * data(Slot::ClearcoatRoughness).y,
            ],
            sheen: (
                tinted(extended.sheen_color, Slot::SheenColor),
                f64::from(extended.sheen_roughness) * data(Slot::SheenRoughness).w,
            ),
            grain: grain(surface, extended).0,
            film: (strength > 0.0).then_some(film),
            diffuse_transmission: (
                f64::from(extended.diffuse_transmission) * data(Slot::DiffuseTransmission).w,
                tinted(extended.diffuse_transmission_color, Slot::DiffuseTransmissionColor),
            ),
        }
    }

    /// Whether the facets are all alike.
    pub fn is_mirror(&self) -> bool {
        self.grain == 0.0 && self.core.roughness < f64::from(MIRROR_ROUGHNESS)
    }

    /// Roughness of facets without a grain that lose as much between them.
    pub fn lost_like(&self, alpha: DVec2) -> f64 {
        if self.grain > 0.0 { Facets(alpha).round_roughness() } else { self.core.roughness }
    }
}

/// KHR_materials_specular: at normal incidence, of a dielectric of an index of refraction; 0 is infinite.
pub fn reflectance(ior: f64, strength: f64, color: DVec3) -> DVec3 {
    let plain = if ior == 0.0 { 1.0 } else { ((ior - 1.0) / (ior + 1.0)).powi(2) };
    (plain * color).min(DVec3::ONE) * strength
}

/// KHR_materials_anisotropy: strength, and direction relative to the tangent: the texture's direction, turned by the rotation.
pub fn grain(surface: &Surface, extended: &Extended) -> (f64, DVec2) {
    let slot = extended.texture(Slot::Anisotropy);
    let turn = DVec2::from_angle(f64::from(extended.anisotropy_rotation));
    let strength = f64::from(extended.anisotropy);
    if slot.info == crate::compile::NONE {
        return (strength, turn);
    }
    let texel = surface.texel(Encoding::Linear, slot);
    let direction = DVec2::new(2.0 * texel.x - 1.0, 2.0 * texel.y - 1.0).try_normalize().unwrap_or(DVec2::X);
    (strength * texel.z, turn.rotate(direction))
}
