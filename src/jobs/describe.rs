//! What a client is told of a scene or an image.

use super::scenes::{StoredImage, StoredScene};
use crate::compile::camera_nodes;
use crate::scene::{self, Projection, Scene};
use glam::DVec3;
use serde_json::{Value, json};

impl StoredScene {
    /// The scene as JSON: what is in the file, how extensions are honoured, what the picture will lack.
    pub fn describe(&self) -> Value {
        let mut value = json!(scene::describe(&self.scene));
        value["cameras"] = json!(cameras(&self.scene));
        value["id"] = json!(self.id);
        value["upload_bytes"] = json!(self.upload_bytes);
        value
    }
}

impl StoredImage {
    /// The image as JSON.
    pub fn describe(&self) -> Value {
        json!({
            "id": self.id,
            "upload_bytes": self.upload_bytes,
            "width": self.hdri.width,
            "height": self.hdri.height,
        })
    }
}

/// Cameras of the default scene as they are placed, in the order that `camera.index` counts.
fn cameras(scene: &Scene) -> Vec<Value> {
    let placed = camera_nodes(scene, None).unwrap_or_default();
    let cameras = placed.iter().enumerate().filter_map(|(index, placed)| {
        let node = scene.nodes.get(placed.node)?;
        let camera = scene.cameras.get(node.camera?)?;
        let (projection, lens) = match camera.projection {
            Projection::Perspective { yfov } => ("perspective", json!({ "yfov_degrees": yfov.to_degrees() })),
            Projection::Orthographic { ymag } => ("orthographic", json!({ "ymag": ymag })),
        };
        Some(json!({
            "index": index,
            "name": camera.name.as_ref().or(node.name.as_ref()),
            "projection": projection,
            "lens": lens,
            "position": placed.world.translation.to_array(),
            "direction": placed.world.transform_vector3(DVec3::NEG_Z).normalize_or_zero().to_array(),
        }))
    });
    cameras.collect()
}
