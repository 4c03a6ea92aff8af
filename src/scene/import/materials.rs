//! Materials, and which attributes of a primitive they read.

use super::data::missing;
use super::document;
use super::extended::{self, SpecularGlossiness};
use super::number::{factor, finite, non_negative, not_finite};
use super::schema::{self, EmissiveStrength, TextureInfo, TextureTransform};
use crate::scene::error::Warnings;
use crate::scene::{AlphaMode, Material, SceneError, TextureRef};
use glam::{Mat3, Vec2, Vec3, Vec4};
use std::sync::Arc;

/// A material with the sets of texture coordinates that it reads.
pub(super) struct ReadMaterial {
    pub material: Material,
    /// `TEXCOORD_n` by [`TextureRef::uv_set`].
    pub uv_sets: Vec<u32>,
    /// The texture coordinates along whose u its tangents run; none: it needs no tangents.
    pub tangents: Option<TextureRef>,
}

/// Sets that a vertex can carry.
pub(super) const UV_SETS: usize = 2;

/// Reads material `index`. `slots` gives the scene's texture for the file's, or none if it cannot be shown.
pub(super) fn read(
    source: &schema::Material,
    index: usize,
    slots: &[Option<usize>],
    warnings: &mut Warnings,
) -> Result<ReadMaterial, SceneError> {
    let place = format!("/materials/{index}");
    let mut reader = Reader { place, slots, uv_sets: Vec::new(), warnings };
    let mut material = reader.material(source)?;
    let tangents = reader.tangents(&material);
    material.first_uv = reader.uv_sets.iter().position(|set| *set == 0).unwrap_or(reader.uv_sets.len());
    Ok(ReadMaterial { material, uv_sets: reader.uv_sets, tangents })
}

pub(super) struct Reader<'a> {
    pub place: String,
    slots: &'a [Option<usize>],
    uv_sets: Vec<u32>,
    pub warnings: &'a mut Warnings,
}

impl Reader<'_> {
    fn material<'s>(&mut self, source: &'s schema::Material) -> Result<Material, SceneError> {
        let pbr = &source.pbr_metallic_roughness;
        let base = pbr.base_color_factor.unwrap_or([1.0; 4]);
        let base = self.factors(base, "pbrMetallicRoughness/baseColorFactor")?;
        let glossy = extended::specular_glossiness(source, &self.place)?;
        // Specular-glossiness takes the place of the core's textures.
        let core = |texture: &'s Option<TextureInfo>| texture.as_ref().filter(|_| glossy.is_none());
        let unlit = source.extensions.contains_key("KHR_materials_unlit");
        let mut material = Material {
            name: source.name.clone(),
            base_color: Vec4::from(base),
            base_color_texture: self.texture(core(&pbr.base_color_texture), "pbrMetallicRoughness/baseColorTexture")?,
            metallic: self.factors([pbr.metallic_factor.unwrap_or(1.0)], "pbrMetallicRoughness/metallicFactor")?[0],
            roughness: self.factors([pbr.roughness_factor.unwrap_or(1.0)], "pbrMetallicRoughness/roughnessFactor")?[0],
            emissive: self.emissive(source)?,
            normal_scale: self.normal_scale(source)?,
            alpha_mode: self.alpha_mode(source)?,
            double_sided: source.double_sided,
            unlit,
            ..Material::default()
        };
        if let Some(glossy) = &glossy {
            self.glossy(glossy, &mut material)?;
        }
        if unlit {
            // Nothing but the base colour is seen.
            material.emissive = Vec3::ZERO;
            return Ok(material);
        }
        let texture = core(&pbr.metallic_roughness_texture);
        material.metallic_roughness_texture = self.texture(texture, "pbrMetallicRoughness/metallicRoughnessTexture")?;
        if material.normal_scale != 0.0 {
            material.normal_texture = self.texture(source.normal_texture.as_ref(), "normalTexture")?;
        }
        if material.emissive != Vec3::ZERO {
            material.emissive_texture = self.texture(source.emissive_texture.as_ref(), "emissiveTexture")?;
        }
        material.extended = extended::read(self, source)?.map(Arc::new);
        Ok(material)
    }

    /// KHR_materials_pbrSpecularGlossiness in place of metallic-roughness, as far as a core material can hold it.
    fn glossy(&mut self, values: &SpecularGlossiness, material: &mut Material) -> Result<(), SceneError> {
        const PLACE: &str = "extensions/KHR_materials_pbrSpecularGlossiness";
        let place = |name: &str| format!("{PLACE}/{name}");
        let color = self.factors(values.diffuse_factor.unwrap_or([1.0; 4]), &place("diffuseFactor"))?;
        let [glossiness] = self.factors([values.glossiness_factor.unwrap_or(1.0)], &place("glossinessFactor"))?;
        let texture = values.diffuse_texture.as_ref();
        self.check_texture(texture, &place("diffuseTexture"))?;
        material.base_color = Vec4::from(color);
        material.base_color_texture = self.texture(texture, &place("diffuseTexture"))?;
        (material.metallic, material.roughness) = (0.0, 1.0 - glossiness);
        Ok(())
    }

    /// See [`ReadMaterial::tangents`].
    fn tangents(&mut self, material: &Material) -> Option<TextureRef> {
        let extended = material.extended.as_ref();
        let coat = extended.and_then(|extended| extended.clearcoat_normal_texture);
        let grain = extended.and_then(|extended| extended.anisotropy_texture);
        let without_texture = || {
            extended.filter(|extended| extended.anisotropy > 0.0)?;
            let uv_set = self.uv_set(0)?;
            Some(TextureRef { texture: 0, uv_set, transform: Mat3::IDENTITY })
        };
        material.normal_texture.or(coat).or(grain).or_else(without_texture)
    }

    pub(super) fn factors<const N: usize>(&mut self, values: [f64; N], name: &str) -> Result<[f32; N], SceneError> {
        let place = format!("{}/{name}", self.place);
        let mut factors = [0.0; N];
        for (out, value) in factors.iter_mut().zip(values) {
            *out = factor(value, &place, self.warnings)?;
        }
        Ok(factors)
    }

    fn emissive(&mut self, source: &schema::Material) -> Result<Vec3, SceneError> {
        let color = Vec3::from(self.factors(source.emissive_factor, "emissiveFactor")?);
        let Some(content) = source.extensions.get("KHR_materials_emissive_strength") else { return Ok(color) };
        let place = format!("{}/extensions/KHR_materials_emissive_strength", self.place);
        let strength: EmissiveStrength = document::extension(content, &place)?;
        let place = format!("{place}/emissiveStrength");
        let emissive = color * non_negative(strength.emissive_strength.unwrap_or(1.0), &place)?;
        if emissive.is_finite() { Ok(emissive) } else { Err(not_finite(&place, "factor times strength")) }
    }

    fn normal_scale(&self, source: &schema::Material) -> Result<f32, SceneError> {
        let scale = source.normal_texture.as_ref().and_then(|texture| texture.scale).unwrap_or(1.0);
        finite(scale, &format!("{}/normalTexture/scale", self.place))
    }

    fn alpha_mode(&self, source: &schema::Material) -> Result<AlphaMode, SceneError> {
        let cutoff = non_negative(source.alpha_cutoff.unwrap_or(0.5), &format!("{}/alphaCutoff", self.place))?;
        match source.alpha_mode.as_deref() {
            None | Some("OPAQUE") => Ok(AlphaMode::Opaque),
            Some("MASK") => Ok(AlphaMode::Mask { cutoff }),
            Some("BLEND") => Ok(AlphaMode::Blend),
            Some(other) => {
                let detail = format!("`{other}` is not an alpha mode; it is OPAQUE, MASK or BLEND");
                Err(SceneError::invalid("alpha_mode", format!("{}/alphaMode", self.place), detail))
            }
        }
    }

    /// That the file has the texture; those of the core material are checked with all other references.
    pub(super) fn check_texture(&self, info: Option<&TextureInfo>, name: &str) -> Result<(), SceneError> {
        match info {
            Some(info) if info.index >= self.slots.len() => {
                Err(missing(&format!("{}/{name}/index", self.place), "texture", info.index))
            }
            _ => Ok(()),
        }
    }

    pub(super) fn texture(&mut self, info: Option<&TextureInfo>, name: &str) -> Result<Option<TextureRef>, SceneError> {
        let Some(info) = info else { return Ok(None) };
        let place = format!("{}/{name}", self.place);
        let (transform, tex_coord) = uv_transform(info, &place)?;
        let Some(texture) = self.slots.get(info.index).copied().flatten() else { return Ok(None) };
        let Some(uv_set) = self.uv_set(tex_coord) else {
            let detail = format!(
                "the texture is left out: it reads TEXCOORD_{tex_coord}, and {UV_SETS} other sets of texture coordinates are in use already"
            );
            self.warnings.add("uv_sets", place, detail);
            return Ok(None);
        };
        Ok(Some(TextureRef { texture, uv_set, transform }))
    }

    /// The number that `TEXCOORD_{set}` has among those that the material reads; none: they are too many.
    fn uv_set(&mut self, set: u32) -> Option<usize> {
        let known = self.uv_sets.iter().position(|known| *known == set);
        known.or_else(|| {
            let free = self.uv_sets.len() < UV_SETS;
            free.then(|| {
                self.uv_sets.push(set);
                self.uv_sets.len() - 1
            })
        })
    }
}

/// KHR_texture_transform of a use of a texture: matrix (translation * rotation * scale) and set.
fn uv_transform(info: &TextureInfo, place: &str) -> Result<(Mat3, u32), SceneError> {
    let Some(content) = info.extensions.get("KHR_texture_transform") else {
        return Ok((Mat3::IDENTITY, info.tex_coord));
    };
    let place = format!("{place}/extensions/KHR_texture_transform");
    let source: TextureTransform = document::extension(content, &place)?;
    let pair = |value: Option<[f64; 2]>, default: Vec2, name: &str| match value {
        Some([u, v]) => Ok(Vec2::new(finite(u, &format!("{place}/{name}"))?, finite(v, &format!("{place}/{name}"))?)),
        None => Ok::<_, SceneError>(default),
    };
    let offset = pair(source.offset, Vec2::ZERO, "offset")?;
    let scale = pair(source.scale, Vec2::ONE, "scale")?;
    let (sin, cos) = finite(source.rotation.unwrap_or(0.0), &format!("{place}/rotation"))?.sin_cos();
    // The rotation is counter-clockwise as seen in the picture, whose v points down.
    let matrix = Mat3::from_cols(
        Vec3::new(cos * scale.x, -sin * scale.x, 0.0),
        Vec3::new(sin * scale.y, cos * scale.y, 0.0),
        offset.extend(1.0),
    );
    Ok((matrix, source.tex_coord.unwrap_or(info.tex_coord)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::error::Warning;
    use serde_json::{Value, json};

    fn read_json(material: Value) -> Result<(ReadMaterial, Vec<Warning>), SceneError> {
        let source: schema::Material = serde_json::from_value(material).unwrap();
        let mut warnings = Warnings::default();
        let read = read(&source, 3, &[Some(0), Some(1), None], &mut warnings)?;
        Ok((read, warnings.finish()))
    }

    #[test]
    fn defaults_are_those_of_the_specification() {
        let (read, warnings) = read_json(json!({})).unwrap();
        assert_eq!(format!("{:?}", read.material), format!("{:?}", Material::default()));
        assert!(read.uv_sets.is_empty() && warnings.is_empty());
    }

    #[test]
    fn properties_are_read() {
        let (read, _) = read_json(json!({
            "name": "m", "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true, "emissiveFactor": [1, 0.5, 0],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8}},
            "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0, "roughnessFactor": 0.5},
            "normalTexture": {"index": 1, "scale": -2, "texCoord": 7}, "emissiveTexture": {"index": 2},
        })).unwrap();
        let material = read.material;
        assert_eq!(material.alpha_mode, AlphaMode::Mask { cutoff: 0.25 });
        assert_eq!((material.emissive, material.base_color), (Vec3::new(8.0, 4.0, 0.0), Vec4::new(0.1, 0.2, 0.3, 0.4)));
        assert_eq!((material.metallic, material.roughness, material.double_sided), (0.0, 0.5, true));
        let normal = material.normal_texture.unwrap();
        assert_eq!((normal.texture, normal.uv_set, material.normal_scale), (1, 0, -2.0));
        assert_eq!(read.uv_sets, [7]);
        assert!(material.emissive_texture.is_none(), "texture 2 has no image");
    }

    #[test]
    fn uv_sets_are_renumbered_and_at_most_two() {
        let (read, warnings) = read_json(json!({
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 4},
                "metallicRoughnessTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"texCoord": 1}}}},
            "normalTexture": {"index": 0, "texCoord": 4}, "emissiveTexture": {"index": 0, "texCoord": 2}, "emissiveFactor": [1, 1, 1],
        })).unwrap();
        let material = read.material;
        assert_eq!(read.uv_sets, [4, 1]);
        assert_eq!(material.metallic_roughness_texture.unwrap().uv_set, 1);
        assert_eq!(material.normal_texture.unwrap().uv_set, 0);
        assert!(material.emissive_texture.is_none());
        assert_eq!((warnings[0].code, warnings[0].pointer.as_str()), ("uv_sets", "/materials/3/emissiveTexture"));
    }

    #[test]
    fn what_is_not_seen_is_not_read() {
        let textures = json!({"normalTexture": {"index": 0}, "emissiveTexture": {"index": 0}});
        let (read, _) = read_json(textures.clone()).unwrap();
        assert!(read.material.emissive_texture.is_none(), "the factor is zero");
        let mut unlit = textures;
        unlit["extensions"] = json!({"KHR_materials_unlit": {}});
        unlit["emissiveFactor"] = json!([1, 1, 1]);
        let (read, _) = read_json(unlit).unwrap();
        assert!(read.material.unlit && read.material.normal_texture.is_none() && read.uv_sets.is_empty());
        assert_eq!(read.material.emissive, Vec3::ZERO);
    }

    #[test]
    fn texture_transforms_turn_as_the_extension_says() {
        let transform = json!({"offset": [0.5, 0.25], "rotation": std::f64::consts::FRAC_PI_2, "scale": [2, 3]});
        let (read, _) = read_json(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": transform}}}})).unwrap();
        let matrix = read.material.base_color_texture.unwrap().transform;
        // T * R * S with R = [[cos, sin], [-sin, cos]]: the turn that TextureTransformTest of the sample assets marks as correct.
        assert!((matrix * Vec3::new(1.0, 0.0, 1.0)).abs_diff_eq(Vec3::new(0.5, -1.75, 1.0), 1e-6));
        assert!((matrix * Vec3::new(0.0, 1.0, 1.0)).abs_diff_eq(Vec3::new(3.5, 0.25, 1.0), 1e-6));
    }

    #[test]
    fn factors_out_of_range() {
        let (read, warnings) = read_json(json!({"pbrMetallicRoughness": {"metallicFactor": 2}})).unwrap();
        assert_eq!((read.material.metallic, warnings[0].code), (1.0, "factor_clamped"));
        let place = |material| read_json(material).err().unwrap().pointer;
        assert_eq!(place(json!({"emissiveFactor": [0, -1, 0]})), "/materials/3/emissiveFactor");
        assert_eq!(place(json!({"alphaMode": "GLASS"})), "/materials/3/alphaMode");
        assert_eq!(place(json!({"normalTexture": {"index": 0, "scale": 1e39}})), "/materials/3/normalTexture/scale");
        let strength = json!({"extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1e38}}, "emissiveFactor": [1, 1, 1]});
        assert!(read_json(strength.clone()).is_ok());
        let transform = json!({"extensions": {"KHR_texture_transform": {"scale": "2"}}, "index": 0});
        assert_eq!(
            place(json!({ "normalTexture": transform })),
            "/materials/3/normalTexture/extensions/KHR_texture_transform/scale"
        );
    }
}
