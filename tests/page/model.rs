//! A small model of two files, written for the test: a box that can turn, `box.gltf` and `box.bin`. It has a variant, and a second scene.

use serde_json::json;
use std::path::{Path, PathBuf};

/// Corners by the bits of their index: x, y, z.
const TRIANGLES: [[u16; 3]; 12] = [
    [0, 2, 3],
    [0, 3, 1],
    [4, 5, 7],
    [4, 7, 6],
    [0, 1, 5],
    [0, 5, 4],
    [2, 6, 7],
    [2, 7, 3],
    [0, 4, 6],
    [0, 6, 2],
    [1, 3, 7],
    [1, 7, 5],
];

/// Writes the model into a folder; answers the paths of the `.gltf` and the `.bin`.
pub fn write(folder: &Path) -> [PathBuf; 2] {
    let corner = |i: u8| [0, 1, 2].map(|bit| f32::from(i >> bit & 1) - 0.5);
    let positions = (0..8).flat_map(corner).flat_map(f32::to_le_bytes);
    let indices = TRIANGLES.into_iter().flatten().flat_map(u16::to_le_bytes);
    // Within a second an eighth of a turn about the vertical.
    let (sin, cos) = std::f32::consts::FRAC_PI_8.sin_cos();
    let keys = [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, sin, 0.0, cos];
    let bytes: Vec<u8> = positions.chain(indices).chain(keys.into_iter().flat_map(f32::to_le_bytes)).collect();
    let json = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }, { "nodes": [1], "name": "tower" }],
        "nodes": [{ "mesh": 0 }, { "mesh": 0, "translation": [9, 0, 0], "scale": [1, 3, 1] }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0 },
            "indices": 1,
            "material": 0,
            "extensions": { "KHR_materials_variants": { "mappings": [{ "material": 1, "variants": [0] }] } },
        }] }],
        "materials": [
            { "name": "paint", "pbrMetallicRoughness": { "baseColorFactor": [0.2, 0.4, 0.8, 1], "metallicFactor": 0 } },
            { "name": "rust", "pbrMetallicRoughness": { "baseColorFactor": [0.6, 0.2, 0.1, 1], "metallicFactor": 0 } },
        ],
        "extensionsUsed": ["KHR_materials_variants"],
        "extensions": { "KHR_materials_variants": { "variants": [{ "name": "rusty" }] } },
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3",
              "min": [-0.5, -0.5, -0.5], "max": [0.5, 0.5, 0.5] },
            { "bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR" },
            { "bufferView": 2, "componentType": 5126, "count": 2, "type": "SCALAR" },
            { "bufferView": 2, "byteOffset": 8, "componentType": 5126, "count": 2, "type": "VEC4" },
        ],
        "animations": [{
            "name": "turn",
            "samplers": [{ "input": 2, "output": 3 }],
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "rotation" } }],
        }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 96 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 72 },
            { "buffer": 0, "byteOffset": 168, "byteLength": 40 },
        ],
        "buffers": [{ "uri": "box.bin", "byteLength": bytes.len() }],
    });
    let paths = [folder.join("box.gltf"), folder.join("box.bin")];
    std::fs::write(&paths[0], json.to_string()).expect("the model is written");
    std::fs::write(&paths[1], bytes).expect("the model's buffer is written");
    paths
}
