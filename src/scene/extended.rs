//! What the material extensions of Khronos add to a material of core glTF. Every field's default is the extension's, and
//! leaves the core material as it is.

use super::TextureRef;
use glam::Vec3;

/// Values of `KHR_materials_*` extensions. Textures multiply the factor before them, in the channel that is named.
#[derive(Debug, Clone)]
pub struct Extended {
    /// KHR_materials_ior; 0 stands for an infinite index, which reflects everything.
    pub ior: f32,
    /// KHR_materials_specular: strength, 0 to 1.
    pub specular: f32,
    /// A; linear.
    pub specular_texture: Option<TextureRef>,
    /// Colour of the reflection at normal incidence; may exceed 1. With `specular_glossiness`: the reflectance itself.
    pub specular_color: Vec3,
    /// sRGB. With `specular_glossiness` A is the glossiness.
    pub specular_color_texture: Option<TextureRef>,
    /// KHR_materials_pbrSpecularGlossiness: `specular_color` is the reflectance at normal incidence; the material's roughness is
    /// one minus the glossiness factor.
    pub specular_glossiness: bool,
    /// KHR_materials_transmission: part of the light below the interface that passes, 0 to 1.
    pub transmission: f32,
    /// R; linear.
    pub transmission_texture: Option<TextureRef>,
    /// KHR_materials_volume: what fills the mesh; none: its walls are thin.
    pub volume: Option<Volume>,
    /// KHR_materials_volume_scatter: what scatters in the volume; none: nothing.
    pub scatter: Option<Scatter>,
    /// KHR_materials_dispersion: 20 over the Abbe number.
    pub dispersion: f32,
    /// KHR_materials_clearcoat: coverage, 0 to 1.
    pub clearcoat: f32,
    /// R; linear.
    pub clearcoat_texture: Option<TextureRef>,
    /// Perceptual roughness of the coat.
    pub clearcoat_roughness: f32,
    /// G; linear.
    pub clearcoat_roughness_texture: Option<TextureRef>,
    /// Normal map of the coat.
    pub clearcoat_normal_texture: Option<TextureRef>,
    /// Its `scale`.
    pub clearcoat_normal_scale: f32,
    /// KHR_materials_sheen; black: none.
    pub sheen_color: Vec3,
    /// sRGB.
    pub sheen_color_texture: Option<TextureRef>,
    /// Perceptual roughness of the sheen.
    pub sheen_roughness: f32,
    /// A; linear.
    pub sheen_roughness_texture: Option<TextureRef>,
    /// KHR_materials_anisotropy: strength, 0 to 1.
    pub anisotropy: f32,
    /// Angle from the tangent, counter-clockwise, in radians.
    pub anisotropy_rotation: f32,
    /// RG direction, B strength; linear.
    pub anisotropy_texture: Option<TextureRef>,
    /// KHR_materials_iridescence: strength, 0 to 1.
    pub iridescence: f32,
    /// R; linear.
    pub iridescence_texture: Option<TextureRef>,
    /// Index of refraction of the film.
    pub iridescence_ior: f32,
    /// Thickness of the film in nanometres where the texture is 0 and where it is 1; the second alone without a texture.
    pub iridescence_thickness: [f32; 2],
    /// G; linear.
    pub iridescence_thickness_texture: Option<TextureRef>,
    /// KHR_materials_diffuse_transmission: part of the diffuse light that passes, 0 to 1.
    pub diffuse_transmission: f32,
    /// A; linear.
    pub diffuse_transmission_texture: Option<TextureRef>,
    /// Colour of what passes.
    pub diffuse_transmission_color: Vec3,
    /// sRGB.
    pub diffuse_transmission_color_texture: Option<TextureRef>,
}

/// What fills a closed mesh (KHR_materials_volume).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Volume {
    /// What is left of white light after `attenuation_distance`.
    pub attenuation_color: Vec3,
    /// In the world's unit; infinite: nothing is absorbed.
    pub attenuation_distance: f32,
}

/// What the particles in a volume do (KHR_materials_volume_scatter).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    /// Part of the light that a collision does not absorb, but scatters (single scattering albedo), 0 to 1.
    pub albedo: Vec3,
    /// Henyey and Greenstein's g: mean cosine of the angle of scattering, above -1 and below 1.
    pub anisotropy: f32,
}

impl Scatter {
    /// Anisotropies beyond this, either way, are taken as this: single precision holds no narrower peak.
    pub const MOST: f64 = 0.99;

    /// By the colour that a thick body of it has (KHR_materials_volume_scatter, after Kulla and Conty 2017).
    pub fn new(color: Vec3, anisotropy: f32) -> Self {
        let single = |multiple: f32| {
            let m = f64::from(multiple);
            let root = (9.59217 + 41.6808 * m + 17.7126 * m * m).sqrt();
            let rest = 4.09712 + 4.20863 * m - root;
            (1.0 - rest * rest).clamp(0.0, 1.0) as f32
        };
        let albedo = color.to_array().map(|multiple| if multiple > 0.0 { single(multiple) } else { 0.0 });
        Self { albedo: albedo.into(), anisotropy }
    }
}

impl Default for Extended {
    fn default() -> Self {
        Self {
            ior: 1.5,
            specular: 1.0,
            specular_texture: None,
            specular_color: Vec3::ONE,
            specular_color_texture: None,
            specular_glossiness: false,
            transmission: 0.0,
            transmission_texture: None,
            volume: None,
            scatter: None,
            dispersion: 0.0,
            clearcoat: 0.0,
            clearcoat_texture: None,
            clearcoat_roughness: 0.0,
            clearcoat_roughness_texture: None,
            clearcoat_normal_texture: None,
            clearcoat_normal_scale: 1.0,
            sheen_color: Vec3::ZERO,
            sheen_color_texture: None,
            sheen_roughness: 0.0,
            sheen_roughness_texture: None,
            anisotropy: 0.0,
            anisotropy_rotation: 0.0,
            anisotropy_texture: None,
            iridescence: 0.0,
            iridescence_texture: None,
            iridescence_ior: 1.3,
            iridescence_thickness: [100.0, 400.0],
            iridescence_thickness_texture: None,
            diffuse_transmission: 0.0,
            diffuse_transmission_texture: None,
            diffuse_transmission_color: Vec3::ONE,
            diffuse_transmission_color_texture: None,
        }
    }
}

impl Extended {
    /// The textures that it reads: those whose factor is not zero.
    pub fn textures(&self) -> impl Iterator<Item = &TextureRef> {
        [
            &self.specular_texture,
            &self.specular_color_texture,
            &self.transmission_texture,
            &self.clearcoat_texture,
            &self.clearcoat_roughness_texture,
            &self.clearcoat_normal_texture,
            &self.sheen_color_texture,
            &self.sheen_roughness_texture,
            &self.anisotropy_texture,
            &self.iridescence_texture,
            &self.iridescence_thickness_texture,
            &self.diffuse_transmission_texture,
            &self.diffuse_transmission_color_texture,
        ]
        .into_iter()
        .flatten()
    }

    /// Whether light gets to the other side.
    pub fn transmits(&self) -> bool {
        self.transmission > 0.0 || self.diffuse_transmission > 0.0
    }
}
