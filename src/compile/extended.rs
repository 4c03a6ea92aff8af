//! What extensions add to a material, as kernels read it.

use super::TextureSlot;
use super::look::Look;
use super::textures::{Space, Textures};
use crate::scene::{self, TextureRef, Volume};
use bytemuck::{Pod, Zeroable};

/// Colours darker than this count as this: what is wholly absorbed has no coefficient.
const BLACKEST: f32 = 1e-9;

/// Beside a [`super::Material`], for those alone that have extensions.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Extended {
    /// [`Extended::SPECULAR_GLOSSINESS`] and so on.
    pub flags: u32,
    /// Index of refraction; 0: infinite.
    pub ior: f32,
    /// Strength of the dielectric's reflection.
    pub specular: f32,
    /// Part of the light below the interface that passes without being scattered.
    pub transmission: f32,
    /// Colour of the dielectric's reflection at normal incidence; the reflectance itself if `SPECULAR_GLOSSINESS`.
    pub specular_color: [f32; 3],
    /// 20 over the Abbe number.
    pub dispersion: f32,
    /// Coefficient of absorption, and of scattering with it, per unit of length.
    pub absorption: [f32; 3],
    /// Coverage of the coat.
    pub clearcoat: f32,
    /// Perceptual.
    pub clearcoat_roughness: f32,
    /// Factor on x and y of the coat's normal map.
    pub clearcoat_normal_scale: f32,
    /// Perceptual.
    pub sheen_roughness: f32,
    /// Strength.
    pub anisotropy: f32,
    /// Linear.
    pub sheen_color: [f32; 3],
    /// Radians from the tangent.
    pub anisotropy_rotation: f32,
    /// Strength.
    pub iridescence: f32,
    /// Of the film.
    pub iridescence_ior: f32,
    /// Nanometres where the texture is 0 and where it is 1.
    pub iridescence_thickness: [f32; 2],
    /// Linear.
    pub diffuse_transmission_color: [f32; 3],
    /// Part of the diffuse light that passes.
    pub diffuse_transmission: f32,
    /// Part of what a collision in the medium does not absorb, but scatters; zero: nothing is scattered.
    pub scatter: [f32; 3],
    /// Mean cosine of the angle of scattering.
    pub scatter_anisotropy: f32,
    /// By [`Slot`].
    pub textures: [TextureSlot; SLOTS],
}

/// Number of [`Slot`]s.
pub const SLOTS: usize = 13;

/// Textures of [`Extended`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "named as in the extensions")]
#[repr(usize)]
pub enum Slot {
    Specular,
    SpecularColor,
    Transmission,
    Clearcoat,
    ClearcoatRoughness,
    ClearcoatNormal,
    SheenColor,
    SheenRoughness,
    Anisotropy,
    Iridescence,
    IridescenceThickness,
    DiffuseTransmission,
    DiffuseTransmissionColor,
}

impl Extended {
    /// KHR_materials_pbrSpecularGlossiness.
    pub const SPECULAR_GLOSSINESS: u32 = 1;
    /// The mesh is filled (KHR_materials_volume).
    pub const THICK: u32 = 2;

    /// The record's texture.
    pub fn texture(&self, slot: Slot) -> &TextureSlot {
        &self.textures[slot as usize]
    }

    /// Whether light is scattered inside.
    pub fn scatters(&self) -> bool {
        self.scatter.iter().any(|albedo| *albedo > 0.0)
    }

    /// Whether a ray that goes straight on can carry light through: walls that are thin and smooth.
    pub fn passes_straight(&self) -> bool {
        self.transmission > 0.0 && self.flags & Self::THICK == 0
    }

    /// Whether a dielectric base reflects diffusely and does nothing else: without the reflection of its surface there is no
    /// interface, and Lambert's lobe is all of it.
    pub fn is_matte(&self) -> bool {
        let lobes = [self.specular, self.transmission, self.clearcoat, self.diffuse_transmission];
        let sheen = self.sheen_color.iter().any(|channel| *channel > 0.0);
        let whole = self.flags & Self::SPECULAR_GLOSSINESS == 0;
        whole && !sheen && lobes.iter().all(|strength| *strength == 0.0)
    }

    pub(super) fn new(look: &Look, source: &scene::Extended, textures: &Textures) -> Self {
        let flag = |set: bool, bit: u32| if set { bit } else { 0 };
        let without_texture = source.iridescence_thickness_texture.is_none();
        let scatter = source.scatter.filter(|_| source.volume.is_some());
        let thickest = source.iridescence_thickness[1];
        Self {
            flags: flag(source.specular_glossiness, Self::SPECULAR_GLOSSINESS)
                | flag(source.volume.is_some(), Self::THICK),
            ior: source.ior,
            specular: source.specular,
            transmission: source.transmission,
            specular_color: source.specular_color.to_array(),
            dispersion: if source.volume.is_some() { source.dispersion } else { 0.0 },
            absorption: source.volume.map_or([0.0; 3], absorption),
            clearcoat: source.clearcoat,
            clearcoat_roughness: source.clearcoat_roughness,
            clearcoat_normal_scale: source.clearcoat_normal_scale,
            sheen_roughness: source.sheen_roughness,
            anisotropy: source.anisotropy,
            sheen_color: source.sheen_color.to_array(),
            anisotropy_rotation: source.anisotropy_rotation,
            iridescence: source.iridescence,
            iridescence_ior: source.iridescence_ior,
            iridescence_thickness: if without_texture { [thickest; 2] } else { source.iridescence_thickness },
            diffuse_transmission_color: source.diffuse_transmission_color.to_array(),
            diffuse_transmission: source.diffuse_transmission,
            scatter: scatter.map_or([0.0; 3], |scatter| scatter.albedo.to_array()),
            scatter_anisotropy: scatter.map_or(0.0, |scatter| scatter.anisotropy),
            textures: uses(source).map(|(space, use_)| textures.slot(look, space, use_)),
        }
    }
}

/// The textures that a material reads, by [`Slot`].
pub fn uses(source: &scene::Extended) -> [(Space, Option<TextureRef>); SLOTS] {
    [
        (Space::Data, source.specular_texture),
        (Space::Color, source.specular_color_texture),
        (Space::Data, source.transmission_texture),
        (Space::Data, source.clearcoat_texture),
        (Space::Data, source.clearcoat_roughness_texture),
        (Space::Data, source.clearcoat_normal_texture),
        (Space::Color, source.sheen_color_texture),
        (Space::Data, source.sheen_roughness_texture),
        (Space::Data, source.anisotropy_texture),
        (Space::Data, source.iridescence_texture),
        (Space::Data, source.iridescence_thickness_texture),
        (Space::Data, source.diffuse_transmission_texture),
        (Space::Color, source.diffuse_transmission_color_texture),
    ]
}

/// KHR_materials_volume: `exp(-absorption * distance)` is the colour at its distance.
fn absorption(volume: Volume) -> [f32; 3] {
    let of = |color: f32| -color.max(BLACKEST).ln() / volume.attenuation_distance;
    // A tiny distance must not become an infinite coefficient: 0 * infinity is no number.
    volume.attenuation_color.to_array().map(|color| of(color).clamp(0.0, f32::MAX / 4.0))
}
