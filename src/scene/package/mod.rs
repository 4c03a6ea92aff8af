//! The files of an upload, in memory. Nothing here or above reads a file system or a network for a URI.

mod archive;
mod folder;
pub(super) mod uri;

use super::{Limits, SceneError};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A set of named files, one of which is the glTF.
#[derive(Debug, Clone)]
pub struct Package {
    files: BTreeMap<String, Arc<[u8]>>,
    root: String,
}

impl Package {
    /// One blob: a `.glb`, a `.gltf` whose URIs are all `data:`, or a `.zip` with exactly one of either inside.
    pub fn from_bytes(bytes: Vec<u8>, limits: &Limits) -> Result<Self, SceneError> {
        if archive::is_zip(&bytes) {
            return Self::with_root(archive::inflate(&bytes, limits)?);
        }
        check_size(bytes.len() as u64, limits)?;
        Ok(Self { files: BTreeMap::from([(String::new(), bytes.into())]), root: String::new() })
    }

    /// Several named parts; the names are the URIs by which the one `.gltf` or `.glb` among them names the others.
    /// A single part may be anything that [`Package::from_bytes`] takes, whatever its name; so may a `.zip` beside files of which none is a glTF.
    pub fn from_parts(mut parts: Vec<(String, Vec<u8>)>, limits: &Limits) -> Result<Self, SceneError> {
        let mut files = match packed(&parts) {
            Some(archive) => archive::inflate(&parts.remove(archive).1, limits)?,
            None if parts.len() <= 1 => {
                let bytes = parts.pop().map(|(_, bytes)| bytes).unwrap_or_default();
                return Self::from_bytes(bytes, limits);
            }
            None => BTreeMap::new(),
        };
        check_size(parts.iter().map(|(_, bytes)| bytes.len() as u64).sum(), limits)?;
        for (name, bytes) in parts {
            if files.insert(name.clone(), Arc::from(bytes)).is_some() {
                let detail = format!("two files have the name `{name}`; give each its own");
                return Err(SceneError::malformed("part_duplicate", detail));
            }
        }
        Self::with_root(files)
    }

    fn with_root(files: BTreeMap<String, Arc<[u8]>>) -> Result<Self, SceneError> {
        let roots: Vec<&String> = files.keys().filter(|name| is_gltf_name(name)).collect();
        match roots.as_slice() {
            [root] => Ok(Self { root: (*root).clone(), files }),
            [] => Err(SceneError::malformed(
                "root_missing",
                "none of the files is named `*.gltf` or `*.glb`; add the glTF itself",
            )),
            [first, second, ..] => Err(SceneError::malformed(
                "root_ambiguous",
                format!("both `{first}` and `{second}` are glTF files; send one scene at a time"),
            )),
        }
    }

    /// Stable name of the content: `sha256-` and the hex digest of all names and bytes in the order of the names.
    pub fn id(&self) -> String {
        let mut hash = Sha256::new();
        for (name, bytes) in &self.files {
            for field in [name.as_bytes(), bytes.as_ref()] {
                hash.update((field.len() as u64).to_le_bytes());
                hash.update(field);
            }
        }
        hash.finalize().iter().fold("sha256-".to_owned(), |id, byte| id + &format!("{byte:02x}"))
    }

    /// The glTF's bytes.
    pub fn root(&self) -> &[u8] {
        self.files.get(&self.root).map_or(&[], |bytes| bytes)
    }

    /// Bytes of all files.
    pub fn bytes(&self) -> u64 {
        self.files.values().map(|bytes| bytes.len() as u64).sum()
    }

    /// Whether [`Package::from_parts`] would unpack this.
    pub fn is_packed(parts: &[(String, Vec<u8>)]) -> bool {
        packed(parts).is_some()
    }

    /// All files, sorted by name; [`Package::from_parts`] makes the same package of them again.
    pub fn files(&self) -> impl Iterator<Item = (&str, &Arc<[u8]>)> {
        self.files.iter().map(|(name, bytes)| (name.as_str(), bytes))
    }

    /// The file that a relative URI of the glTF means: by its path from the glTF's folder, else by its
    /// last segment if only one file is called that.
    pub fn find(&self, uri: &str) -> Option<&Arc<[u8]>> {
        let path = uri::decode(uri);
        let folder = self.root.rsplit_once('/').map_or("", |(folder, _)| folder);
        let exact = uri::join(folder, &path).and_then(|path| self.files.get(&path));
        exact.or_else(|| self.files.get(path.as_str())).or_else(|| self.files.get(uri)).or_else(|| {
            let mut same = self.files.iter().filter(|(name, _)| last_segment(name) == last_segment(&path));
            same.next().filter(|_| same.next().is_none()).map(|(_, bytes)| bytes)
        })
    }
}

/// The one archive among the parts, if there is no glTF besides.
fn packed(parts: &[(String, Vec<u8>)]) -> Option<usize> {
    let mut archives = (0..parts.len()).filter(|&index| archive::is_zip(&parts[index].1));
    let only = archives.next().filter(|_| archives.next().is_none())?;
    let has_root = parts.iter().enumerate().any(|(index, (name, _))| index != only && is_gltf_name(name));
    (!has_root).then_some(only)
}

fn is_gltf_name(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name.ends_with(".gltf") || name.ends_with(".glb")
}

fn last_segment(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

fn check_size(bytes: u64, limits: &Limits) -> Result<(), SceneError> {
    if bytes <= limits.bytes {
        return Ok(());
    }
    let detail = format!("the scene has {bytes} bytes, more than the limit of {}", limits.bytes);
    Err(SceneError::too_large("scene_bytes", "", detail))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(list: &[(&str, &str)]) -> Result<Package, SceneError> {
        let parts = list.iter().map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())).collect();
        Package::from_parts(parts, &Limits::default())
    }

    #[test]
    fn parts_are_found_by_uri() {
        let package =
            parts(&[("a.gltf", "{}"), ("my tex.png", "1"), ("sub/b.bin", "2"), ("x/c.bin", "3"), ("y/c.bin", "4")]);
        let package = package.unwrap();
        let find = |uri| package.find(uri).map(|bytes| bytes.to_vec());
        assert_eq!(find("my%20tex.png"), Some(b"1".to_vec()));
        assert_eq!(find("./sub/../sub/b.bin"), Some(b"2".to_vec()));
        assert_eq!(find("textures/b.bin"), Some(b"2".to_vec()), "by the last segment");
        assert_eq!(find("c.bin"), None, "ambiguous");
        assert_eq!(find("x/c.bin"), Some(b"3".to_vec()));
    }

    #[test]
    fn the_root_must_be_single() {
        assert_eq!(parts(&[("a.gltf", ""), ("b.GLB", "")]).unwrap_err().code, "root_ambiguous");
        assert_eq!(parts(&[("a.bin", ""), ("b.bin", "")]).unwrap_err().code, "root_missing");
        assert_eq!(parts(&[("a.gltf", ""), ("a.gltf", "")]).unwrap_err().code, "part_duplicate");
    }

    #[test]
    fn the_id_depends_on_content_only() {
        let a = parts(&[("a.gltf", "{}"), ("b.bin", "12")]).unwrap();
        let b = parts(&[("b.bin", "12"), ("a.gltf", "{}")]).unwrap();
        let c = parts(&[("b.bi", "n12"), ("a.gltf", "{}")]).unwrap();
        assert_eq!(a.id(), b.id());
        assert_ne!(a.id(), c.id());
        assert_eq!(parts(&[("a", "{}")]).unwrap().id(), parts(&[("b", "{}")]).unwrap().id(), "a lone blob has no name");
        assert_eq!(a.id().len(), "sha256-".len() + 64);
    }

    #[test]
    fn size_is_limited() {
        let limits = Limits { bytes: 3, ..Limits::default() };
        assert_eq!(Package::from_bytes(vec![0; 4], &limits).unwrap_err().code, "scene_bytes");
    }
}
