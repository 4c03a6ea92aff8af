//! API keys: a file of names, hashes and rights. The keys themselves are shown once, when they are made, and kept nowhere.

use crate::jobs::{Code, Problem};
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io::Write;
use std::path::{Path, PathBuf};

/// What a key begins with, so that it is known when it leaks.
const PREFIX: &str = "candela_";

/// Random bytes of a key: too many to be guessed, so that a plain hash keeps it safe.
const BYTES: usize = 32;

/// Longest name.
const LONGEST_NAME: usize = 64;

/// What a key may do; each includes those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// Look at scenes, jobs, results and limits.
    Read,
    /// Upload, render and cancel.
    Render,
    /// Delete uploads, and read metrics.
    Admin,
}

/// A key as it is kept.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// For lists and logs.
    pub name: String,
    /// SHA-256 of the key, hexadecimal.
    pub sha256: String,
    /// What it may do.
    pub scope: Scope,
    /// Requests a minute, and as many at once; none: no bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requests_per_minute: Option<u32>,
    /// Renders a day (UTC); none: no bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub renders_per_day: Option<u64>,
}

impl Key {
    /// Whether it may do what a scope says.
    ///
    /// # Errors
    /// Its own scope is less.
    pub fn allows(&self, scope: Scope) -> Result<(), Problem> {
        if self.scope >= scope {
            return Ok(());
        }
        let name = |scope: Scope| serde_json::json!(scope).as_str().unwrap_or_default().to_owned();
        let (own, needed) = (name(self.scope), name(scope));
        let detail = format!("the key `{}` has the scope `{own}`; this needs `{needed}`", self.name);
        Err(Problem::new(Code::Forbidden, detail))
    }
}

/// The file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyFile {
    /// In the order in which they were made.
    pub keys: Vec<Key>,
}

/// Why a file of keys cannot be read or changed.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// The file.
    #[error("{0}: {1}")]
    File(PathBuf, std::io::Error),
    /// Its content.
    #[error("{0}: {1}")]
    Content(PathBuf, String),
    /// What was asked for.
    #[error("{0}")]
    Request(String),
}

/// SHA-256 of a key, hexadecimal.
pub fn hash(key: &str) -> String {
    Sha256::digest(key.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}

impl KeyFile {
    /// Reads a file.
    ///
    /// # Errors
    /// It is not there, or is no file of keys.
    pub fn read(path: &Path) -> Result<Self, KeyError> {
        let text = std::fs::read_to_string(path).map_err(|error| KeyError::File(path.to_owned(), error))?;
        let file: Self =
            serde_json::from_str(&text).map_err(|error| KeyError::Content(path.to_owned(), error.to_string()))?;
        let faulty = |key: &&Key| key.sha256.len() != 64 || !key.sha256.bytes().all(|byte| byte.is_ascii_hexdigit());
        match file.keys.iter().find(faulty) {
            Some(key) => Err(KeyError::Content(path.to_owned(), format!("the hash of `{}` is none", key.name))),
            None => Ok(file),
        }
    }

    /// The same; a file that is not there has no keys.
    ///
    /// # Errors
    /// It is no file of keys.
    pub fn read_or_new(path: &Path) -> Result<Self, KeyError> {
        match Self::read(path) {
            Err(KeyError::File(_, error)) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            read => read,
        }
    }

    /// Changes a file, or makes it, while no other process does.
    ///
    /// # Errors
    /// It cannot be read, changed or written.
    pub fn change<T>(path: &Path, change: impl FnOnce(&mut Self) -> Result<T, KeyError>) -> Result<T, KeyError> {
        let place = beside(path, ".lock");
        let lock = std::fs::OpenOptions::new().write(true).create(true).truncate(false).open(&place);
        // Held until it is closed. The file itself is another one after each change.
        let _lock = lock.and_then(|lock| lock.lock().map(|()| lock)).map_err(|error| KeyError::File(place, error))?;
        let mut file = Self::read_or_new(path)?;
        let done = change(&mut file)?;
        file.write(path)?;
        Ok(done)
    }

    /// Writes the file, whole or not at all, for its owner alone.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), KeyError> {
        let fault = |error| KeyError::File(path.to_owned(), error);
        let text = serde_json::to_string_pretty(self).map_err(|error| fault(error.into()))?;
        let draft = beside(path, ".new");
        let mut options = std::fs::OpenOptions::new();
        options.write(true).create(true).truncate(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let written = options.open(&draft).and_then(|mut file| {
            file.write_all(text.as_bytes())?;
            file.write_all(b"\n")?;
            file.sync_all()
        });
        written.and_then(|()| std::fs::rename(&draft, path)).map_err(fault)
    }

    /// Makes a key and answers it.
    ///
    /// # Errors
    /// The name is taken or odd, or the system has no random numbers.
    pub fn add(
        &mut self,
        name: &str,
        scope: Scope,
        requests_per_minute: Option<u32>,
        renders_per_day: Option<u64>,
    ) -> Result<String, KeyError> {
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.');
        if !(1..=LONGEST_NAME).contains(&name.len()) || !name.bytes().all(plain) {
            let detail = format!("`{name}`: a name is 1 to {LONGEST_NAME} letters, digits, `-`, `_` or `.`");
            return Err(KeyError::Request(detail));
        }
        if self.keys.iter().any(|key| key.name == name) {
            return Err(KeyError::Request(format!("there is a key `{name}` already: revoke it first")));
        }
        let mut noise = [0; BYTES];
        getrandom::fill(&mut noise).map_err(|error| KeyError::Request(format!("no random numbers: {error}")))?;
        let key = format!("{PREFIX}{}", URL_SAFE_NO_PAD.encode(noise));
        let name = name.to_owned();
        self.keys.push(Key { name, sha256: hash(&key), scope, requests_per_minute, renders_per_day });
        Ok(key)
    }

    /// Takes a key away.
    ///
    /// # Errors
    /// There is none of that name.
    pub fn revoke(&mut self, name: &str) -> Result<(), KeyError> {
        let count = self.keys.len();
        self.keys.retain(|key| key.name != name);
        if self.keys.len() < count { Ok(()) } else { Err(KeyError::Request(format!("there is no key `{name}`"))) }
    }
}

/// A file with a longer name in the same folder.
fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_kept_as_hashes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys.json");
        let mut file = KeyFile::read_or_new(&path).unwrap();
        assert!(matches!(KeyFile::read(&path), Err(KeyError::File(..))));
        let key = file.add("ci", Scope::Render, Some(60), None).unwrap();
        assert!(key.starts_with(PREFIX) && key.len() == PREFIX.len() + 43, "{key}");
        assert!(file.add("ci", Scope::Read, None, None).is_err() && file.add("a b", Scope::Read, None, None).is_err());
        file.write(&path).unwrap();
        assert!(!std::fs::read_to_string(&path).unwrap().contains(&key));
        assert_eq!(KeyFile::read(&path).unwrap(), file);
        assert_eq!(file.keys[0].sha256, hash(&key));
        #[cfg(unix)]
        assert_eq!(std::os::unix::fs::MetadataExt::mode(&std::fs::metadata(&path).unwrap()) & 0o777, 0o600);
        file.revoke("ci").unwrap();
        assert!(file.revoke("ci").is_err() && file.keys.is_empty());
        std::fs::write(&path, r#"{"keys": [{"name": "a", "sha256": "zz", "scope": "read"}]}"#).unwrap();
        assert!(matches!(KeyFile::read(&path), Err(KeyError::Content(..))));
    }
}
