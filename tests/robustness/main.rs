//! Bad and odd scenes: a clear error or a scene, never a panic or a hang; and servers that are killed.

mod assets;
mod invalid;
mod kills;
mod mutations;
mod overload;
mod server;

use candela::scene::{Limits, Package, Scene, SceneError, import};
use std::path::{Path, PathBuf};

/// The folder of test assets beside the repository, if it is there.
fn shared() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no test assets at {}", folder.display());
    None
}

/// Reads a scene from disk.
fn load(path: &Path) -> Result<Scene, SceneError> {
    let limits = Limits::default();
    import(&Package::from_path(path, &limits)?, &limits)
}

/// All `.gltf` and `.glb` below a folder, sorted.
fn scenes_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("the folder can be read").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "gltf" || extension == "glb") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Panics unless every index and number that later stages rely on is sound.
fn assert_sound(scene: &Scene) {
    assert!(scene.scenes.iter().flat_map(|root| &root.nodes).all(|node| *node < scene.nodes.len()));
    for node in &scene.nodes {
        assert!(node.local.is_finite());
        assert!(node.children.iter().all(|child| *child < scene.nodes.len()));
        assert!(node.mesh.is_none_or(|mesh| mesh < scene.meshes.len()));
        assert!(node.camera.is_none_or(|camera| camera < scene.cameras.len()));
        assert!(node.light.is_none_or(|light| light < scene.lights.len()));
    }
    for primitive in scene.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        let count = primitive.positions.len();
        assert!(primitive.triangles.iter().flatten().all(|vertex| (*vertex as usize) < count));
        assert!(primitive.positions.iter().all(|position| position.is_finite()));
        let normals = primitive.normals.as_ref();
        assert!(normals.is_none_or(|all| all.len() == count && all.iter().all(|normal| normal.length() < 1.001)));
        let tangents = primitive.tangents.as_ref();
        assert!(tangents.is_none_or(|all| all.len() == count && all.iter().all(|t| t.truncate().length() < 1.001)));
        let colors = primitive.colors.as_ref();
        assert!(colors.is_none_or(|all| all.len() == count && all.iter().all(|color| color.is_finite())));
        assert!(primitive.uvs.iter().all(|all| all.len() == count && all.iter().all(|uv| uv.is_finite())));
        let Some(material) = primitive.material else { continue };
        for texture in scene.materials[material].textures() {
            assert!(texture.uv_set < primitive.uvs.len());
            assert!(!scene.images[scene.textures[texture.texture].image].bytes.is_empty());
        }
    }
}
