//! Bytes by the hash of their content: uploads, results and unfinished films, in a folder or in memory.

use super::scenes::content_id;
use bytes::Bytes;
use object_store::local::LocalFileSystem;
use object_store::memory::InMemory;
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt};
use std::path::Path;
use std::sync::Arc;
use tokio_stream::StreamExt;

/// A blob that is there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlobRef {
    /// `sha256-...` of the content.
    pub id: String,
    /// Length.
    pub bytes: u64,
}

/// Why a blob cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum BlobError {
    /// The medium is at fault, or there is no such blob.
    #[error("{0}")]
    Store(#[from] object_store::Error),
    /// The content is not what its name says.
    #[error("the content of {0} has changed")]
    Damaged(String),
}

impl BlobError {
    /// Whether there is no such blob.
    pub fn is_missing(&self) -> bool {
        matches!(self, Self::Store(object_store::Error::NotFound { .. }))
    }
}

/// A store of blobs. Cloning gives another handle to the same store.
#[derive(Debug, Clone)]
pub struct Blobs {
    store: Arc<dyn ObjectStore>,
}

impl Blobs {
    /// Blobs that end with the process.
    pub fn in_memory() -> Self {
        Self { store: Arc::new(InMemory::new()) }
    }

    /// Blobs in a folder that is there. What was written survives a loss of power.
    pub fn in_folder(folder: &Path) -> Result<Self, BlobError> {
        Ok(Self { store: Arc::new(LocalFileSystem::new_with_prefix(folder)?.with_fsync(true)) })
    }

    /// Writes a blob. If it is there already, it is the same.
    pub async fn put(&self, bytes: Bytes) -> Result<BlobRef, BlobError> {
        let (id, bytes) = hashed(bytes).await;
        let blob = BlobRef { id, bytes: bytes.len() as u64 };
        if !self.holds(&blob).await {
            self.store.put(&key(&blob.id), bytes.into()).await?;
        }
        Ok(blob)
    }

    /// Whether a blob is there, by its length.
    pub async fn holds(&self, blob: &BlobRef) -> bool {
        self.store.head(&key(&blob.id)).await.is_ok_and(|present| present.size == blob.bytes)
    }

    /// Reads a blob and checks it.
    pub async fn get(&self, id: &str) -> Result<Bytes, BlobError> {
        let bytes = self.store.get(&key(id)).await?.bytes().await?;
        let (found, bytes) = hashed(bytes).await;
        if found == id { Ok(bytes) } else { Err(BlobError::Damaged(id.to_owned())) }
    }

    /// Deletes a blob; it is fine if there is none.
    pub async fn delete(&self, id: &str) -> Result<(), BlobError> {
        match self.store.delete(&key(id)).await {
            Err(object_store::Error::NotFound { .. }) => Ok(()),
            done => Ok(done?),
        }
    }

    /// Ids of all blobs.
    pub async fn list(&self) -> Result<Vec<String>, BlobError> {
        let names = self.store.list(None).map(|found| found.map(|meta| meta.location.filename().map(str::to_owned)));
        let names: Vec<Option<String>> = names.collect::<Result<_, _>>().await?;
        Ok(names.into_iter().flatten().filter(|name| name.starts_with("sha256-")).collect())
    }
}

/// Folders of some 256 keep their listings short.
fn key(id: &str) -> Key {
    let folder = id.strip_prefix("sha256-").and_then(|digits| digits.get(..2)).unwrap_or("xx");
    Key::from(format!("{folder}/{id}"))
}

/// The id of bytes; hashing many of them takes a while, so elsewhere.
async fn hashed(bytes: Bytes) -> (String, Bytes) {
    let work = bytes.clone();
    let id = tokio::task::spawn_blocking(move || content_id(&work)).await;
    // It neither panics nor is it cancelled.
    (id.unwrap_or_default(), bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn write_read_delete(blobs: Blobs) {
        let blob = blobs.put(Bytes::from_static(b"abc")).await.unwrap();
        assert_eq!((blob.id.as_str(), blob.bytes), (content_id(b"abc").as_str(), 3));
        assert_eq!(blobs.put(Bytes::from_static(b"abc")).await.unwrap(), blob);
        assert_eq!(blobs.get(&blob.id).await.unwrap(), "abc");
        assert_eq!(blobs.list().await.unwrap(), std::slice::from_ref(&blob.id));
        blobs.delete(&blob.id).await.unwrap();
        blobs.delete(&blob.id).await.unwrap();
        assert!(blobs.get(&blob.id).await.is_err());
    }

    #[tokio::test]
    async fn what_was_put_is_read_until_it_is_deleted() {
        write_read_delete(Blobs::in_memory()).await;
        let folder = tempfile::tempdir().unwrap();
        write_read_delete(Blobs::in_folder(folder.path()).unwrap()).await;
    }

    #[tokio::test]
    async fn a_blob_that_has_changed_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::in_folder(folder.path()).unwrap();
        let blob = blobs.put(Bytes::from_static(b"abc")).await.unwrap();
        std::fs::write(folder.path().join(&blob.id[7..9]).join(&blob.id), "abd").unwrap();
        assert!(matches!(blobs.get(&blob.id).await, Err(BlobError::Damaged(_))));
    }
}
