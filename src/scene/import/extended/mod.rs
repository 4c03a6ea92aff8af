//! `KHR_materials_*` of a material -> [`Extended`]. A texture is read only if its factor lets it be seen.

mod schema;

use super::document;
use super::materials::Reader;
use super::number::{finite, non_negative};
use super::schema::{Material, TextureInfo};
use crate::scene::{Extended, Scatter, SceneError, TextureRef, Volume};
use glam::Vec3;
use schema::{
    Anisotropy, Clearcoat, DiffuseTransmission, Dispersion, Ior, Iridescence, Sheen, Specular, Transmission,
    VolumeScatter, VolumeSource,
};

pub(super) use schema::SpecularGlossiness;

/// Extensions that are read here.
const NAMES: [&str; 12] = [
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_materials_volume_scatter",
];

/// The specular-glossiness values of a material that has them.
pub(super) fn specular_glossiness(source: &Material, place: &str) -> Result<Option<SpecularGlossiness>, SceneError> {
    const NAME: &str = "KHR_materials_pbrSpecularGlossiness";
    let content = source.extensions.get(NAME);
    content.map(|content| document::extension(content, &format!("{place}/extensions/{NAME}"))).transpose()
}

/// All extensions of a material together; none: it has none of them.
pub(super) fn read(reader: &mut Reader<'_>, source: &Material) -> Result<Option<Extended>, SceneError> {
    if !NAMES.iter().any(|name| source.extensions.contains_key(*name)) {
        return Ok(None);
    }
    let mut extended = Extended::default();
    let out = &mut extended;
    reader.with(source, "ior", |reader, values: &Ior| reader.ior(values.ior, out))?;
    reader.with(source, "specular", |reader, values| reader.specular(values, out))?;
    reader.with(source, "pbrSpecularGlossiness", |reader, values| reader.specular_of_glossy(values, out))?;
    reader.with(source, "transmission", |reader, values| reader.transmission(values, out))?;
    reader.with(source, "diffuse_transmission", |reader, values| reader.diffuse_transmission(values, out))?;
    reader.with(source, "volume", |reader, values| reader.volume(values, out))?;
    reader.with(source, "volume_scatter", |reader, values| reader.volume_scatter(values, out))?;
    reader.with(source, "dispersion", |reader, values| reader.dispersion(values, out))?;
    reader.with(source, "clearcoat", |reader, values| reader.clearcoat(values, out))?;
    reader.with(source, "sheen", |reader, values| reader.sheen(values, out))?;
    reader.with(source, "anisotropy", |reader, values| reader.anisotropy(values, out))?;
    reader.with(source, "iridescence", |reader, values| reader.iridescence(values, out))?;
    Ok(Some(extended))
}

/// One extension of a material, being read.
struct Values<'r, 'a> {
    reader: &'r mut Reader<'a>,
    /// Where its values stand, relative to the material.
    place: String,
}

impl<'a> Reader<'a> {
    /// Reads `KHR_materials_{name}`, if the material has it.
    fn with<T: serde::de::DeserializeOwned>(
        &mut self,
        source: &Material,
        name: &str,
        read: impl FnOnce(&mut Values<'_, 'a>, &T) -> Result<(), SceneError>,
    ) -> Result<(), SceneError> {
        let name = format!("KHR_materials_{name}");
        let Some(content) = source.extensions.get(&name) else { return Ok(()) };
        let place = format!("extensions/{name}");
        let values = document::extension(content, &format!("{}/{place}", self.place))?;
        read(&mut Values { reader: self, place }, &values)
    }
}

impl Values<'_, '_> {
    fn at(&self, name: &str) -> String {
        format!("{}/{}/{name}", self.reader.place, self.place)
    }

    fn warn(&mut self, code: &'static str, name: &str, detail: String) {
        let place = self.at(name);
        self.reader.warnings.add(code, place, detail);
    }

    fn factor(&mut self, value: Option<f64>, default: f64, name: &str) -> Result<f32, SceneError> {
        Ok(self.reader.factors([value.unwrap_or(default)], &format!("{}/{name}", self.place))?[0])
    }

    fn color(&mut self, value: Option<[f64; 3]>, default: [f64; 3], name: &str) -> Result<Vec3, SceneError> {
        let factors = self.reader.factors(value.unwrap_or(default), &format!("{}/{name}", self.place))?;
        Ok(Vec3::from(factors))
    }

    /// A texture that is of no account unless `seen`; its reference is checked all the same.
    fn texture(
        &mut self,
        info: Option<&TextureInfo>,
        seen: bool,
        name: &str,
    ) -> Result<Option<TextureRef>, SceneError> {
        let place = format!("{}/{name}", self.place);
        self.reader.check_texture(info, &place)?;
        self.reader.texture(info.filter(|_| seen), &place)
    }

    fn index_of_refraction(&mut self, value: f64, name: &str) -> Result<f32, SceneError> {
        let ior = non_negative(value, &self.at(name))?;
        if ior < 1.0 {
            self.warn("factor_clamped", name, format!("{value} is less than 1 and is taken as 1"));
        }
        Ok(ior.max(1.0))
    }

    fn ior(&mut self, value: Option<f64>, out: &mut Extended) -> Result<(), SceneError> {
        // 0 stands for infinity (KHR_materials_ior, "Interaction with other extensions").
        out.ior = if value == Some(0.0) { 0.0 } else { self.index_of_refraction(value.unwrap_or(1.5), "ior")? };
        Ok(())
    }

    fn specular(&mut self, values: &Specular, out: &mut Extended) -> Result<(), SceneError> {
        out.specular = self.factor(values.specular_factor, 1.0, "specularFactor")?;
        let seen = out.specular > 0.0;
        out.specular_texture = self.texture(values.specular_texture.as_ref(), seen, "specularTexture")?;
        let place = self.at("specularColorFactor");
        let color = values.specular_color_factor.unwrap_or([1.0; 3]);
        out.specular_color = Vec3::new(
            non_negative(color[0], &place)?,
            non_negative(color[1], &place)?,
            non_negative(color[2], &place)?,
        );
        let seen = seen && out.specular_color != Vec3::ZERO;
        let texture = values.specular_color_texture.as_ref();
        out.specular_color_texture = self.texture(texture, seen, "specularColorTexture")?;
        Ok(())
    }

    fn specular_of_glossy(&mut self, values: &SpecularGlossiness, out: &mut Extended) -> Result<(), SceneError> {
        out.specular_glossiness = true;
        out.specular_color = self.color(values.specular_factor, [1.0; 3], "specularFactor")?;
        let texture = values.specular_glossiness_texture.as_ref();
        out.specular_color_texture = self.texture(texture, true, "specularGlossinessTexture")?;
        Ok(())
    }

    fn transmission(&mut self, values: &Transmission, out: &mut Extended) -> Result<(), SceneError> {
        out.transmission = self.factor(values.transmission_factor, 0.0, "transmissionFactor")?;
        let seen = out.transmission > 0.0;
        out.transmission_texture = self.texture(values.transmission_texture.as_ref(), seen, "transmissionTexture")?;
        Ok(())
    }

    fn diffuse_transmission(&mut self, values: &DiffuseTransmission, out: &mut Extended) -> Result<(), SceneError> {
        out.diffuse_transmission = self.factor(values.diffuse_transmission_factor, 0.0, "diffuseTransmissionFactor")?;
        let seen = out.diffuse_transmission > 0.0;
        let texture = values.diffuse_transmission_texture.as_ref();
        out.diffuse_transmission_texture = self.texture(texture, seen, "diffuseTransmissionTexture")?;
        let name = "diffuseTransmissionColorFactor";
        out.diffuse_transmission_color = self.color(values.diffuse_transmission_color_factor, [1.0; 3], name)?;
        let texture = values.diffuse_transmission_color_texture.as_ref();
        out.diffuse_transmission_color_texture = self.texture(texture, seen, "diffuseTransmissionColorTexture")?;
        Ok(())
    }

    /// The thickness says whether there is a volume at all; how thick it is, the mesh says.
    fn volume(&mut self, values: &VolumeSource, out: &mut Extended) -> Result<(), SceneError> {
        let thickness = non_negative(values.thickness_factor.unwrap_or(0.0), &self.at("thicknessFactor"))?;
        self.texture(values.thickness_texture.as_ref(), false, "thicknessTexture")?;
        let attenuation_color = self.color(values.attenuation_color, [1.0; 3], "attenuationColor")?;
        let mut attenuation_distance = f32::INFINITY;
        if let Some(distance) = values.attenuation_distance {
            attenuation_distance = non_negative(distance, &self.at("attenuationDistance"))?;
            if attenuation_distance == 0.0 {
                let detail = "0 is no distance; nothing is absorbed".to_owned();
                self.warn("attenuation_distance", "attenuationDistance", detail);
                attenuation_distance = f32::INFINITY;
            }
        }
        let filled = thickness > 0.0 && out.transmits();
        out.volume = filled.then_some(Volume { attenuation_color, attenuation_distance });
        Ok(())
    }

    /// Particles in the volume, which must be there.
    fn volume_scatter(&mut self, values: &VolumeScatter, out: &mut Extended) -> Result<(), SceneError> {
        let color = self.color(values.multiscatter_color, [0.0; 3], "multiscatterColor")?;
        let anisotropy = finite(values.scatter_anisotropy.unwrap_or(0.0), &self.at("scatterAnisotropy"))?;
        let most = Scatter::MOST as f32;
        if anisotropy.abs() > most {
            let detail = format!("{anisotropy} lies beyond -{most} to {most} and is taken as the nearer of the two");
            self.warn("factor_clamped", "scatterAnisotropy", detail);
        }
        let texture = values.multiscatter_color_texture.as_ref();
        self.texture(texture, false, "multiscatterColorTexture")?;
        if texture.is_some() {
            let detail = "media are the same everywhere; the factor alone is read".to_owned();
            self.warn("scatter_texture", "multiscatterColorTexture", detail);
        }
        let there = out.volume.is_some() && color != Vec3::ZERO;
        out.scatter = there.then(|| Scatter::new(color, anisotropy.clamp(-most, most)));
        Ok(())
    }

    fn dispersion(&mut self, values: &Dispersion, out: &mut Extended) -> Result<(), SceneError> {
        out.dispersion = non_negative(values.dispersion.unwrap_or(0.0), &self.at("dispersion"))?;
        Ok(())
    }

    fn clearcoat(&mut self, values: &Clearcoat, out: &mut Extended) -> Result<(), SceneError> {
        out.clearcoat = self.factor(values.clearcoat_factor, 0.0, "clearcoatFactor")?;
        let seen = out.clearcoat > 0.0;
        out.clearcoat_texture = self.texture(values.clearcoat_texture.as_ref(), seen, "clearcoatTexture")?;
        out.clearcoat_roughness = self.factor(values.clearcoat_roughness_factor, 0.0, "clearcoatRoughnessFactor")?;
        let rough = seen && out.clearcoat_roughness > 0.0;
        let texture = values.clearcoat_roughness_texture.as_ref();
        out.clearcoat_roughness_texture = self.texture(texture, rough, "clearcoatRoughnessTexture")?;
        let texture = values.clearcoat_normal_texture.as_ref();
        let scale = texture.and_then(|texture| texture.scale).unwrap_or(1.0);
        out.clearcoat_normal_scale = finite(scale, &self.at("clearcoatNormalTexture/scale"))?;
        out.clearcoat_normal_texture = self.texture(texture, seen, "clearcoatNormalTexture")?;
        Ok(())
    }

    fn sheen(&mut self, values: &Sheen, out: &mut Extended) -> Result<(), SceneError> {
        out.sheen_color = self.color(values.sheen_color_factor, [0.0; 3], "sheenColorFactor")?;
        let seen = out.sheen_color != Vec3::ZERO;
        out.sheen_color_texture = self.texture(values.sheen_color_texture.as_ref(), seen, "sheenColorTexture")?;
        out.sheen_roughness = self.factor(values.sheen_roughness_factor, 0.0, "sheenRoughnessFactor")?;
        let texture = values.sheen_roughness_texture.as_ref();
        out.sheen_roughness_texture = self.texture(texture, seen, "sheenRoughnessTexture")?;
        Ok(())
    }

    fn anisotropy(&mut self, values: &Anisotropy, out: &mut Extended) -> Result<(), SceneError> {
        out.anisotropy = self.factor(values.anisotropy_strength, 0.0, "anisotropyStrength")?;
        out.anisotropy_rotation = finite(values.anisotropy_rotation.unwrap_or(0.0), &self.at("anisotropyRotation"))?;
        let seen = out.anisotropy > 0.0;
        out.anisotropy_texture = self.texture(values.anisotropy_texture.as_ref(), seen, "anisotropyTexture")?;
        Ok(())
    }

    fn iridescence(&mut self, values: &Iridescence, out: &mut Extended) -> Result<(), SceneError> {
        out.iridescence = self.factor(values.iridescence_factor, 0.0, "iridescenceFactor")?;
        let seen = out.iridescence > 0.0;
        out.iridescence_texture = self.texture(values.iridescence_texture.as_ref(), seen, "iridescenceTexture")?;
        out.iridescence_ior = self.index_of_refraction(values.iridescence_ior.unwrap_or(1.3), "iridescenceIor")?;
        let thickness =
            |value: Option<f64>, default, name: &str| non_negative(value.unwrap_or(default), &self.at(name));
        out.iridescence_thickness = [
            thickness(values.iridescence_thickness_minimum, 100.0, "iridescenceThicknessMinimum")?,
            thickness(values.iridescence_thickness_maximum, 400.0, "iridescenceThicknessMaximum")?,
        ];
        let texture = values.iridescence_thickness_texture.as_ref();
        out.iridescence_thickness_texture = self.texture(texture, seen, "iridescenceThicknessTexture")?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::error::{Warning, Warnings};
    use crate::scene::import::materials::{ReadMaterial, read};
    use crate::scene::{SceneError, Volume};
    use glam::{Vec3, Vec4};
    use serde_json::{Value, json};

    fn read_json(extensions: &Value) -> Result<(ReadMaterial, Vec<Warning>), SceneError> {
        let source = serde_json::from_value(json!({ "extensions": extensions })).unwrap();
        let mut warnings = Warnings::default();
        let read = read(&source, 0, &[Some(0), Some(1)], &mut warnings)?;
        Ok((read, warnings.finish()))
    }

    #[test]
    fn a_material_without_extensions_has_none() {
        assert!(read_json(&json!({"KHR_materials_emissive_strength": {}})).unwrap().0.material.extended.is_none());
        let unlit = json!({"KHR_materials_unlit": {}, "KHR_materials_clearcoat": {"clearcoatFactor": 1}});
        assert!(read_json(&unlit).unwrap().0.material.extended.is_none());
    }

    #[test]
    fn values_and_textures_are_read() {
        let (read, warnings) = read_json(&json!({
            "KHR_materials_ior": {"ior": 1.8},
            "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [2, 1, 0], "specularColorTexture": {"index": 1}},
            "KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": {"index": 0, "texCoord": 3}},
            "KHR_materials_volume": {"thicknessFactor": 2, "attenuationColor": [1, 0.5, 0.25], "attenuationDistance": 3},
            "KHR_materials_volume_scatter": {"multiscatterColor": [1, 0, 0.5], "scatterAnisotropy": -0.5},
            "KHR_materials_dispersion": {"dispersion": 0.2},
            "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatNormalTexture": {"index": 0, "scale": 0.5}},
            "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.2, 0.3], "sheenRoughnessFactor": 0.4},
            "KHR_materials_anisotropy": {"anisotropyStrength": 0.6, "anisotropyRotation": 1},
            "KHR_materials_iridescence": {"iridescenceFactor": 1, "iridescenceThicknessMaximum": 300},
            "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.3, "diffuseTransmissionColorFactor": [1, 0, 1]},
        }))
        .unwrap();
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!((read.uv_sets.as_slice(), read.tangents.unwrap().uv_set), (&[0, 3][..], 0));
        let extended = read.material.extended.unwrap();
        assert_eq!((extended.ior, extended.specular, extended.specular_color), (1.8, 0.5, Vec3::new(2.0, 1.0, 0.0)));
        assert_eq!((extended.transmission, extended.transmission_texture.unwrap().uv_set), (0.75, 1));
        let volume = Volume { attenuation_color: Vec3::new(1.0, 0.5, 0.25), attenuation_distance: 3.0 };
        assert_eq!((extended.volume, extended.dispersion), (Some(volume), 0.2));
        let scatter = extended.scatter.unwrap();
        assert_eq!((scatter.anisotropy, scatter.albedo.y), (-0.5, 0.0));
        assert!(scatter.albedo.x > 0.9999 && (0.8..0.95).contains(&scatter.albedo.z), "{scatter:?}");
        assert_eq!(
            (extended.clearcoat, extended.clearcoat_roughness, extended.clearcoat_normal_scale),
            (1.0, 0.0, 0.5)
        );
        assert_eq!((extended.sheen_color, extended.sheen_roughness), (Vec3::new(0.1, 0.2, 0.3), 0.4));
        assert_eq!((extended.anisotropy, extended.anisotropy_rotation), (0.6, 1.0));
        assert_eq!((extended.iridescence_ior, extended.iridescence_thickness), (1.3, [100.0, 300.0]));
        assert_eq!(
            (extended.diffuse_transmission, extended.diffuse_transmission_color),
            (0.3, Vec3::new(1.0, 0.0, 1.0))
        );
        assert_eq!(extended.textures().count(), 3);
    }

    #[test]
    fn specular_glossiness_takes_the_place_of_the_core() {
        let glossy = json!({"diffuseFactor": [0.1, 0.2, 0.3, 0.4], "diffuseTexture": {"index": 1},
            "specularFactor": [0.5, 0.6, 0.7], "glossinessFactor": 0.75});
        let (read, _) = read_json(&json!({ "KHR_materials_pbrSpecularGlossiness": glossy })).unwrap();
        let material = read.material;
        assert_eq!(
            (material.base_color, material.base_color_texture.unwrap().texture),
            (Vec4::new(0.1, 0.2, 0.3, 0.4), 1)
        );
        assert_eq!((material.metallic, material.roughness), (0.0, 0.25));
        let extended = material.extended.unwrap();
        assert!(extended.specular_glossiness);
        assert_eq!(extended.specular_color, Vec3::new(0.5, 0.6, 0.7));
    }

    #[test]
    fn what_is_not_seen_is_not_read() {
        let off = json!({
            "KHR_materials_clearcoat": {"clearcoatTexture": {"index": 0}, "clearcoatNormalTexture": {"index": 0}},
            "KHR_materials_sheen": {"sheenColorTexture": {"index": 0}},
            "KHR_materials_volume": {"thicknessFactor": 1, "thicknessTexture": {"index": 0}},
        });
        let (read, _) = read_json(&off).unwrap();
        let extended = read.material.extended.unwrap();
        assert_eq!((extended.textures().count(), extended.volume), (0, None), "nothing transmits");
        assert!(read.uv_sets.is_empty() && read.tangents.is_none());
    }

    #[test]
    fn faults_are_named() {
        let place = |extensions: Value| read_json(&extensions).err().unwrap().pointer;
        let at = "/materials/0/extensions/";
        assert_eq!(
            place(json!({"KHR_materials_sheen": {"sheenColorFactor": "red"}})),
            format!("{at}KHR_materials_sheen/sheenColorFactor")
        );
        assert_eq!(
            place(json!({"KHR_materials_transmission": {"transmissionTexture": {"index": 2}}})),
            format!("{at}KHR_materials_transmission/transmissionTexture/index")
        );
        assert_eq!(place(json!({"KHR_materials_ior": {"ior": -1}})), format!("{at}KHR_materials_ior/ior"));
        let (read, warnings) = read_json(&json!({"KHR_materials_ior": {"ior": 0.5}})).unwrap();
        assert_eq!((read.material.extended.unwrap().ior, warnings[0].code), (1.0, "factor_clamped"));
    }
}
