//! Attributes of vertices, as far as their material reads them.

use super::accessor::open;
use super::document::escape;
use super::materials::{ReadMaterial, UV_SETS};
use super::meshes::{Decoder, Source};
use super::number::not_finite;
use super::tangents;
use crate::scene::{Primitive, SceneError};
use glam::{Vec2, Vec3, Vec4};

impl Decoder<'_> {
    /// An attribute of a primitive, all of it finite; missing components are 1.
    pub(super) fn attribute<T: From<[f32; N]>, const N: usize>(
        &mut self,
        source: Source<'_>,
        name: &str,
    ) -> Result<Option<Vec<T>>, SceneError> {
        let Some(index) = source.primitive.attributes.get(name) else { return Ok(None) };
        let numbers = self.numbers(source, *index, &format!("attributes/{}", escape(name)))?;
        Ok(Some(numbers.into_iter().map(T::from).collect()))
    }

    /// An accessor of which a primitive makes use at `name`, all of it finite; missing components are 1.
    pub(super) fn numbers<const N: usize>(
        &mut self,
        source: Source<'_>,
        index: usize,
        name: &str,
    ) -> Result<Vec<[f32; N]>, SceneError> {
        let (place, selection) = (source.place, source.selection);
        let accessor = open(self.data, index)?;
        if selection.is_some() && accessor.is_sparse() {
            // It is read as a whole all the same.
            self.charge_vertices(accessor.count, place)?;
        }
        let count = selection.filter(|_| !accessor.is_sparse()).map_or(accessor.count, <[u32]>::len);
        self.budget.charge((count * size_of::<[f32; N]>()) as u64, accessor.count, &accessor.pointer)?;
        let numbers = accessor.numbers::<N>(selection, 1.0)?;
        if let Some(vertex) = numbers.iter().position(|vertex| vertex.iter().any(|x| !x.is_finite())) {
            let vertex =
                selection.and_then(|selection| selection.get(vertex)).map_or(vertex, |vertex| *vertex as usize);
            return Err(not_finite(&format!("{place}/{name}"), format!("a component of vertex {vertex}")));
        }
        Ok(numbers)
    }

    /// Unit normals; those of no length become zero, which stands for the geometric normal.
    pub(super) fn normals(&mut self, source: Source<'_>) -> Result<Option<Vec<Vec3>>, SceneError> {
        let mut normals: Option<Vec<Vec3>> = self.attribute(source, "NORMAL")?;
        let mut zeros = 0_usize;
        for normal in normals.iter_mut().flatten() {
            *normal = tangents::unit(*normal);
            zeros += usize::from(*normal == Vec3::ZERO);
        }
        if zeros > 0 {
            let detail = format!("{zeros} normals have no length; the faces' own are used there");
            self.warnings.add("normal_zero", format!("{}/attributes/NORMAL", source.place), detail);
        }
        Ok(normals)
    }

    /// Colours within 0 to 1; none if all are white.
    pub(super) fn colors(&mut self, source: Source<'_>) -> Result<Option<Vec<Vec4>>, SceneError> {
        let Some(mut colors) = self.attribute::<Vec4, 4>(source, "COLOR_0")? else { return Ok(None) };
        let mut clamped = false;
        for color in &mut colors {
            let inside = color.clamp(Vec4::ZERO, Vec4::ONE);
            clamped |= inside != *color;
            *color = inside;
        }
        if clamped {
            let place = format!("{}/attributes/COLOR_0", source.place);
            self.warnings.add("color_clamped", place, "colours beyond 0 to 1 are clamped");
        }
        Ok(Some(colors).filter(|colors| colors.iter().any(|color| *color != Vec4::ONE)))
    }

    /// Texture coordinates in the material's numbering, and [`crate::scene::Material::first_uv`].
    pub(super) fn uvs(
        &mut self,
        source: Source<'_>,
        material: Option<&ReadMaterial>,
        count: usize,
    ) -> Result<Vec<Vec<Vec2>>, SceneError> {
        let mut uvs = Vec::new();
        let sets = material.map_or(&[][..], |material| &material.uv_sets);
        for set in sets {
            let uv = self.attribute(source, &format!("TEXCOORD_{set}"))?;
            if uv.is_none() {
                let detail = format!("the material reads TEXCOORD_{set}, which the primitive lacks; (0, 0) is used");
                self.warnings.add("uv_missing", format!("{}/material", source.place), detail);
            }
            uvs.push(uv.unwrap_or_else(|| vec![Vec2::ZERO; count]));
        }
        if material.is_some() && sets.len() < UV_SETS && !sets.contains(&0) {
            uvs.extend(self.attribute(source, "TEXCOORD_0")?);
        }
        Ok(uvs)
    }

    /// Tangents for normal maps and grains: the file's, or made by MikkTSpace if it has none (or no normals, 3.7.2.1).
    pub(super) fn tangents(
        &mut self,
        source: Source<'_>,
        material: Option<&ReadMaterial>,
        primitive: &mut Primitive,
    ) -> Result<(), SceneError> {
        let Some(material) = material else { return Ok(()) };
        let Some(texture) = material.tangents else { return Ok(()) };
        if primitive.normals.is_some() {
            let given: Option<Vec<Vec4>> = self.attribute(source, "TANGENT")?;
            primitive.tangents = given.map(|all| all.into_iter().map(tangents::orthonormal).collect());
        }
        let has_uv = material.uv_sets.get(texture.uv_set);
        let has_uv = has_uv.is_some_and(|set| source.primitive.attributes.contains_key(&format!("TEXCOORD_{set}")));
        if primitive.tangents.is_none() && has_uv {
            let before = primitive.positions.len();
            let exact = tangents::generate(primitive, &texture, &mut self.tally.tangent_pairs);
            self.charge_vertices(primitive.positions.len().saturating_sub(before), source.place)?;
            if !exact {
                let detail =
                    "too many triangles share a vertex for MikkTSpace; tangents are those of each face by itself";
                self.warnings.add("tangents_by_face", source.place, detail);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{Builder, PNG, error_of, full, scene_of, with_material};
    use glam::{Vec2, Vec3, Vec4};
    use serde_json::json;

    #[test]
    fn only_what_the_material_reads_is_decoded() {
        let plain = scene_of(&full());
        let primitive = &plain.meshes[0].primitives[0];
        assert!(primitive.uvs.is_empty() && primitive.tangents.is_none() && primitive.colors.is_none());
        assert_eq!(primitive.normals.as_deref(), Some(&[Vec3::Z, Vec3::ZERO, Vec3::Z][..]), "unit or zero");
        assert!(plain.warnings.iter().any(|warning| warning.code == "normal_zero"));
        let base = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 3}}});
        let textured = scene_of(&with_material(full(), &base));
        let primitive = &textured.meshes[0].primitives[0];
        assert_eq!(
            (primitive.uvs.len(), primitive.uvs[0][0], primitive.tangents.is_none()),
            (2, Vec2::splat(0.5), true)
        );
        assert_eq!(textured.images[0].bytes.as_ref(), PNG);
    }

    #[test]
    fn tangents_are_given_or_made() {
        let mapped = || json!({"normalTexture": {"index": 0}});
        let given = scene_of(&with_material(full(), &mapped()));
        assert_eq!(given.meshes[0].primitives[0].tangents.as_ref().unwrap()[0], Vec4::new(0.0, 1.0, 0.0, -1.0));
        for lacking in ["TANGENT", "NORMAL"] {
            let mut builder = with_material(full(), &mapped());
            builder.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove(lacking);
            let made = scene_of(&builder);
            let primitive = &made.meshes[0].primitives[0];
            assert_eq!(primitive.normals.is_some(), lacking == "TANGENT");
            for tangent in primitive.tangents.as_ref().unwrap() {
                assert!(tangent.abs_diff_eq(Vec4::new(1.0, 0.0, 0.0, 1.0), 1e-5), "without {lacking}: {tangent}");
            }
        }
        let missing = scene_of(&with_material(full(), &json!({"normalTexture": {"index": 0, "texCoord": 1}})));
        let primitive = &missing.meshes[0].primitives[0];
        assert_eq!(primitive.uvs[0], vec![Vec2::ZERO; 3]);
        assert!(missing.warnings.iter().any(|warning| warning.code == "uv_missing"));
    }

    #[test]
    fn vertex_colours_are_rgb_or_rgba() {
        let colors = |values: &[f32], kind: &str| {
            let mut builder = Builder::triangle();
            builder.attribute("COLOR_0", values, kind);
            let scene = scene_of(&builder);
            (scene.meshes[0].primitives[0].colors.as_ref().map(|colors| colors[1]), scene.warnings.len())
        };
        assert_eq!(colors(&[0.5; 9], "VEC3"), (Some(Vec4::new(0.5, 0.5, 0.5, 1.0)), 0));
        assert_eq!(colors(&[0.5; 12], "VEC4"), (Some(Vec4::splat(0.5)), 0));
        assert_eq!(colors(&[2.0; 12], "VEC4"), (None, 1), "clamped to white, which is none");
    }

    #[test]
    fn bad_vertices_and_indices_are_named() {
        let mut builder = Builder::default();
        builder.accessor(&[0.0, f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "VEC3");
        builder.show(&json!([{"attributes": {"POSITION": 0}}]));
        let fault = error_of(&builder);
        assert_eq!((fault.code, fault.pointer.as_str()), ("not_finite", "/meshes/0/primitives/0/attributes/POSITION"));
        assert!(fault.detail.contains("vertex 0"));
        let indexed = |indices: &[u8], shown: bool| {
            let mut builder = Builder::triangle();
            let accessor = builder.indices(indices);
            builder.json["meshes"][0]["primitives"][0]["indices"] = json!(accessor);
            if !shown {
                builder.json["nodes"] = json!([{}]);
            }
            builder
        };
        assert_eq!(scene_of(&indexed(&[2, 1, 0], true)).meshes[0].primitives[0].triangles, [[2, 1, 0]]);
        for shown in [true, false] {
            let fault = error_of(&indexed(&[0, 1, 3], shown));
            assert_eq!((fault.code, fault.pointer.as_str()), ("index_out_of_range", "/meshes/0/primitives/0/indices"));
        }
        let odd = scene_of(&indexed(&[0, 1, 2, 0], true));
        assert_eq!((odd.meshes[0].primitives[0].triangles.len(), odd.warnings[0].code), (1, "index_count"));
    }
}
