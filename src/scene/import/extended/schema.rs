//! `KHR_materials_*` as they are written in JSON.

use crate::scene::import::schema::TextureInfo;
use serde::Deserialize;

#[derive(Deserialize)]
pub struct Ior {
    pub ior: Option<f64>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Specular {
    pub specular_factor: Option<f64>,
    pub specular_texture: Option<TextureInfo>,
    pub specular_color_factor: Option<[f64; 3]>,
    pub specular_color_texture: Option<TextureInfo>,
}

/// KHR_materials_pbrSpecularGlossiness. Diffuse values take the place of the base colour's.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct SpecularGlossiness {
    pub diffuse_factor: Option<[f64; 4]>,
    pub diffuse_texture: Option<TextureInfo>,
    pub specular_factor: Option<[f64; 3]>,
    pub glossiness_factor: Option<f64>,
    pub specular_glossiness_texture: Option<TextureInfo>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Transmission {
    pub transmission_factor: Option<f64>,
    pub transmission_texture: Option<TextureInfo>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct VolumeSource {
    pub thickness_factor: Option<f64>,
    pub thickness_texture: Option<TextureInfo>,
    pub attenuation_color: Option<[f64; 3]>,
    pub attenuation_distance: Option<f64>,
}

/// KHR_materials_volume_scatter, a draft: the colour has had two names.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct VolumeScatter {
    #[serde(alias = "multiscatterColorFactor")]
    pub multiscatter_color: Option<[f64; 3]>,
    pub multiscatter_color_texture: Option<TextureInfo>,
    pub scatter_anisotropy: Option<f64>,
}

#[derive(Deserialize)]
pub struct Dispersion {
    pub dispersion: Option<f64>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Clearcoat {
    pub clearcoat_factor: Option<f64>,
    pub clearcoat_texture: Option<TextureInfo>,
    pub clearcoat_roughness_factor: Option<f64>,
    pub clearcoat_roughness_texture: Option<TextureInfo>,
    pub clearcoat_normal_texture: Option<TextureInfo>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Sheen {
    pub sheen_color_factor: Option<[f64; 3]>,
    pub sheen_color_texture: Option<TextureInfo>,
    pub sheen_roughness_factor: Option<f64>,
    pub sheen_roughness_texture: Option<TextureInfo>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Anisotropy {
    pub anisotropy_strength: Option<f64>,
    pub anisotropy_rotation: Option<f64>,
    pub anisotropy_texture: Option<TextureInfo>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Iridescence {
    pub iridescence_factor: Option<f64>,
    pub iridescence_texture: Option<TextureInfo>,
    pub iridescence_ior: Option<f64>,
    pub iridescence_thickness_minimum: Option<f64>,
    pub iridescence_thickness_maximum: Option<f64>,
    pub iridescence_thickness_texture: Option<TextureInfo>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct DiffuseTransmission {
    pub diffuse_transmission_factor: Option<f64>,
    pub diffuse_transmission_texture: Option<TextureInfo>,
    pub diffuse_transmission_color_factor: Option<[f64; 3]>,
    pub diffuse_transmission_color_texture: Option<TextureInfo>,
}
