//! Meshes: all are checked, those that are shown are decoded, with the attributes that their materials read.

use super::accessor::{Component, open};
use super::attributes;
use super::budget::Budget;
use super::data::Data;
use super::document;
use super::extensions;
use super::materials::ReadMaterial;
use super::schema::{self, VARIANTS, VariantMappings};
use super::triangles::{self, Mode};
use crate::scene::error::Warnings;
use crate::scene::{Limits, Mesh, Primitive, SceneError};
use glam::Vec3;
use std::collections::HashMap;

/// Checks every primitive of the file, indices included.
pub(super) fn check(data: &Data<'_>) -> Result<(), SceneError> {
    let quantized = extensions::declared(data.root, "KHR_mesh_quantization");
    let mut highest = HashMap::new();
    for (i, mesh) in data.root.meshes.iter().enumerate() {
        let targets = mesh.primitives.first().map_or(0, |primitive| primitive.targets.len());
        for (j, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("/meshes/{i}/primitives/{j}");
            if primitive.targets.len() != targets {
                let detail = format!(
                    "{} morph targets, but the mesh's first primitive has {targets}; all need the same number",
                    primitive.targets.len()
                );
                return Err(SceneError::invalid("morph_targets", format!("{place}/targets"), detail));
            }
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

/// What is read of a mesh.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Need {
    /// A node of a scene shows it.
    pub shown: bool,
    /// Such a node has a skin.
    pub skinned: bool,
    /// Such a node ever gives its morph targets a weight.
    pub morphed: bool,
}

/// Decodes meshes until the limits are reached.
pub(super) struct Decoder<'a> {
    pub data: &'a Data<'a>,
    pub materials: &'a [ReadMaterial],
    pub limits: &'a Limits,
    pub budget: &'a mut Budget,
    pub warnings: &'a mut Warnings,
    pub tally: Tally,
}

/// What has been decoded so far.
#[derive(Default)]
pub(super) struct Tally {
    triangles: usize,
    vertices: usize,
    /// Work done for tangents.
    pub tangent_pairs: u64,
}

/// A primitive of the file to be read.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub primitive: &'a schema::Primitive,
    pub need: Need,
    /// Its place in the file.
    pub place: &'a str,
    /// Vertices that its triangles refer to; none: all.
    pub selection: Option<&'a [u32]>,
}

/// Triangles, and the vertices that they refer to if not all.
type Faces = (Vec<[u32; 3]>, Option<Vec<u32>>);

impl Decoder<'_> {
    /// All meshes, as far as each is needed.
    pub(super) fn meshes(&mut self, needs: &[Need]) -> Result<Vec<Mesh>, SceneError> {
        let mut meshes = Vec::new();
        let root = self.data.root;
        for (i, source) in root.meshes.iter().enumerate() {
            let mut mesh = Mesh { name: source.name.clone(), primitives: Vec::new() };
            let need = needs.get(i).copied().unwrap_or_default();
            for (j, primitive) in source.primitives.iter().enumerate().filter(|_| need.shown) {
                let place = format!("/meshes/{i}/primitives/{j}");
                mesh.primitives.extend(self.variants(Source { primitive, need, place: &place, selection: None })?);
            }
            meshes.push(mesh);
        }
        Ok(meshes)
    }

    /// A primitive with what stands in its place in other variants.
    fn variants(&mut self, source: Source<'_>) -> Result<Option<Primitive>, SceneError> {
        let of_file = source.primitive;
        let Some(mut primitive) = self.primitive(source, of_file.material)? else { return Ok(None) };
        let Some(content) = of_file.extensions.get(VARIANTS) else { return Ok(Some(primitive)) };
        let mappings: VariantMappings =
            document::extension(content, &format!("{}/extensions/{VARIANTS}", source.place))?;
        for mapping in mappings.mappings {
            if Some(mapping.material) != of_file.material
                && let Some(alternative) = self.primitive(source, Some(mapping.material))?
            {
                primitive.alternatives.push((mapping.variants, alternative));
            }
        }
        Ok(Some(primitive))
    }

    fn primitive(
        &mut self,
        source: Source<'_>,
        material_index: Option<usize>,
    ) -> Result<Option<Primitive>, SceneError> {
        let place = source.place;
        let mode = match source.primitive.mode {
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
        let Some(positions) = source.primitive.attributes.get("POSITION") else {
            self.warnings.add("primitive_skipped", place, "the primitive has no POSITION and is not drawn");
            return Ok(None);
        };
        let count = open(self.data, *positions)?.count;
        let (triangles, selection) = self.triangles(source.primitive, mode, count, place)?;
        if triangles.is_empty() {
            return Ok(None);
        }
        let source = Source { selection: selection.as_deref(), ..source };
        let material = material_index.and_then(|index| self.materials.get(index));
        let positions: Vec<Vec3> = self.attribute(source, "POSITION")?.unwrap_or_default();
        let mut primitive = Primitive {
            normals: self.normals(source)?,
            colors: self.colors(source)?,
            uvs: self.uvs(source, material, positions.len())?,
            influences: self.influences(source)?,
            targets: self.targets(source)?,
            positions,
            triangles,
            material: material_index,
            ..Primitive::default()
        };
        self.tangents(source, material, &mut primitive)?;
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
        self.tally.triangles = self.tally.triangles.saturating_add(mode.triangles(count));
        if self.tally.triangles > self.limits.triangles {
            let detail =
                format!("with this primitive the scene has more triangles than the limit of {}", self.limits.triangles);
            return Err(SceneError::too_large("triangles", place, detail));
        }
        let pointer = indices.as_ref().map_or(place, |indices| &indices.pointer).to_owned();
        self.budget.charge((mode.triangles(count) * size_of::<[u32; 3]>()) as u64, count, &pointer)?;
        let indices = indices.map(|indices| indices.integers()).transpose()?;
        let mut triangles = triangles::list(mode, count, indices.as_deref());
        let selection = triangles::compact(&mut triangles, vertices);
        self.charge_vertices(selection.as_ref().map_or(vertices, Vec::len), place)?;
        Ok((triangles, selection))
    }

    pub(super) fn charge_vertices(&mut self, count: usize, place: &str) -> Result<(), SceneError> {
        self.tally.vertices = self.tally.vertices.saturating_add(count);
        if self.tally.vertices <= self.limits.vertices {
            return Ok(());
        }
        let detail =
            format!("with this primitive the scene has more vertices than the limit of {}", self.limits.vertices);
        Err(SceneError::too_large("vertices", place, detail))
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{Builder, PNG, error_of, full, scene_of, with_material};
    use crate::scene::{Limits, import};
    use serde_json::{Value, json};

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
