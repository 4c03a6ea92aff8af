//! Bad and odd scenes: a clear error or a scene, never a panic or a hang; and servers that are killed.

mod assets;
mod invalid;
mod kills;
mod mutations;
mod overload;
mod server;

use candela::scene::{Limits, Moment, Package, Scene, SceneError, import};
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
        assert!(node.skin.is_none_or(|skin| skin < scene.skins.len()));
        assert!(node.instances.iter().flat_map(|places| &places[..]).all(|place| place.is_finite()));
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
        let influences = primitive.influences.as_ref();
        assert!(influences.is_none_or(|all| all.joints.len() == count * all.per_vertex));
        assert!(influences.is_none_or(|all| all.weights.len() == all.joints.len()));
        for target in &primitive.targets {
            for list in [&target.positions, &target.normals, &target.tangents] {
                assert!(list.is_empty() || list.len() == count && list.iter().all(|difference| difference.is_finite()));
            }
        }
        let Some(material) = primitive.material else { continue };
        for texture in scene.materials[material].textures() {
            assert!(texture.uv_set < primitive.uvs.len());
            assert!(!scene.images[scene.textures[texture.texture].image].bytes.is_empty());
        }
    }
}

/// Panics unless a scene can be posed at any time, to sound vertices or an error.
fn assert_poses(scene: &Scene) {
    for (animation, of_file) in scene.animations.iter().enumerate() {
        for time in [f64::MIN, of_file.span[0], (of_file.span[0] + of_file.span[1]) * 0.5, f64::MAX] {
            let posed = scene.at(Some(Moment { animation, time }));
            for drawn in posed.drawn(0).into_iter().flatten() {
                let positions = || drawn.mesh.primitives.iter().flat_map(|primitive| &primitive.positions);
                assert!(positions().all(|position| position.is_finite()));
            }
        }
    }
}
