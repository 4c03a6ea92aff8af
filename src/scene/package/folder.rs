//! The command line's way in: a glTF on disk with the siblings that it names.

use super::{Package, uri};
use crate::scene::import::container::split;
use crate::scene::{Limits, SceneError};
use std::collections::BTreeSet;
use std::path::Path;

/// URIs of a glTF, and nothing else of it.
#[derive(Default, serde::Deserialize)]
#[serde(default)]
struct Uris {
    buffers: Vec<Named>,
    images: Vec<Named>,
}

#[derive(Default, serde::Deserialize)]
#[serde(default)]
struct Named {
    uri: Option<String>,
}

impl Package {
    /// Reads `path` and the files in its own folder (or below) that its URIs name. A URI that leaves the folder,
    /// is absolute or names a missing file is left out here and refused by the import, with its place.
    pub fn from_path(path: &Path, limits: &Limits) -> Result<Self, SceneError> {
        let bytes = read(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut parts = siblings(&bytes, folder)?;
        let name = path.file_name().map_or_else(|| "scene.gltf".into(), |name| name.to_string_lossy().into_owned());
        parts.retain(|(part, _)| *part != name);
        parts.push((name, bytes));
        Self::from_parts(parts, limits)
    }
}

fn siblings(bytes: &[u8], folder: &Path) -> Result<Vec<(String, Vec<u8>)>, SceneError> {
    // What is wrong with the file is for the import to say.
    let json = split(bytes).map_or(&[][..], |container| container.json);
    let uris: Uris = serde_json::from_slice(json).unwrap_or_default();
    let mut names = BTreeSet::new();
    for text in uris.buffers.iter().chain(&uris.images).filter_map(|named| named.uri.as_deref()) {
        if let uri::Uri::Relative(relative) = uri::parse(text) {
            let decoded = uri::decode(relative);
            let inside = !decoded.starts_with(['/', '\\']);
            names.extend(uri::join("", &decoded).filter(|name| inside && !name.is_empty()));
        }
    }
    let root = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let mut parts = Vec::new();
    for name in names {
        // Links may lead out of the folder.
        if let Some(path) =
            root.join(&name).canonicalize().ok().filter(|path| path.starts_with(&root) && path.is_file())
        {
            parts.push((name, read(&path)?));
        }
    }
    Ok(parts)
}

fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    std::fs::read(path)
        .map_err(|error| SceneError::malformed("file_unreadable", format!("cannot read {}: {error}", path.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_the_folder_are_read() {
        let outer = tempfile::tempdir().unwrap();
        let folder = outer.path().join("scene");
        std::fs::create_dir_all(folder.join("sub")).unwrap();
        std::fs::write(outer.path().join("secret.bin"), "s").unwrap();
        std::fs::write(folder.join("sub/my a.bin"), "a").unwrap();
        let absolute = outer.path().join("secret.bin").display().to_string();
        let json = serde_json::json!({"buffers": [
            {"uri": "sub/my%20a.bin"}, {"uri": "../secret.bin"}, {"uri": "sub/../../secret.bin"}, {"uri": absolute}, {"uri": "none.bin"}
        ]});
        std::fs::write(folder.join("x.gltf"), json.to_string()).unwrap();
        let package = Package::from_path(&folder.join("x.gltf"), &Limits::default()).unwrap();
        let names: Vec<&str> = package.files().map(|(name, _)| name).collect();
        assert_eq!(names, ["sub/my a.bin", "x.gltf"]);
        assert_eq!(Package::from_path(&folder.join("y.gltf"), &Limits::default()).unwrap_err().code, "file_unreadable");
    }
}
