//! A small valid scene, and damage done to it at random (from a fixed seed): in its JSON values, and in its bytes.

use serde_json::{Value, json};

/// SplitMix64 (Steele, Lea, Flood 2014).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^ (x >> 31)
    }

    pub fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound.max(1) as u64) as usize
    }
}

/// Few triangles and a little of everything: all modes, sparse and quantised data, a skin, an animation, morph
/// targets, lights, cameras, textures with transforms, several scenes.
fn seed() -> (Value, Vec<u8>) {
    let mut bin = Vec::new();
    let mut float = |values: &[f32]| {
        let offset = bin.len();
        bin.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        offset
    };
    float(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]); // 0: four positions
    float(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]); // 48: normals
    float(&[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]); // 96: texture coordinates
    float(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]); // 128: colours, weights, or a matrix
    bin.extend([0_u8, 1, 2, 0, 2, 3, 1, 0]); // 192: indices
    bin.extend([3_u8, 0, 0, 0]); // 200: sparse indices
    bin.extend([0_u8; 16]); // 204: joints
    let png = bin.len();
    let pixels = image::RgbImage::from_pixel(2, 2, image::Rgb([9, 9, 9]));
    let mut encoded = std::io::Cursor::new(Vec::new());
    pixels.write_to(&mut encoded, image::ImageFormat::Png).expect("a PNG can be written");
    bin.extend(encoded.into_inner());
    let accessor = |offset: u64, component: u64, count: u64, kind: &str| json!({"bufferView": 0, "byteOffset": offset, "componentType": component, "count": count, "type": kind});
    let mut sparse = accessor(0, 5126, 4, "VEC3");
    sparse["sparse"] =
        json!({"count": 1, "indices": {"bufferView": 1, "componentType": 5121}, "values": {"bufferView": 0}});
    let mut quantised = accessor(192, 5121, 4, "VEC2");
    quantised["normalized"] = json!(true);
    let attributes = json!({"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "TEXCOORD_1": 6, "COLOR_0": 3, "JOINTS_0": 11, "WEIGHTS_0": 3});
    let transform =
        json!({"KHR_texture_transform": {"offset": [0.5, 0], "rotation": 1, "scale": [2, 2], "texCoord": 1}});
    let json = json!({
        "asset": {"version": "2.0", "minVersion": "2.0"},
        "extensionsUsed": ["KHR_lights_punctual", "KHR_texture_transform", "KHR_materials_emissive_strength", "KHR_materials_variants", "EXT_mesh_gpu_instancing"],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "extensions": {
            "KHR_lights_punctual": {"lights": [{"type": "spot", "intensity": 2, "color": [1, 1, 1], "range": 3, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}}]},
            "KHR_materials_variants": {"variants": [{"name": "a"}]},
        },
        "buffers": [{"byteLength": bin.len()}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 220}, {"buffer": 0, "byteOffset": 200, "byteLength": 4},
            {"buffer": 0, "byteOffset": png, "byteLength": bin.len() - png}, {"buffer": 0, "byteLength": 48, "byteStride": 12},
        ],
        "accessors": [
            accessor(0, 5126, 4, "VEC3"), accessor(48, 5126, 4, "VEC3"), accessor(96, 5126, 4, "VEC2"), accessor(128, 5126, 4, "VEC4"),
            accessor(192, 5121, 6, "SCALAR"), sparse, quantised, accessor(128, 5126, 1, "MAT4"), accessor(96, 5126, 2, "SCALAR"),
            accessor(0, 5126, 2, "VEC3"), {"bufferView": 3, "componentType": 5126, "count": 4, "type": "VEC3"},
            accessor(204, 5121, 4, "VEC4"),
        ],
        "images": [{"bufferView": 2, "mimeType": "image/png"}, {"uri": "data:image/png;base64,AAAA"}],
        "samplers": [{"magFilter": 9728, "wrapS": 33071, "wrapT": 33648}],
        "textures": [{"source": 0, "sampler": 0}, {"source": 1}],
        "materials": [
            {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": transform}, "baseColorFactor": [1, 1, 1, 0.5]},
             "normalTexture": {"index": 0, "scale": 2}, "emissiveFactor": [1, 0, 0], "alphaMode": "MASK", "alphaCutoff": 0.25,
             "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3}}},
            {"doubleSided": true, "extensions": {"KHR_materials_unlit": {}}},
        ],
        "meshes": [
            {"primitives": [{"attributes": attributes, "indices": 4, "material": 0, "targets": [{"NORMAL": 1}]},
                            {"attributes": {"POSITION": 5, "TEXCOORD_0": 2}, "mode": 5, "material": 0, "targets": [{"POSITION": 10}]}], "weights": [0.5]},
            {"primitives": [{"attributes": {"POSITION": 10}, "mode": 6, "indices": 4, "material": 1}, {"attributes": {"POSITION": 0}, "mode": 0}]},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}, {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1}}],
        "nodes": [
            {"children": [1, 2], "translation": [1, 2, 3], "rotation": [0, 0, 0, 1], "scale": [1, -1, 1]},
            {"mesh": 0, "skin": 0, "camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"mesh": 1, "camera": 1, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
             "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 9}}}},
        ],
        "skins": [{"joints": [1], "inverseBindMatrices": 7, "skeleton": 0}],
        "animations": [{"samplers": [{"input": 8, "output": 9}, {"input": 8, "output": 8}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "scale"}}, {"sampler": 1, "target": {"node": 1, "path": "weights"}}]}],
        "scenes": [{"nodes": [0]}, {}],
        "scene": 0,
    });
    (json, bin)
}

/// A GLB of both.
pub fn glb(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, content) in [(b"JSON", json), (b"BIN\0", bin)] {
        bytes.extend((content.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(content);
    }
    bytes
}

/// All places of a JSON value, as pointers.
fn places(value: &Value, at: &str, found: &mut Vec<String>) {
    found.push(at.to_owned());
    match value {
        Value::Array(items) => items.iter().enumerate().for_each(|(i, item)| places(item, &format!("{at}/{i}"), found)),
        Value::Object(items) => items.iter().for_each(|(key, item)| places(item, &format!("{at}/{key}"), found)),
        _ => {}
    }
}

fn odd_value(random: &mut Random, old: &Value) -> Value {
    let number = old.as_f64().unwrap_or(1.0).clamp(-1e9, 1e9);
    let choices = [
        json!(null),
        json!(true),
        json!("x"),
        json!([]),
        json!({}),
        json!(0),
        json!(1),
        json!(2),
        json!(3),
        json!(-1),
        json!(0.5),
        json!(1e30),
        json!(1e300),
        json!(-1e-40),
        json!(u32::MAX),
        json!(u64::MAX),
        json!(i64::MIN),
        json!(1e15 as u64),
        json!(number + 1.0),
        json!(number as i64 + 1),
        json!(number as i64 - 1),
        json!(number as i64 * 2),
        json!(5120),
        json!(5123),
        json!(5125),
        json!("VEC2"),
        json!("MAT4"),
        json!("SCALAR"),
        json!([0, 0, 0]),
        json!([1e30, 1e-30, -1e30]),
        json!([0, 0, 0, 0]),
    ];
    choices[random.below(choices.len())].clone()
}

/// The scene, and its JSON and data apart.
pub struct Victim {
    json: Value,
    bin: Vec<u8>,
    places: Vec<String>,
}

impl Victim {
    pub fn new() -> Self {
        let (json, bin) = seed();
        let mut found = Vec::new();
        places(&json, "", &mut found);
        Self { json, bin, places: found }
    }

    /// As it was.
    pub fn whole(&self) -> Vec<u8> {
        glb(self.json.to_string().as_bytes(), &self.bin)
    }

    /// With other values in one or two places of its JSON.
    pub fn with_odd_values(&self, random: &mut Random) -> Vec<u8> {
        let mut json = self.json.clone();
        for _ in 0..=random.below(2) {
            let pointer = &self.places[random.below(self.places.len())];
            if let Some(value) = json.pointer_mut(pointer).filter(|_| !pointer.is_empty()) {
                *value = odd_value(random, value);
            }
        }
        glb(json.to_string().as_bytes(), &self.bin)
    }

    /// With other bytes: in the header and the JSON, in the data, or anywhere.
    pub fn with_odd_bytes(&self, random: &mut Random) -> Vec<u8> {
        let mut bytes = self.whole();
        let data = bytes.len() - self.bin.len();
        let (from, to) = [(0, bytes.len()), (data, bytes.len()), (0, 24)][random.below(3)];
        for _ in 0..=random.below(8) {
            let at = from + random.below(to - from);
            match random.below(4) {
                0 => bytes[at] = 0xff,
                1 => bytes[at] ^= 1 << random.below(8),
                _ => bytes[at] = random.next() as u8,
            }
        }
        if random.below(20) == 0 {
            bytes.truncate(random.below(bytes.len()));
        }
        bytes
    }
}
