//! Scenes and images that the server keeps, each imported once, compiled or decoded once.

use super::store::Stored;
use crate::compile::{self, CompileError, CompiledScene, Hdri, MapFiles};
use crate::params::RenderParams;
use crate::scene::{Curve, Moment, Primitive, Profile, Scene};
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

/// What a compiled form depends on besides the file.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Key {
    /// Index of one of the file's scenes.
    scene: usize,
    /// Name of the variant.
    variant: Option<String>,
    /// The request's spheres and overrides as JSON, if there are any.
    changes: Option<String>,
    /// Animation and time (its bits), if that animation moves any mesh.
    moment: Option<(usize, u64)>,
    /// The shutter's opening, closing (their bits) and steps, where there is a moment.
    shutter: Option<(u64, u64, u32)>,
}

impl Key {
    /// Whether there is no end to the keys like it that clients could name.
    fn is_passing(&self) -> bool {
        self.changes.is_some() || self.moment.is_some()
    }
}

/// Passing forms of a scene that are kept, the latest used.
const MAX_PASSING: usize = 4;

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
    compiled: Mutex<Compiled>,
}

/// What has been compiled of a scene.
#[derive(Debug, Default)]
struct Compiled {
    slots: HashMap<Key, Slot>,
    /// Passing keys, the latest used at the end.
    passing: Vec<Key>,
}

impl Compiled {
    /// The slot of a key, which is made if need be. It may push out the passing form that was not used for the longest time.
    fn slot(&mut self, key: Key) -> Slot {
        if key.is_passing() {
            self.passing.retain(|known| *known != key);
            self.passing.push(key.clone());
            if self.passing.len() > MAX_PASSING {
                let oldest = self.passing.remove(0);
                self.slots.remove(&oldest);
            }
        }
        Arc::clone(self.slots.entry(key).or_default())
    }
}

impl StoredScene {
    /// A scene of which nothing has been compiled.
    pub fn new(id: String, scene: Scene, upload_bytes: u64) -> Self {
        let scene_bytes = scene_bytes(&scene);
        Self { id, scene: Arc::new(scene), upload_bytes, scene_bytes, compiled: Mutex::default() }
    }

    /// Whether [`Self::compile`] would return at once.
    pub fn is_compiled(&self, params: &RenderParams) -> bool {
        let moment = compile::moment(&self.scene, params);
        moment.is_ok_and(|moment| self.compiled().slots.get(&self.key(params, moment)).and_then(ready).is_some())
    }

    /// The scene at the moment that a request asks for, and the compiled form of what it shows. Blocks; of several callers
    /// one compiles and the others wait.
    pub fn compile(
        &self,
        params: &RenderParams,
        maps: &MapFiles,
    ) -> Result<(Arc<Scene>, Arc<CompiledScene>), CompileError> {
        let moment = compile::moment(&self.scene, params)?;
        let posed = if moment.is_some() { Arc::new(self.scene.at(moment)) } else { Arc::clone(&self.scene) };
        let compile = || compile::compile_request(&posed, params, maps).map(Arc::new);
        let no_scene = params.scene.is_some_and(|index| index >= self.scene.scenes.len());
        let no_variant = |name: &String| !self.scene.variants.contains(name);
        if no_scene || params.variant.as_ref().is_some_and(no_variant) {
            // Not kept: the client could name any number of such scenes.
            return compile().map(|compiled| (Arc::clone(&posed), compiled));
        }
        let slot = self.compiled().slot(self.key(params, moment));
        let mut compiled = slot.lock().unwrap_or_else(PoisonError::into_inner);
        let compiled = match compiled.as_ref() {
            Some(compiled) => Arc::clone(compiled),
            None => Arc::clone(compiled.insert(compile()?)),
        };
        Ok((posed, compiled))
    }

    fn key(&self, params: &RenderParams, moment: Option<Moment>) -> Key {
        let moves = |moment: &Moment| self.scene.animations.get(moment.animation).is_some_and(|a| a.moves_meshes);
        let moment = moment.filter(moves);
        let shutter = params.open_shutter().filter(|_| moment.is_some());
        let changed = !params.spheres.is_empty() || !params.overrides.is_empty();
        Key {
            changes: changed.then(|| serde_json::json!([params.spheres, params.overrides]).to_string()),
            scene: params.scene.or(self.scene.default_scene).unwrap_or(0),
            variant: params.variant.clone(),
            moment: moment.map(|moment| (moment.animation, moment.time.to_bits())),
            shutter: shutter.map(|shutter| (shutter.open.to_bits(), shutter.close.to_bits(), shutter.steps)),
        }
    }

    fn compiled(&self) -> MutexGuard<'_, Compiled> {
        self.compiled.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stored for StoredScene {
    fn id(&self) -> &str {
        &self.id
    }

    fn bytes(&self) -> u64 {
        let compiled =
            self.compiled().slots.values().filter_map(ready).map(|scene| compiled_bytes(&scene)).sum::<u64>();
        self.scene_bytes + compiled
    }
}

/// A file that parameters name, most often a picture.
#[derive(Debug)]
pub struct StoredImage {
    /// `sha256-...`
    pub id: String,
    /// Bytes of the upload.
    pub upload_bytes: u64,
    /// Pixels across and down; of a profile the angles around its pole and from it.
    pub size: (u32, u32),
    /// What it can be used for.
    pub content: ImageContent,
}

/// What such a file can be used for.
#[derive(Debug, Clone)]
pub enum ImageContent {
    /// An environment: texels and sampling table.
    Environment(Arc<Hdri>),
    /// A map of a surface, as it was uploaded.
    Map(Arc<[u8]>),
    /// The measured distribution of a luminaire.
    Profile(Arc<Profile>),
}

impl StoredImage {
    /// The environment, if it is one.
    pub fn environment(&self) -> Option<Arc<Hdri>> {
        match &self.content {
            ImageContent::Environment(hdri) => Some(Arc::clone(hdri)),
            ImageContent::Map(_) | ImageContent::Profile(_) => None,
        }
    }

    /// The map, if it is one.
    pub fn map(&self) -> Option<Arc<[u8]>> {
        match &self.content {
            ImageContent::Map(bytes) => Some(Arc::clone(bytes)),
            ImageContent::Environment(_) | ImageContent::Profile(_) => None,
        }
    }

    /// The profile, if it is one.
    pub fn profile(&self) -> Option<Arc<Profile>> {
        match &self.content {
            ImageContent::Profile(profile) => Some(Arc::clone(profile)),
            ImageContent::Environment(_) | ImageContent::Map(_) => None,
        }
    }
}

impl Stored for StoredImage {
    fn id(&self) -> &str {
        &self.id
    }

    fn bytes(&self) -> u64 {
        let bytes = match &self.content {
            ImageContent::Environment(hdri) => {
                let tables = size_of_val(hdri.cells.as_slice()) + size_of_val(hdri.tiles.as_slice());
                size_of_val(hdri.texels.as_slice()) + tables
            }
            ImageContent::Map(bytes) => bytes.len(),
            ImageContent::Profile(profile) => profile.bytes(),
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
    let meshes: usize = primitives.map(primitive_bytes).sum();
    let images: usize = scene.images.iter().map(|image| image.bytes.len()).sum();
    let curve = |curve: &Curve| size_of_val(curve.times.as_slice()) + size_of_val(curve.values.as_slice());
    let channels = scene.animations.iter().flat_map(|animation| &animation.channels);
    let curves: usize = channels.map(|channel| curve(&channel.curve)).sum();
    let instances: usize = scene.nodes.iter().flat_map(|node| &node.instances).map(|list| size_of_val(&list[..])).sum();
    (meshes + images + curves + instances + scene.nodes.len() * 256) as u64
}

fn primitive_bytes(p: &Primitive) -> usize {
    let optional = p.normals.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
        + p.tangents.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
        + p.colors.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
        + p.influences.as_ref().map_or(0, |i| size_of_val(i.joints.as_slice()) + size_of_val(i.weights.as_slice()));
    let uvs: usize = p.uvs.iter().map(|set| size_of_val(set.as_slice())).sum();
    let lists = p.targets.iter().flat_map(|target| [&target.positions, &target.normals, &target.tangents]);
    let targets: usize = lists.map(|list| size_of_val(list.as_slice())).sum();
    size_of_val(p.positions.as_slice()) + size_of_val(p.triangles.as_slice()) + optional + uvs + targets
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
    use crate::scene::{Animation, SceneRoot};

    #[test]
    fn what_moves_no_mesh_is_compiled_once_and_few_moments_are_kept() {
        let animations = Arc::new(vec![
            Animation { name: Some("walk".into()), moves_meshes: true, ..Animation::default() },
            Animation::default(),
        ]);
        let scene = Scene { animations, scenes: vec![SceneRoot::default()], ..Scene::default() };
        let stored = StoredScene::new("x".into(), scene, 0);
        let params = |json: &str| crate::params::from_json(json).unwrap();
        let compiled = |json: &str| stored.compile(&params(json), &MapFiles::new()).unwrap().1;
        let rest = compiled("{}");
        assert!(Arc::ptr_eq(&rest, &compiled(r#"{"animation": 1, "time": 3}"#)), "it moves no mesh");
        assert!(!Arc::ptr_eq(&rest, &compiled(r#"{"time": 0}"#)));
        assert!(Arc::ptr_eq(&compiled(r#"{"time": 2}"#), &compiled(r#"{"animation": "walk", "time": 2}"#)));
        let blurred = |close: u32| compiled(&format!(r#"{{"time": 2, "shutter": {{"open": 0, "close": {close}}}}}"#));
        assert!(Arc::ptr_eq(&compiled(r#"{"time": 2}"#), &blurred(0)) && Arc::ptr_eq(&blurred(1), &blurred(1)));
        assert!(!Arc::ptr_eq(&blurred(1), &blurred(2)));
        for time in 0..100 {
            compiled(&format!(r#"{{"time": {time}}}"#));
        }
        assert_eq!(stored.compiled().slots.len(), 1 + MAX_PASSING);
        assert!(stored.is_compiled(&params(r#"{"time": 99}"#)) && !stored.is_compiled(&params(r#"{"time": 2}"#)));
        assert!(stored.compile(&params(r#"{"animation": "run"}"#), &MapFiles::new()).is_err());
    }

    #[test]
    fn the_id_is_the_hash() {
        let id = content_id(b"abc");
        assert_eq!(id, "sha256-ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
