//! Scenes and images that the server keeps, each imported once, compiled or decoded once.

use super::store::Stored;
use crate::compile::{self, CompileError, CompiledScene, Hdri, MapFiles};
use crate::params::RenderParams;
use crate::scene::Scene;
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fmt::Write;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Id of a file: a hash of its bytes.
pub fn content_id(bytes: &[u8]) -> String {
    format!("sha256-{}", hex(&Sha256::digest(bytes)))
}

/// Lower-case hexadecimal digits.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(bytes.len() * 2), |mut text, byte| {
        // Writing to a String cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// What is compiled of a file for one request; locked while it is being made, so that the next caller waits for it.
type Slot = Arc<Mutex<Option<Arc<CompiledScene>>>>;

/// What a compiled form depends on besides the file: index of the scene, name of the variant, and the request's spheres and
/// overrides as JSON, if there are any.
type Key = (usize, Option<String>, Option<String>);

/// An imported scene and what has been compiled of it.
#[derive(Debug)]
pub struct StoredScene {
    /// `sha256-...`
    pub id: String,
    /// The scene.
    pub scene: Arc<Scene>,
    /// Bytes of the upload.
    pub upload_bytes: u64,
    scene_bytes: u64,
    compiled: Mutex<HashMap<Key, Slot>>,
}

impl StoredScene {
    /// A scene of which nothing has been compiled.
    pub fn new(id: String, scene: Scene, upload_bytes: u64) -> Self {
        let scene_bytes = scene_bytes(&scene);
        Self { id, scene: Arc::new(scene), upload_bytes, scene_bytes, compiled: Mutex::default() }
    }

    /// Whether [`Self::compile`] would return at once.
    pub fn is_compiled(&self, params: &RenderParams) -> bool {
        self.slots().get(&self.key(params)).and_then(ready).is_some()
    }

    /// What a request shows of the file. Blocks; of several callers one compiles and the others wait.
    pub fn compile(&self, params: &RenderParams, maps: &MapFiles) -> Result<Arc<CompiledScene>, CompileError> {
        let compile = || compile::compile_request(&self.scene, params, maps).map(Arc::new);
        let no_scene = params.scene.is_some_and(|index| index >= self.scene.scenes.len());
        let no_variant = |name: &String| !self.scene.variants.contains(name);
        if no_scene || params.variant.as_ref().is_some_and(no_variant) {
            // Not kept: the client could name any number of such scenes.
            return compile();
        }
        let slot = self.slot(self.key(params));
        let mut compiled = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(compiled) = compiled.as_ref() {
            return Ok(Arc::clone(compiled));
        }
        Ok(Arc::clone(compiled.insert(compile()?)))
    }

    /// The slot of a key. Of requests with spheres or overrides, which can be any number, the last one's alone is kept.
    fn slot(&self, key: Key) -> Slot {
        let mut slots = self.slots();
        if key.2.is_some() {
            slots.retain(|known, _| known.2.is_none() || *known == key);
        }
        Arc::clone(slots.entry(key).or_default())
    }

    fn key(&self, params: &RenderParams) -> Key {
        let changed = !params.spheres.is_empty() || !params.overrides.is_empty();
        let changes = changed.then(|| serde_json::json!([params.spheres, params.overrides]).to_string());
        (params.scene.or(self.scene.default_scene).unwrap_or(0), params.variant.clone(), changes)
    }

    fn slots(&self) -> MutexGuard<'_, HashMap<Key, Slot>> {
        self.compiled.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stored for StoredScene {
    fn id(&self) -> &str {
        &self.id
    }

    fn bytes(&self) -> u64 {
        let compiled = self.slots().values().filter_map(ready).map(|scene| compiled_bytes(&scene)).sum::<u64>();
        self.scene_bytes + compiled
    }
}

/// A picture that parameters name.
#[derive(Debug)]
pub struct StoredImage {
    /// `sha256-...`
    pub id: String,
    /// Bytes of the upload.
    pub upload_bytes: u64,
    /// Pixels across and down.
    pub size: (u32, u32),
    /// What it can be used for.
    pub content: ImageContent,
}

/// What a picture can be used for.
#[derive(Debug, Clone)]
pub enum ImageContent {
    /// An environment: texels and sampling table.
    Environment(Arc<Hdri>),
    /// A map of a surface, as it was uploaded.
    Map(Arc<[u8]>),
}

impl StoredImage {
    /// The environment, if it is one.
    pub fn environment(&self) -> Option<Arc<Hdri>> {
        match &self.content {
            ImageContent::Environment(hdri) => Some(Arc::clone(hdri)),
            ImageContent::Map(_) => None,
        }
    }

    /// The map, if it is one.
    pub fn map(&self) -> Option<Arc<[u8]>> {
        match &self.content {
            ImageContent::Map(bytes) => Some(Arc::clone(bytes)),
            ImageContent::Environment(_) => None,
        }
    }
}

impl Stored for StoredImage {
    fn id(&self) -> &str {
        &self.id
    }

    fn bytes(&self) -> u64 {
        let bytes = match &self.content {
            ImageContent::Environment(hdri) => size_of_val(hdri.texels.as_slice()) + size_of_val(hdri.cells.as_slice()),
            ImageContent::Map(bytes) => bytes.len(),
        };
        bytes as u64
    }
}

/// What a slot holds, if nobody is at work on it.
fn ready(slot: &Slot) -> Option<Arc<CompiledScene>> {
    slot.try_lock().ok()?.clone()
}

/// Memory of a scene: meshes and encoded images.
fn scene_bytes(scene: &Scene) -> u64 {
    let primitives = scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let primitives = primitives.flat_map(|p| p.alternatives.iter().map(|(_, other)| other).chain([p]));
    let meshes: usize = primitives
        .map(|p| {
            let optional = p.normals.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
                + p.tangents.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
                + p.colors.as_ref().map_or(0, |v| size_of_val(v.as_slice()));
            let uvs: usize = p.uvs.iter().map(|set| size_of_val(set.as_slice())).sum();
            size_of_val(p.positions.as_slice()) + size_of_val(p.triangles.as_slice()) + optional + uvs
        })
        .sum();
    let images: usize = scene.images.iter().map(|image| image.bytes.len()).sum();
    (meshes + images + scene.nodes.len() * 256) as u64
}

/// Memory of a compiled scene.
pub fn compiled_bytes(scene: &CompiledScene) -> u64 {
    let pages = scene.color_pages.pages.iter().chain(&scene.data_pages.pages).map(Vec::len).sum::<usize>();
    let bytes = size_of_val(scene.nodes.as_slice())
        + size_of_val(scene.triangles.as_slice())
        + size_of_val(scene.indices.as_slice())
        + size_of_val(scene.vertices.as_slice())
        + size_of_val(scene.instances.as_slice())
        + size_of_val(scene.materials.as_slice())
        + size_of_val(scene.extended.as_slice())
        + size_of_val(scene.details.as_slice())
        + size_of_val(scene.emitters.as_slice())
        + pages;
    bytes as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_id_is_the_hash() {
        let id = content_id(b"abc");
        assert_eq!(id, "sha256-ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
