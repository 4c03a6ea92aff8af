//! Meshes: all are checked, those that are shown are decoded, with the attributes that their materials read.

use super::accessor::{Component, open};
use super::attributes;
use super::data::Data;
use super::document;
use super::extensions;
use super::materials::{ReadMaterial, UV_SETS};
use super::number::not_finite;
use super::schema::{self, VARIANTS, VariantMappings};
use super::tangents;
use super::triangles::{self, Mode};
use crate::scene::error::Warnings;
use crate::scene::{Limits, Mesh, Primitive, SceneError};
use glam::{Vec2, Vec3, Vec4};
use std::collections::HashMap;

/// Checks every primitive of the file, indices included.
pub(super) fn check(data: &Data<'_>) -> Result<(), SceneError> {
    let quantized = extensions::declared(data.root, "KHR_mesh_quantization");
    let mut highest = HashMap::new();
    for (i, mesh) in data.root.meshes.iter().enumerate() {
        for (j, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("/meshes/{i}/primitives/{j}");
            let count = attributes::check(data, primitive, quantized, &place)?;
            if primitive.mode > 6 {
                let detail = format!("{} is not a mode; it is 0 to 6", primitive.mode);
                return Err(SceneError::invalid("primitive_mode", format!("{place}/mode"), detail));
            }
            let Some(index) = primitive.indices else { continue };
            let highest = match highest.get(&index) {
                Some(highest) => *highest,
                None => *highest.entry(index).or_insert(highest_index(data, index, &place)?),
            };
            if let (Some(highest), Some(count)) = (highest, count)
                && highest as usize >= count
            {
                let detail =
                    format!("index {highest} is beyond the {count} vertices of POSITION; export the file again");
                return Err(SceneError::invalid("index_out_of_range", format!("{place}/indices"), detail));
            }
        }
    }
    Ok(())
}

fn highest_index(data: &Data<'_>, index: usize, place: &str) -> Result<Option<u32>, SceneError> {
    let accessor = open(data, index)?;
    let format = accessor.format;
    let unsigned = matches!(format.component, Component::U8 | Component::U16 | Component::U32);
    if !unsigned || (format.rows, format.columns, format.normalized) != (1, 1, false) {
        let detail = format!("indices are SCALAR of unsigned integers, not {format}");
        return Err(SceneError::invalid("accessor_type", format!("{place}/indices"), detail));
    }
    if !accessor.is_stored() {
        let detail = "indices without a buffer view are all zero and make no triangle; export the file again";
        return Err(SceneError::invalid("index_missing", format!("{place}/indices"), detail));
    }
    Ok(accessor.integers()?.into_iter().max())
}

/// Decodes meshes until the limits are reached.
pub(super) struct Decoder<'a> {
    data: &'a Data<'a>,
    materials: &'a [ReadMaterial],
    limits: &'a Limits,
    warnings: &'a mut Warnings,
    triangles: usize,
    vertices: usize,
    /// Bytes that vertices may take yet.
    bytes_left: u64,
    tangent_pairs: u64,
}

/// Triangles, and the vertices that they refer to if not all.
type Faces = (Vec<[u32; 3]>, Option<Vec<u32>>);

impl<'a> Decoder<'a> {
    pub(super) fn new(
        data: &'a Data<'a>,
        materials: &'a [ReadMaterial],
        limits: &'a Limits,
        file_bytes: u64,
        warnings: &'a mut Warnings,
    ) -> Self {
        let bytes_left = limits.decoded(file_bytes);
        Self { data, materials, limits, warnings, triangles: 0, vertices: 0, bytes_left, tangent_pairs: 0 }
    }

    /// All meshes; the primitives of those that are `shown`.
    pub(super) fn meshes(&mut self, shown: &[bool]) -> Result<Vec<Mesh>, SceneError> {
        let mut meshes = Vec::new();
        for (i, source) in self.data.root.meshes.iter().enumerate() {
            let mut mesh = Mesh { name: source.name.clone(), primitives: Vec::new() };
            if shown.get(i).copied().unwrap_or(false) {
                for (j, primitive) in source.primitives.iter().enumerate() {
                    mesh.primitives.extend(self.variants(primitive, &format!("/meshes/{i}/primitives/{j}"))?);
                }
            }
            meshes.push(mesh);
        }
        Ok(meshes)
    }

    /// A primitive with what stands in its place in other variants.
    fn variants(&mut self, source: &schema::Primitive, place: &str) -> Result<Option<Primitive>, SceneError> {
        let Some(mut primitive) = self.primitive(source, source.material, place)? else { return Ok(None) };
        let Some(content) = source.extensions.get(VARIANTS) else { return Ok(Some(primitive)) };
        let mappings: VariantMappings = document::extension(content, &format!("{place}/extensions/{VARIANTS}"))?;
        for mapping in mappings.mappings {
            if Some(mapping.material) != source.material
                && let Some(alternative) = self.primitive(source, Some(mapping.material), place)?
            {
                primitive.alternatives.push((mapping.variants, alternative));
            }
        }
        Ok(Some(primitive))
    }

    fn primitive(
        &mut self,
        source: &schema::Primitive,
        material_index: Option<usize>,
        place: &str,
    ) -> Result<Option<Primitive>, SceneError> {
        let mode = match source.mode {
            4 => Mode::List,
            5 => Mode::Strip,
            6 => Mode::Fan,
            mode => {
                let what = if mode == 0 { "points" } else { "lines" };
                self.warnings.add(
                    "primitive_skipped",
                    format!("{place}/mode"),
                    format!("{what} have no surface and are not drawn"),
                );
                return Ok(None);
            }
        };
        let Some(positions) = source.attributes.get("POSITION") else {
            self.warnings.add("primitive_skipped", place, "the primitive has no POSITION and is not drawn");
            return Ok(None);
        };
        let count = open(self.data, *positions)?.count;
        let (mut triangles, selection) = self.triangles(source, mode, count, place)?;
        if triangles.is_empty() {
            return Ok(None);
        }
        let material = material_index.and_then(|index| self.materials.get(index));
        let positions: Vec<Vec3> = self.read(source, "POSITION", selection.as_deref(), place)?.unwrap_or_default();
        let mut primitive = Primitive {
            normals: self.normals(source, selection.as_deref(), place)?,
            colors: self.colors(source, selection.as_deref(), place)?,
            uvs: self.uvs(source, material, positions.len(), selection.as_deref(), place)?,
            positions,
            triangles: std::mem::take(&mut triangles),
            material: material_index,
            tangents: None,
            alternatives: Vec::new(),
        };
        self.tangents(source, material, &mut primitive, selection.as_deref(), place)?;
        Ok(Some(primitive))
    }

    fn triangles(
        &mut self,
        source: &schema::Primitive,
        mode: Mode,
        vertices: usize,
        place: &str,
    ) -> Result<Faces, SceneError> {
        let indices = source.indices.map(|index| open(self.data, index)).transpose()?;
        let count = indices.as_ref().map_or(vertices, |indices| indices.count);
        if mode == Mode::List && count % 3 != 0 {
            let detail = format!("{count} is not a multiple of 3; the last vertices are left out");
            self.warnings.add("index_count", place, detail);
        }
        self.triangles = self.triangles.saturating_add(mode.triangles(count));
        if self.triangles > self.limits.triangles {
            let detail =
                format!("with this primitive the scene has more triangles than the limit of {}", self.limits.triangles);
            return Err(SceneError::too_large("triangles", place, detail));
        }
        let pointer = indices.as_ref().map_or(place, |indices| &indices.pointer).to_owned();
        self.charge_bytes((mode.triangles(count) * size_of::<[u32; 3]>()) as u64, count, &pointer)?;
        let indices = indices.map(|indices| indices.integers()).transpose()?;
        let mut triangles = triangles::list(mode, count, indices.as_deref());
        let selection = triangles::compact(&mut triangles, vertices);
        self.charge_vertices(selection.as_ref().map_or(vertices, Vec::len), place)?;
        Ok((triangles, selection))
    }

    fn charge_vertices(&mut self, count: usize, place: &str) -> Result<(), SceneError> {
        self.vertices = self.vertices.saturating_add(count);
        if self.vertices <= self.limits.vertices {
            return Ok(());
        }
        let detail =
            format!("with this primitive the scene has more vertices than the limit of {}", self.limits.vertices);
        Err(SceneError::too_large("vertices", place, detail))
    }

    fn charge_bytes(&mut self, bytes: u64, count: usize, pointer: &str) -> Result<(), SceneError> {
        let left = self.bytes_left.checked_sub(bytes).ok_or_else(|| {
            let detail = format!(
                "with the {count} elements here, triangles and vertices take far more memory than the file has bytes: is an \
                 accessor's `count` right, or is its `bufferView` missing? (limit decompressed_bytes, and {} per byte of the file)",
                self.limits.decoded_ratio
            );
            SceneError::too_large("decoded_bytes", pointer, detail)
        })?;
        self.bytes_left = left;
        Ok(())
    }

    /// An attribute, all of it finite; missing components are 1.
    fn read<T: From<[f32; N]>, const N: usize>(
        &mut self,
        source: &schema::Primitive,
        name: &str,
        selection: Option<&[u32]>,
        place: &str,
    ) -> Result<Option<Vec<T>>, SceneError> {
        let Some(index) = source.attributes.get(name) else { return Ok(None) };
        let accessor = open(self.data, *index)?;
        if selection.is_some() && accessor.is_sparse() {
            // It is read as a whole all the same.
            self.charge_vertices(accessor.count, place)?;
        }
        let count = selection.filter(|_| !accessor.is_sparse()).map_or(accessor.count, <[u32]>::len);
        self.charge_bytes((count * size_of::<[f32; N]>()) as u64, accessor.count, &accessor.pointer)?;
        let numbers = accessor.numbers::<N>(selection, 1.0)?;
        if let Some(vertex) = numbers.iter().position(|vertex| vertex.iter().any(|x| !x.is_finite())) {
            let vertex =
                selection.and_then(|selection| selection.get(vertex)).map_or(vertex, |vertex| *vertex as usize);
            return Err(not_finite(&format!("{place}/attributes/{name}"), format!("a component of vertex {vertex}")));
        }
        Ok(Some(numbers.into_iter().map(T::from).collect()))
    }

    /// Unit normals; those of no length become zero, which stands for the geometric normal.
    fn normals(
        &mut self,
        source: &schema::Primitive,
        selection: Option<&[u32]>,
        place: &str,
    ) -> Result<Option<Vec<Vec3>>, SceneError> {
        let mut normals: Option<Vec<Vec3>> = self.read(source, "NORMAL", selection, place)?;
        let mut zeros = 0_usize;
        for normal in normals.iter_mut().flatten() {
            *normal = tangents::unit(*normal);
            zeros += usize::from(*normal == Vec3::ZERO);
        }
        if zeros > 0 {
            let detail = format!("{zeros} normals have no length; the faces' own are used there");
            self.warnings.add("normal_zero", format!("{place}/attributes/NORMAL"), detail);
        }
        Ok(normals)
    }

    /// Colours within 0 to 1; none if all are white.
    fn colors(
        &mut self,
        source: &schema::Primitive,
        selection: Option<&[u32]>,
        place: &str,
    ) -> Result<Option<Vec<Vec4>>, SceneError> {
        let Some(mut colors) = self.read::<Vec4, 4>(source, "COLOR_0", selection, place)? else { return Ok(None) };
        let mut clamped = false;
        for color in &mut colors {
            let inside = color.clamp(Vec4::ZERO, Vec4::ONE);
            clamped |= inside != *color;
            *color = inside;
        }
        if clamped {
            self.warnings.add(
                "color_clamped",
                format!("{place}/attributes/COLOR_0"),
                "colours beyond 0 to 1 are clamped",
            );
        }
        Ok(Some(colors).filter(|colors| colors.iter().any(|color| *color != Vec4::ONE)))
    }

    /// Texture coordinates in the material's numbering, and [`crate::scene::Material::first_uv`].
    fn uvs(
        &mut self,
        source: &schema::Primitive,
        material: Option<&ReadMaterial>,
        count: usize,
        selection: Option<&[u32]>,
        place: &str,
    ) -> Result<Vec<Vec<Vec2>>, SceneError> {
        let mut uvs = Vec::new();
        let sets = material.map_or(&[][..], |material| &material.uv_sets);
        for set in sets {
            let uv = self.read(source, &format!("TEXCOORD_{set}"), selection, place)?;
            if uv.is_none() {
                let detail = format!("the material reads TEXCOORD_{set}, which the primitive lacks; (0, 0) is used");
                self.warnings.add("uv_missing", format!("{place}/material"), detail);
            }
            uvs.push(uv.unwrap_or_else(|| vec![Vec2::ZERO; count]));
        }
        if material.is_some() && sets.len() < UV_SETS && !sets.contains(&0) {
            uvs.extend(self.read(source, "TEXCOORD_0", selection, place)?);
        }
        Ok(uvs)
    }

    /// Tangents for normal maps and grains: the file's, or made by MikkTSpace if it has none (or no normals, 3.7.2.1).
    fn tangents(
        &mut self,
        source: &schema::Primitive,
        material: Option<&ReadMaterial>,
        primitive: &mut Primitive,
        selection: Option<&[u32]>,
        place: &str,
    ) -> Result<(), SceneError> {
        let Some(material) = material else { return Ok(()) };
        let Some(texture) = material.tangents else { return Ok(()) };
        if primitive.normals.is_some() {
            let given: Option<Vec<Vec4>> = self.read(source, "TANGENT", selection, place)?;
            primitive.tangents = given.map(|all| all.into_iter().map(tangents::orthonormal).collect());
        }
        let has_uv = material.uv_sets.get(texture.uv_set);
        let has_uv = has_uv.is_some_and(|set| source.attributes.contains_key(&format!("TEXCOORD_{set}")));
        if primitive.tangents.is_none() && has_uv {
            let before = primitive.positions.len();
            let exact = tangents::generate(primitive, &texture, &mut self.tangent_pairs);
            self.charge_vertices(primitive.positions.len().saturating_sub(before), place)?;
            if !exact {
                let detail =
                    "too many triangles share a vertex for MikkTSpace; tangents are those of each face by itself";
                self.warnings.add("tangents_by_face", place, detail);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{Builder, PNG, error_of, scene_of};
    use crate::scene::{Limits, import};
    use glam::{Vec2, Vec3, Vec4};
    use serde_json::{Value, json};

    /// A triangle with texture coordinates in sets 0 and 3, normals and tangents.
    fn full() -> Builder {
        let mut builder = Builder::triangle();
        builder.attribute("TEXCOORD_0", &[0.0, 1.0, 1.0, 1.0, 0.0, 0.0], "VEC2");
        builder.attribute("TEXCOORD_3", &[0.5; 6], "VEC2");
        builder.attribute("NORMAL", &[0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], "VEC3");
        builder.attribute("TANGENT", &[0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0], "VEC4");
        builder
    }

    fn with_material(mut builder: Builder, material: &Value) -> Builder {
        builder.json["materials"] = json!([material]);
        builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        let view = builder.view(PNG);
        builder.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
        builder.json["textures"] = json!([{"source": 0}]);
        builder
    }

    #[test]
    fn variants_have_the_attributes_that_their_materials_read() {
        let base = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 3}}});
        let mut builder = with_material(full(), &json!({}));
        builder.json["materials"] = json!([{}, base]);
        builder.json["extensionsUsed"] = json!(["KHR_materials_variants"]);
        builder.json["extensions"] = json!({"KHR_materials_variants": {"variants": [{"name": "a"}, {"name": "b"}]}});
        let mapping =
            |variants: Value| json!({"KHR_materials_variants": {"mappings": [{"material": 1, "variants": variants}]}});
        builder.json["meshes"][0]["primitives"][0]["extensions"] = mapping(json!([1]));
        let scene = scene_of(&builder);
        let primitive = &scene.meshes[0].primitives[0];
        let shown = |variant| (primitive.of_variant(variant).material, primitive.of_variant(variant).uvs.len());
        assert_eq!([shown(None), shown(Some(0)), shown(Some(1))], [(Some(0), 1), (Some(0), 1), (Some(1), 2)]);
        assert_eq!(scene.images[0].bytes.as_ref(), PNG);
        builder.json["meshes"][0]["primitives"][0]["extensions"] = mapping(json!([2]));
        let place = "/meshes/0/primitives/0/extensions/KHR_materials_variants/mappings/0/variants/0";
        assert_eq!(error_of(&builder).pointer, place);
    }

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

    #[test]
    fn modes_and_unshown_meshes() {
        let mode = |mode: u32| {
            let mut builder = Builder::triangle();
            builder.json["meshes"][0]["primitives"][0]["mode"] = json!(mode);
            builder
        };
        for skipped in 0..4 {
            let scene = scene_of(&mode(skipped));
            assert_eq!((scene.meshes[0].primitives.len(), scene.warnings[0].code), (0, "primitive_skipped"));
        }
        for drawn in 4..7 {
            assert_eq!(scene_of(&mode(drawn)).meshes[0].primitives[0].triangles.len(), 1);
        }
        assert_eq!(error_of(&mode(7)).pointer, "/meshes/0/primitives/0/mode");
        let mut unshown = Builder::triangle();
        unshown.json["nodes"] = json!([{}]);
        assert!(scene_of(&unshown).meshes[0].primitives.is_empty());
    }

    #[test]
    fn primitives_keep_only_their_vertices() {
        let mut builder = Builder::default();
        let far: Vec<f32> = (0..300).map(|i| i as f32).collect();
        builder.accessor(&far, "VEC3");
        let accessor = builder.indices(&[99, 1, 50]);
        builder.show(&json!([{"attributes": {"POSITION": 0}, "indices": accessor}]));
        let scene = scene_of(&builder);
        let primitive = &scene.meshes[0].primitives[0];
        assert_eq!(primitive.triangles, [[2, 0, 1]]);
        assert_eq!(primitive.positions.iter().map(|position| position.x).collect::<Vec<_>>(), [3.0, 150.0, 297.0]);
    }

    #[test]
    fn triangles_and_vertices_are_limited() {
        let package = Builder::triangle().package();
        let code = |limits| import(&package, &limits).unwrap_err().code;
        assert_eq!(code(Limits { triangles: 0, ..Limits::default() }), "triangles");
        assert_eq!(code(Limits { vertices: 2, ..Limits::default() }), "vertices");
    }
}
