//! A small writer of binary glTF 2.0.

use super::shapes::Shape;
use glam::{Mat3, Quat, Vec3};
use serde_json::{Value, json};

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;

/// A glTF under construction. Everything that is added is given its index, as glTF counts it.
#[derive(Default)]
pub struct Glb {
    nodes: Vec<Value>,
    /// Nodes of a second scene, which is not the default.
    elsewhere: Vec<usize>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    textures: Vec<Value>,
    images: Vec<Value>,
    cameras: Vec<Value>,
    lights: Vec<Value>,
    accessors: Vec<Value>,
    buffer_views: Vec<Value>,
    samplers: Vec<Value>,
    channels: Vec<Value>,
    binary: Vec<u8>,
    extensions: Vec<&'static str>,
}

/// Vertex and index data in the file, to be drawn with any material.
#[derive(Clone)]
pub struct Geometry(Value);

impl Geometry {
    /// Has the texture coordinates read a second time, as a second set.
    pub fn repeat_coordinates(&mut self) {
        self.0["attributes"]["TEXCOORD_1"] = self.0["attributes"]["TEXCOORD_0"].clone();
    }
}

impl Glb {
    /// An empty file.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a material, given as the glTF has it.
    pub fn material(&mut self, material: Value) -> usize {
        for extension in ["KHR_materials_emissive_strength", "KHR_materials_unlit"] {
            if material["extensions"].get(extension).is_some() {
                self.uses(extension);
            }
        }
        push(&mut self.materials, material)
    }

    /// Adds a texture (repeating, bilinear) from the bytes of a PNG.
    pub fn texture(&mut self, png: &[u8]) -> usize {
        let view = self.view(png, None);
        let source = push(&mut self.images, json!({"bufferView": view, "mimeType": "image/png"}));
        push(&mut self.textures, json!({"source": source}))
    }

    /// Adds vertices and triangles.
    pub fn geometry(&mut self, shape: &Shape) -> Geometry {
        let (min, max) = shape.bounds();
        let positions = self.vectors(&shape.positions, "VEC3");
        self.accessors[positions]["min"] = json!(min.to_array());
        self.accessors[positions]["max"] = json!(max.to_array());
        let mut attributes = json!({"POSITION": positions, "NORMAL": self.vectors(&shape.normals, "VEC3")});
        if !shape.uvs.is_empty() {
            attributes["TEXCOORD_0"] = json!(self.vectors(&shape.uvs, "VEC2"));
        }
        if !shape.colors.is_empty() {
            attributes["COLOR_0"] = json!(self.vectors(&shape.colors, "VEC4"));
        }
        Geometry(json!({"attributes": attributes, "indices": self.indices(shape)}))
    }

    /// Adds a mesh of one primitive.
    pub fn mesh(&mut self, geometry: &Geometry, material: usize) -> usize {
        let mut primitive = geometry.0.clone();
        primitive["material"] = json!(material);
        push(&mut self.meshes, json!({"primitives": [primitive]}))
    }

    /// Adds a root node that shows a mesh; `placement` has the other properties of the node.
    pub fn place(&mut self, mesh: usize, placement: Value) {
        self.node("mesh", json!(mesh), placement);
    }

    /// Adds a root node that shows a mesh in a second scene of the file.
    pub fn place_elsewhere(&mut self, mesh: usize, placement: Value) {
        self.elsewhere.push(self.nodes.len());
        self.place(mesh, placement);
    }

    /// Adds a shape with a material of its own, where it is.
    pub fn show(&mut self, shape: &Shape, material: Value) {
        let geometry = self.geometry(shape);
        let material = self.material(material);
        let mesh = self.mesh(&geometry, material);
        self.place(mesh, json!({}));
    }

    /// Adds a perspective camera.
    pub fn camera(&mut self, name: &str, eye: Vec3, target: Vec3, yfov_degrees: f32) {
        let lens = json!({"yfov": yfov_degrees.to_radians(), "znear": 0.01});
        let camera = push(&mut self.cameras, json!({"name": name, "type": "perspective", "perspective": lens}));
        let rotation = looking(target - eye).to_array();
        self.node("camera", json!(camera), json!({"name": name, "translation": eye.to_array(), "rotation": rotation}));
    }

    /// Adds a light of KHR_lights_punctual at a place, shining in a direction.
    pub fn light(&mut self, light: Value, position: Vec3, direction: Vec3) {
        self.uses("KHR_lights_punctual");
        let light = push(&mut self.lights, light);
        let rotation = looking(direction).to_array();
        let extension = json!({"KHR_lights_punctual": {"light": light}});
        self.node("extensions", extension, json!({"translation": position.to_array(), "rotation": rotation}));
    }

    /// Lets the root node that was added last follow the straight line between keys, in the file's one animation; `path` as glTF
    /// names it, `values` of `kind` one for each time.
    pub fn animate<T: bytemuck::NoUninit>(&mut self, path: &str, times: &[f32], kind: &str, values: &[T]) {
        let input = self.vectors(times, "SCALAR");
        self.accessors[input]["min"] = json!([times.iter().copied().fold(f32::INFINITY, f32::min)]);
        self.accessors[input]["max"] = json!([times.iter().copied().fold(f32::NEG_INFINITY, f32::max)]);
        let output = self.vectors(values, kind);
        let sampler = push(&mut self.samplers, json!({"input": input, "output": output}));
        let node = self.nodes.len().saturating_sub(1);
        self.channels.push(json!({"sampler": sampler, "target": {"node": node, "path": path}}));
    }

    /// States an extension that a material or texture reference uses.
    pub fn uses(&mut self, extension: &'static str) {
        if !self.extensions.contains(&extension) {
            self.extensions.push(extension);
        }
    }

    /// The bytes of the file.
    pub fn finish(mut self) -> Vec<u8> {
        pad(&mut self.binary, 0);
        let (elsewhere, roots): (Vec<usize>, Vec<usize>) =
            (0..self.nodes.len()).partition(|node| self.elsewhere.contains(node));
        let mut scenes = vec![json!({"nodes": roots})];
        if !elsewhere.is_empty() {
            scenes.push(json!({"nodes": elsewhere}));
        }
        let mut gltf = json!({
            "asset": {"version": "2.0", "generator": "Candela"},
            "scene": 0,
            "scenes": scenes,
            "buffers": [{"byteLength": self.binary.len()}],
        });
        if !self.lights.is_empty() {
            gltf["extensions"] = json!({"KHR_lights_punctual": {"lights": self.lights}});
        }
        if !self.channels.is_empty() {
            gltf["animations"] = json!([{"name": "motion", "samplers": self.samplers, "channels": self.channels}]);
        }
        for (name, list) in [
            ("nodes", self.nodes),
            ("meshes", self.meshes),
            ("materials", self.materials),
            ("textures", self.textures),
            ("images", self.images),
            ("cameras", self.cameras),
            ("accessors", self.accessors),
            ("bufferViews", self.buffer_views),
            ("extensionsUsed", self.extensions.into_iter().map(Value::from).collect()),
        ] {
            // glTF has no empty lists.
            if !list.is_empty() {
                gltf[name] = Value::Array(list);
            }
        }
        container(gltf.to_string().into_bytes(), &self.binary)
    }

    fn node(&mut self, property: &str, value: Value, mut node: Value) {
        node[property] = value;
        self.nodes.push(node);
    }

    fn vectors<T: bytemuck::NoUninit>(&mut self, values: &[T], kind: &str) -> usize {
        let view = self.view(bytemuck::cast_slice(values), Some(ARRAY_BUFFER));
        let accessor = json!({"bufferView": view, "componentType": FLOAT, "count": values.len(), "type": kind});
        push(&mut self.accessors, accessor)
    }

    fn indices(&mut self, shape: &Shape) -> usize {
        let long = shape.triangles.as_flattened();
        let short: Option<Vec<u16>> =
            long.iter().map(|&index| u16::try_from(index).ok().filter(|&index| index < u16::MAX)).collect();
        let (view, component) = match &short {
            Some(short) => (self.view(bytemuck::cast_slice(short), Some(ELEMENT_ARRAY_BUFFER)), UNSIGNED_SHORT),
            None => (self.view(bytemuck::cast_slice(long), Some(ELEMENT_ARRAY_BUFFER)), UNSIGNED_INT),
        };
        let accessor = json!({"bufferView": view, "componentType": component, "count": long.len(), "type": "SCALAR"});
        push(&mut self.accessors, accessor)
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        pad(&mut self.binary, 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.binary.extend_from_slice(bytes);
        push(&mut self.buffer_views, view)
    }
}

fn push(list: &mut Vec<Value>, value: Value) -> usize {
    list.push(value);
    list.len() - 1
}

/// Rotation that turns -Z to a direction, +Y staying as far up as it can.
fn looking(direction: Vec3) -> Quat {
    let back = -direction.normalize_or(Vec3::NEG_Z);
    let right = Vec3::Y.cross(back).try_normalize().unwrap_or(Vec3::X);
    Quat::from_mat3(&Mat3::from_cols(right, back.cross(right), back))
}

/// GLB container, version 2: header, JSON chunk, binary chunk.
fn container(mut json: Vec<u8>, binary: &[u8]) -> Vec<u8> {
    pad(&mut json, b' ');
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let mut bytes = Vec::with_capacity(total);
    bytes.extend_from_slice(b"glTF");
    for word in [2, total as u32, json.len() as u32] {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    bytes.extend_from_slice(b"JSON");
    bytes.extend_from_slice(&json);
    bytes.extend_from_slice(&(binary.len() as u32).to_le_bytes());
    bytes.extend_from_slice(b"BIN\0");
    bytes.extend_from_slice(binary);
    bytes
}

fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), with);
}
