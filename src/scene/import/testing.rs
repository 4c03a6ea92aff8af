//! Small glTFs built in tests.

use super::budget::Budget;
use super::data::Data;
use super::{document, import};
use crate::scene::{Limits, Package, Scene, SceneError};
use serde_json::{Value, json};

/// A PNG of 2 x 1 pixels.
pub(in crate::scene) const PNG: &[u8] =
    b"\x89\x50\x4e\x47\x0d\x0a\x1a\x0a\x00\x00\x00\x0d\x49\x48\x44\x52\x00\x00\x00\x02\x00\x00\x00\x01\x08\x00\x00\x00\
    \x00\xd1\x49\x20\x56\x00\x00\x00\x0b\x49\x44\x41\x54\x78\x9c\x63\x60\xf8\x0f\x00\x01\x02\x01\x00\x42\xbe\xbc\x68\
    \x00\x00\x00\x00\x49\x45\x4e\x44\xae\x42\x60\x82";

/// A GLB of any chunks, with a correct header.
pub(in crate::scene) fn glb(chunks: &[(u32, &[u8])]) -> Vec<u8> {
    let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, content) in chunks {
        bytes.extend((content.len() as u32).to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(*content);
    }
    let length = bytes.len() as u32;
    bytes[8..12].copy_from_slice(&length.to_le_bytes());
    bytes
}

/// A package of JSON text, `asset` being added.
pub(in crate::scene) fn gltf(mut json: Value) -> Package {
    json["asset"] = json!({"version": "2.0"});
    Package::from_bytes(json.to_string().into_bytes(), &Limits::default()).unwrap()
}

pub(in crate::scene) fn scene(package: &Package) -> Scene {
    import(package, &Limits::default()).unwrap()
}

pub(in crate::scene) fn error(package: &Package) -> SceneError {
    import(package, &Limits::default()).expect_err("the file should be refused")
}

pub(in crate::scene) fn scene_of(builder: &Builder) -> Scene {
    scene(&builder.package())
}

pub(in crate::scene) fn error_of(builder: &Builder) -> SceneError {
    error(&builder.package())
}

/// A glTF with one buffer, which becomes the BIN chunk of a GLB.
#[derive(Clone)]
pub(in crate::scene) struct Builder {
    pub json: Value,
    /// Buffers beside the first, which is the BIN chunk.
    pub extra_buffers: Vec<Value>,
    bin: Vec<u8>,
}

impl Default for Builder {
    fn default() -> Self {
        Self {
            json: json!({"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}),
            extra_buffers: Vec::new(),
            bin: Vec::new(),
        }
    }
}

impl Builder {
    /// One mesh of the triangle (0, 0, 0), (1, 0, 0), (0, 1, 0), shown by node 0.
    pub(in crate::scene) fn triangle() -> Self {
        let mut builder = Self::default();
        builder.accessor(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], "VEC3");
        builder.show(&json!([{"attributes": {"POSITION": 0}}]));
        builder
    }

    /// A mesh of these primitives, a node and a scene for it.
    pub(in crate::scene) fn show(&mut self, primitives: &Value) {
        self.json["meshes"] = json!([{ "primitives": primitives }]);
        self.json["nodes"] = json!([{"mesh": 0}]);
        self.json["scenes"] = json!([{"nodes": [0]}]);
    }

    /// Appends a buffer view; its index.
    pub(in crate::scene) fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        self.bin.extend(bytes);
        push(&mut self.json["bufferViews"], view)
    }

    /// Appends an accessor of floats; its index.
    pub(in crate::scene) fn accessor(&mut self, values: &[f32], kind: &str) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let rows = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let accessor = json!({"bufferView": view, "componentType": 5126, "count": values.len() / rows, "type": kind});
        push(&mut self.json["accessors"], accessor)
    }

    /// Appends an accessor of byte-sized indices; its index.
    pub(in crate::scene) fn indices(&mut self, indices: &[u8]) -> usize {
        let view = self.view(indices);
        let accessor = json!({"bufferView": view, "componentType": 5121, "count": indices.len(), "type": "SCALAR"});
        push(&mut self.json["accessors"], accessor)
    }

    /// Adds an attribute to the first primitive.
    pub(in crate::scene) fn attribute(&mut self, name: &str, values: &[f32], kind: &str) {
        let accessor = self.accessor(values, kind);
        self.json["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
    }

    /// As a GLB.
    pub(in crate::scene) fn package(&self) -> Package {
        let json = self.with_buffers();
        let bytes = glb(&[(0x4E4F_534A, json.to_string().as_bytes()), (0x004E_4942, &self.bin)]);
        Package::from_bytes(bytes, &Limits::default()).unwrap()
    }

    /// Calls `read` with the data of the file.
    pub(super) fn with_data<T>(&self, read: impl FnOnce(&Data<'_>) -> Result<T, SceneError>) -> Result<T, SceneError> {
        let root = document::parse(self.with_buffers().to_string().as_bytes(), &Limits::default())?;
        let package = self.package();
        let mut budget = Budget::new(&Limits::default(), package.bytes());
        let data = Data::new(&root, &package, Some(&self.bin), &Limits::default(), &mut budget)?;
        read(&data)
    }

    fn with_buffers(&self) -> Value {
        let mut json = self.json.clone();
        let buffers = [json!({"byteLength": self.bin.len()})].into_iter().chain(self.extra_buffers.iter().cloned());
        json["buffers"] = buffers.collect();
        json
    }

    /// The first buffer.
    pub(in crate::scene) fn bin_mut(&mut self) -> &mut Vec<u8> {
        &mut self.bin
    }
}

/// A triangle with texture coordinates in sets 0 and 3, normals and tangents.
pub(in crate::scene) fn full() -> Builder {
    let mut builder = Builder::triangle();
    builder.attribute("TEXCOORD_0", &[0.0, 1.0, 1.0, 1.0, 0.0, 0.0], "VEC2");
    builder.attribute("TEXCOORD_3", &[0.5; 6], "VEC2");
    builder.attribute("NORMAL", &[0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], "VEC3");
    builder.attribute("TANGENT", &[0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0], "VEC4");
    builder
}

pub(in crate::scene) fn with_material(mut builder: Builder, material: &Value) -> Builder {
    builder.json["materials"] = json!([material]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let view = builder.view(PNG);
    builder.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    builder.json["textures"] = json!([{"source": 0}]);
    builder
}

fn push(array: &mut Value, item: Value) -> usize {
    let array = array.as_array_mut().unwrap();
    array.push(item);
    array.len() - 1
}
