//! Zip archives, inflated under limits that are enforced on the bytes that come out, not on what headers claim.

use crate::scene::{Limits, SceneError};
use std::collections::{BTreeMap, HashSet};
use std::io::{Cursor, Read};
use std::sync::Arc;
use zip::ZipArchive;

/// Whether the bytes begin as a zip does.
pub(super) fn is_zip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06")
}

/// Inflated bytes that are free of the ratio's limit, so that a small and repetitive file passes.
const RATIO_FREE: u64 = 1 << 20;

/// All files of the archive by their path.
pub(super) fn inflate(bytes: &[u8], limits: &Limits) -> Result<BTreeMap<String, Arc<[u8]>>, SceneError> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| broken("archive", &error))?;
    if archive.len() > limits.zip_entries {
        let detail = format!("the zip has {} entries, more than the limit of {}", archive.len(), limits.zip_entries);
        return Err(SceneError::too_large("zip_entries", "", detail));
    }
    if archive.has_duplicate_names() {
        let name = given_twice(bytes, archive.central_directory_start());
        let called = name.map_or_else(|| "have the same name".to_owned(), |name| format!("are called `{name}`"));
        return Err(duplicate(&format!("two entries of the zip {called}; give each file its own name")));
    }
    let mut files = BTreeMap::new();
    let mut left = limits.bytes;
    for index in 0..archive.len() {
        let mut entry = archive.by_index(index).map_err(|error| broken(&format!("entry {index}"), &error))?;
        let name = entry.name().map_err(|error| broken(&format!("entry {index}"), &error))?.replace('\\', "/");
        // Resource forks of one well-known system repeat every name, with `.gltf` at its end.
        if !entry.is_file() || name.starts_with("__MACOSX/") {
            continue;
        }
        if name.starts_with('/') || name.split('/').any(|part| part == "..") {
            let detail =
                format!("the entry `{name}` of the zip lies outside of it; pack the files with plain relative names");
            return Err(SceneError::malformed("zip_path", detail));
        }
        let allowed = left.min(entry.compressed_size().saturating_mul(limits.zip_ratio).saturating_add(RATIO_FREE));
        let mut content = Vec::new();
        // One byte more than allowed tells "full" from "too much".
        let read = entry.by_ref().take(allowed.saturating_add(1)).read_to_end(&mut content);
        if content.len() as u64 > allowed {
            return Err(too_much(&name, allowed == left, limits));
        }
        read.map_err(|error| broken(&format!("entry `{name}`"), &error))?;
        left -= content.len() as u64;
        if files.contains_key(&name) {
            return Err(duplicate(&format!("two entries of the zip are called `{name}`; give each file its own name")));
        }
        files.insert(name, content.into());
    }
    Ok(files)
}

/// The first name that the directory of a zip, which begins there, has twice (APPNOTE 4.3.12); the reader keeps one entry of each name.
fn given_twice(zip: &[u8], start: u64) -> Option<String> {
    let mut rest = zip.get(usize::try_from(start).ok()?..)?;
    let mut seen = HashSet::new();
    while rest.starts_with(b"PK\x01\x02") {
        let length = |at: usize| Some(usize::from(u16::from_le_bytes(rest.get(at..at + 2)?.try_into().ok()?)));
        let (name, extra, comment) = (length(28)?, length(30)?, length(32)?);
        let name = rest.get(46..46 + name)?;
        if !seen.insert(name) {
            return Some(String::from_utf8_lossy(name).into_owned());
        }
        rest = rest.get(46 + name.len() + extra + comment..)?;
    }
    None
}

fn broken(what: &str, error: &dyn std::fmt::Display) -> SceneError {
    SceneError::malformed("zip_broken", format!("the zip cannot be read ({what}): {error}"))
}

fn duplicate(detail: &str) -> SceneError {
    SceneError::malformed("part_duplicate", detail)
}

/// `in_all`: the bytes of all entries together are too many, rather than those of this one for its packed size.
fn too_much(name: &str, in_all: bool, limits: &Limits) -> SceneError {
    let detail = if in_all {
        format!(
            "with entry `{name}` the zip inflates to more than the {} bytes allowed (limit decompressed_bytes); leave out \
             what the scene does not need",
            limits.bytes
        )
    } else {
        format!(
            "entry `{name}` of the zip inflates to more than {} times its packed size (limit decompression_ratio); pass \
             this file unpacked",
            limits.zip_ratio
        )
    };
    SceneError::too_large("zip_inflated", "", detail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Package, SceneErrorKind};
    use std::io::Write;
    use zip::write::{SimpleFileOptions, ZipWriter};

    fn zip(files: &[(&str, &[u8])]) -> Vec<u8> {
        let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in files {
            writer.start_file(*name, SimpleFileOptions::default()).unwrap();
            writer.write_all(bytes).unwrap();
        }
        writer.finish().unwrap().into_inner()
    }

    #[test]
    fn a_zip_with_a_folder_resolves_relative_to_its_gltf() {
        let bytes = zip(&[("m/a.gltf", b"{}"), ("m/t/x.bin", b"1"), ("x.bin", b"2"), ("__MACOSX/m/._a.gltf", b"")]);
        let package = Package::from_bytes(bytes, &Limits::default()).unwrap();
        assert_eq!(package.root(), b"{}");
        assert_eq!(package.find("t/x.bin").unwrap().as_ref(), b"1");
        assert_eq!(package.find("../x.bin").unwrap().as_ref(), b"2");
    }

    #[test]
    fn a_zip_may_have_files_beside_it_but_no_second_scene() {
        let packed = zip(&[("a.gltf", b"{}")]);
        let beside = |name: &str| {
            let parts = vec![("m.zip".to_owned(), packed.clone()), (name.to_owned(), b"1".to_vec())];
            Package::from_parts(parts, &Limits::default())
        };
        let package = beside("x.png").unwrap();
        assert_eq!((package.root(), package.find("x.png").unwrap().as_ref()), (&b"{}"[..], &b"1"[..]));
        assert_eq!(beside("a.gltf").unwrap().root(), b"1", "an archive beside a glTF is a file of it");
    }

    #[test]
    fn bombs_are_refused() {
        let limits = Limits { bytes: 64 << 20, ..Limits::default() };
        let zeros = vec![0; 32 << 20];
        let error = Package::from_bytes(zip(&[("a.gltf", &zeros)]), &limits).unwrap_err();
        assert_eq!((error.kind, error.code), (SceneErrorKind::TooLarge, "zip_inflated"), "by ratio");
        assert!(error.detail.contains("decompression_ratio"), "{error}");
        let limits = Limits { bytes: 1000, ..Limits::default() };
        let two = zip(&[("a.gltf", &[1; 600]), ("b.bin", &[1; 600])]);
        let error = Package::from_bytes(two, &limits).unwrap_err();
        assert_eq!(error.code, "zip_inflated", "by total");
        assert!(error.detail.contains("decompressed_bytes"), "{error}");
        let limits = Limits { zip_entries: 1, ..Limits::default() };
        let two = zip(&[("a.gltf", b""), ("b.bin", b"")]);
        assert_eq!(Package::from_bytes(two, &limits).unwrap_err().code, "zip_entries");
    }

    #[test]
    fn each_entry_has_its_own_name() {
        // The writer refuses this, so it is forged: in headers and directory alike.
        let mut bytes = zip(&[("a.gltf", b"{}"), ("b.gltf", b"{}")]);
        while let Some(place) = bytes.windows(6).position(|name| name == b"b.gltf") {
            bytes[place] = b'a';
        }
        let fault = Package::from_bytes(bytes, &Limits::default()).unwrap_err();
        assert_eq!(fault.code, "part_duplicate");
        assert!(fault.detail.contains("`a.gltf`"), "{fault}");
        let slashes = zip(&[("m/a.gltf", b"{}"), ("m\\a.gltf", b"{}")]);
        assert_eq!(Package::from_bytes(slashes, &Limits::default()).unwrap_err().code, "part_duplicate");
    }

    #[test]
    fn names_stay_within() {
        for name in ["../a.gltf", "m/../../a.gltf", "m\\..\\a.gltf", "/a.gltf"] {
            let error = Package::from_bytes(zip(&[(name, b"{}")]), &Limits::default()).unwrap_err();
            assert!(error.code == "zip_path" && error.detail.contains("a.gltf"), "{name}: {error}");
        }
        assert!(Package::from_bytes(zip(&[("m..x/a...gltf", b"{}")]), &Limits::default()).is_ok());
    }

    #[test]
    fn a_cut_zip_is_malformed() {
        let mut bytes = zip(&[("a.gltf", b"{}")]);
        bytes.truncate(bytes.len() - 10);
        assert_eq!(Package::from_bytes(bytes, &Limits::default()).unwrap_err().code, "zip_broken");
    }
}
