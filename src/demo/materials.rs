//! Materials as glTF has them.

use serde_json::{Value, json};

/// A surface of one linear colour.
pub fn surface(color: [f32; 3], metallic: f32, roughness: f32) -> Value {
    let [r, g, b] = color;
    json!({"pbrMetallicRoughness":
        {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness}})
}

/// The same with a name.
pub fn named(name: &str, mut material: Value) -> Value {
    material["name"] = json!(name);
    material
}

/// A surface with a base colour texture.
pub fn textured(texture: usize, metallic: f32, roughness: f32) -> Value {
    let color = json!({"index": texture});
    json!({"pbrMetallicRoughness":
        {"baseColorTexture": color, "metallicFactor": metallic, "roughnessFactor": roughness}})
}

/// A black surface that emits `strength * color` to its front.
pub fn lamp(color: [f32; 3], strength: f32) -> Value {
    json!({
        "pbrMetallicRoughness": {"baseColorFactor": [0.0, 0.0, 0.0, 1.0], "metallicFactor": 0.0},
        "emissiveFactor": color,
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength}},
    })
}
