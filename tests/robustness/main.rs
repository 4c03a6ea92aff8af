//! Bad and odd scenes: a clear error or a scene, never a panic or a hang; and servers that are killed.

mod apart;
mod assets;
mod damage;
mod full_disk;
mod fuzz;
mod invalid;
mod kills;
mod mutations;
mod overload;
mod server;
mod targets;
mod traces;

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
