//! What a client is told of a scene or an image.

use super::scenes::{ImageContent, StoredImage, StoredScene};
use crate::scene;
use serde_json::{Value, json};

impl StoredScene {
    /// The scene as JSON: what is in the file, how extensions are honoured, what the picture will lack.
    pub fn describe(&self) -> Value {
        let mut value = json!(scene::describe(&self.scene));
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
            "width": self.size.0,
            "height": self.size.1,
            "kind": match self.content {
                ImageContent::Environment(_) => "environment",
                ImageContent::Map(_) => "map",
                ImageContent::Profile(_) => "profile",
            },
        })
    }
}
