//! KHR_draco_mesh_compression: the stream of a primitive -> the bytes of its accessors.

use super::budget::Budget;
use super::data::Data;
use super::document;
use super::schema::{Accessor, Draco, Primitive};
use crate::scene::{Limits, SceneError};
use draco_core::{DecodeLimits, DecoderBuffer, FaceIndex, Mesh, MeshDecoder, PointAttribute};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

const NAME: &str = "KHR_draco_mesh_compression";

/// By index: the bytes of accessors that streams hold, elements side by side in the accessor's format.
pub(super) type Decoded = HashMap<usize, Vec<u8>>;

/// Decodes the streams of all primitives.
pub(super) fn decode(data: &Data<'_>, limits: &Limits, budget: &mut Budget) -> Result<Decoded, SceneError> {
    let mut decoded = Decoded::new();
    for (i, mesh) in data.root.meshes.iter().enumerate() {
        for (j, primitive) in mesh.primitives.iter().enumerate() {
            let Some(content) = primitive.extensions.get(NAME) else { continue };
            let place = format!("/meshes/{i}/primitives/{j}/extensions/{NAME}");
            let source: Draco = document::extension(content, &place)?;
            Stream { data, primitive, source, place }.decode(limits, budget, &mut decoded)?;
        }
    }
    Ok(decoded)
}

/// The stream of a primitive.
struct Stream<'a> {
    data: &'a Data<'a>,
    primitive: &'a Primitive,
    source: Draco,
    place: String,
}

impl Stream<'_> {
    fn decode(&self, limits: &Limits, budget: &mut Budget, decoded: &mut Decoded) -> Result<(), SceneError> {
        if self.primitive.mode != 4 {
            return Err(
                self.fault(&format!("mode {} with Draco is not supported; export triangles (4)", self.primitive.mode))
            );
        }
        let bytes = self.data.view(self.source.buffer_view)?;
        let limits = DecodeLimits::default()
            .with_max_points(limits.vertices as u64)
            .with_max_faces(limits.triangles as u64)
            .with_max_decoded_bytes(budget.left());
        let mesh = catch_unwind(AssertUnwindSafe(|| {
            let mut mesh = Mesh::new();
            let mut buffer = DecoderBuffer::new(bytes).with_limits(limits);
            MeshDecoder::new().decode(&mut buffer, &mut mesh).map(|()| mesh)
        }));
        let mesh = mesh.map_err(|_| self.fault("the decoder gave up"))?;
        let mesh = mesh.map_err(|error| self.fault(&error.to_string()))?;
        if let Some(indices) = self.primitive.indices {
            let accessor = self.accessor(indices, mesh.num_faces() * 3)?;
            budget.charge((mesh.num_faces() * size_of::<[u32; 3]>()) as u64, mesh.num_faces(), &self.place)?;
            decoded.insert(indices, self.indices(&mesh, accessor)?);
        }
        for (name, id) in &self.source.attributes {
            let missing = || self.fault(&format!("the primitive has no attribute {name}, though its stream has"));
            let index = *self.primitive.attributes.get(name).ok_or_else(missing)?;
            let accessor = self.accessor(index, mesh.num_points())?;
            let missing = || self.fault(&format!("the stream has no attribute with the id {id} ({name})"));
            let attribute = mesh.attribute_by_unique_id(*id).ok_or_else(missing)?;
            let rows = usize::from(attribute.num_components());
            budget.charge((mesh.num_points() * rows * size_of::<f32>()) as u64, mesh.num_points(), &self.place)?;
            decoded.insert(index, self.values(attribute, mesh.num_points(), name, accessor)?);
        }
        Ok(())
    }

    fn fault(&self, detail: &str) -> SceneError {
        SceneError::invalid("draco", self.place.clone(), format!("the Draco stream cannot be used: {detail}"))
    }

    /// The accessor that the stream fills, which must have as many elements.
    fn accessor(&self, index: usize, count: usize) -> Result<&Accessor, SceneError> {
        let missing = || super::data::missing(&self.place, "accessor", index);
        let accessor = self.data.root.accessors.get(index).ok_or_else(missing)?;
        if accessor.count == count as u64 {
            return Ok(accessor);
        }
        Err(self.fault(&format!("it has {count} elements, but accessor {index} has {}", accessor.count)))
    }

    fn indices(&self, mesh: &Mesh, accessor: &Accessor) -> Result<Vec<u8>, SceneError> {
        let corners = || (0..mesh.num_faces()).flat_map(|face| mesh.face(FaceIndex(face as u32))).map(|point| point.0);
        let highest = corners().max().unwrap_or(0);
        let fits = |most: u32| {
            let detail = || self.fault(&format!("index {highest} does not fit the type of the indices' accessor"));
            if highest <= most { Ok(()) } else { Err(detail()) }
        };
        match accessor.component_type {
            5121 => fits(u8::MAX.into()).map(|()| corners().map(|index| index as u8).collect()),
            5123 => fits(u16::MAX.into()).map(|()| corners().flat_map(|index| (index as u16).to_le_bytes()).collect()),
            _ => Ok(corners().flat_map(u32::to_le_bytes).collect()),
        }
    }

    /// The values of an attribute in the accessor's own type.
    fn values(
        &self,
        attribute: &PointAttribute,
        points: usize,
        name: &str,
        accessor: &Accessor,
    ) -> Result<Vec<u8>, SceneError> {
        let rows = usize::from(attribute.num_components());
        let expected = ["SCALAR", "VEC2", "VEC3", "VEC4"].iter().position(|kind| *kind == accessor.kind);
        if expected != rows.checked_sub(1) {
            return Err(self.fault(&format!("{name} has {rows} numbers, but its accessor is {}", accessor.kind)));
        }
        let values = attribute.read_f32s(points, rows);
        Ok(match accessor.component_type {
            5120 => values.iter().flat_map(|value| (*value as i8).to_le_bytes()).collect(),
            5121 => values.iter().flat_map(|value| (*value as u8).to_le_bytes()).collect(),
            5122 => values.iter().flat_map(|value| (*value as i16).to_le_bytes()).collect(),
            5123 => values.iter().flat_map(|value| (*value as u16).to_le_bytes()).collect(),
            5125 => values.iter().flat_map(|value| (*value as u32).to_le_bytes()).collect(),
            _ => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{Builder, error_of, scene_of};
    use draco_core::geometry_attribute::{GeometryAttributeType, PointAttribute};
    use draco_core::{DataType, EncoderBuffer, EncoderOptions, Mesh, MeshEncoder, PointIndex};
    use glam::Vec3;
    use serde_json::json;

    const POSITIONS: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.5];

    fn stream() -> Vec<u8> {
        let mut mesh = Mesh::new();
        let mut positions = PointAttribute::new();
        positions.init(GeometryAttributeType::Position, 3, DataType::Float32, false, 4);
        positions.buffer_mut().update_f32s_le(0, &POSITIONS);
        mesh.set_num_points(4);
        mesh.add_attribute(positions);
        for face in [[0, 1, 2], [2, 1, 3]] {
            mesh.add_face(face.map(PointIndex));
        }
        let (mut encoder, mut buffer, mut options) =
            (MeshEncoder::new(), EncoderBuffer::new(), EncoderOptions::default());
        options.set_attribute_int(0, "quantization_bits", 14);
        encoder.set_mesh(mesh);
        encoder.encode(&options, &mut buffer).unwrap();
        buffer.data().to_vec()
    }

    /// A square in a Draco stream.
    fn packed() -> Builder {
        let mut builder = Builder::default();
        let view = builder.view(&stream());
        builder.json["accessors"] = json!([
            {"componentType": 5126, "type": "VEC3", "count": 4}, {"componentType": 5121, "type": "SCALAR", "count": 6},
        ]);
        builder.json["extensionsRequired"] = json!([super::NAME]);
        let extension = json!({"bufferView": view, "attributes": {"POSITION": 0}});
        builder.show(&json!([{"attributes": {"POSITION": 0}, "indices": 1, "extensions": {super::NAME: extension}}]));
        builder
    }

    #[test]
    fn streams_fill_their_accessors() {
        let scene = scene_of(&packed());
        let primitive = &scene.meshes[0].primitives[0];
        let mut sorted: Vec<Vec3> = primitive.positions.clone();
        sorted.sort_by(|a, b| a.to_array().partial_cmp(&b.to_array()).unwrap());
        for (found, expected) in sorted.iter().zip([Vec3::ZERO, Vec3::Y, Vec3::X, Vec3::new(1.0, 1.0, 0.5)]) {
            assert!(found.abs_diff_eq(expected, 1e-4), "{found}");
        }
        for triangle in &primitive.triangles {
            let [a, b, c] = triangle.map(|vertex| primitive.positions[vertex as usize]);
            assert!((b - a).cross(c - a).z > 0.0);
        }
        assert_eq!((primitive.triangles.len(), scene.warnings.len()), (2, 0));
    }

    #[test]
    fn faults_are_named() {
        let place = format!("/meshes/0/primitives/0/extensions/{}", super::NAME);
        let fault = |edit: &dyn Fn(&mut Builder)| {
            let mut builder = packed();
            edit(&mut builder);
            let fault = error_of(&builder);
            (fault.code, fault.pointer)
        };
        let draco = ("draco", place.clone());
        let extension = |builder: &mut Builder, field: &str, value| {
            builder.json["meshes"][0]["primitives"][0]["extensions"][super::NAME][field] = value;
        };
        assert_eq!(fault(&|b| b.json["accessors"][0]["count"] = json!(5)), draco);
        assert_eq!(fault(&|b| b.json["accessors"][1]["count"] = json!(3)), draco);
        assert_eq!(fault(&|b| b.json["accessors"][0]["type"] = json!("VEC2")), draco);
        assert_eq!(fault(&|b| extension(b, "attributes", json!({"POSITION": 9}))), draco);
        assert_eq!(fault(&|b| extension(b, "attributes", json!({"NORMAL": 0}))), draco);
        assert_eq!(fault(&|b| b.json["meshes"][0]["primitives"][0]["mode"] = json!(5)), draco);
        assert_eq!(fault(&|b| extension(b, "bufferView", json!(3))).0, "reference");
        assert_eq!(fault(&|b| b.json["bufferViews"][0]["byteLength"] = json!(20)), draco);
    }

    #[test]
    fn broken_streams_never_panic() {
        let good = packed();
        for at in 0..good.clone().bin_mut().len() {
            for value in [0, 0x55, 0xff] {
                let mut broken = good.clone();
                broken.bin_mut()[at] = value;
                let _ = crate::scene::import(&broken.package(), &crate::scene::Limits::default());
            }
        }
    }
}
