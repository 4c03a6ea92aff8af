//! Scenes and images: kept as files by their content, and in memory as long as they are used.

use super::ledger::{Change, SceneRow};
use super::problem::{Code, Problem};
use super::scenes::{StoredImage, StoredScene, content_id};
use super::{HDRI_PIXEL_BYTES, Service, hdri_name, mebibytes};
use crate::compile::decode_hdri;
use crate::params::{FieldError, RenderParams};
use crate::scene::{self, Package};
use bytes::Bytes;
use std::sync::Arc;
use tokio::sync::OwnedSemaphorePermit;

impl Service {
    /// Imports the files (name, bytes) of a glTF, unless they are at hand, and keeps them. Says whether the scene is new.
    pub async fn add_scene(&self, parts: Vec<(String, Vec<u8>)>) -> Result<(Arc<StoredScene>, bool), Problem> {
        let upload_bytes = parts.iter().map(|(_, bytes)| bytes.len() as u64).sum();
        let (scene, package) = self.import(parts, upload_bytes).await?;
        let new = self.core.storage.store_scene(&scene.id, upload_bytes, package.files()).await?;
        Ok((scene, new))
    }

    async fn import(
        &self,
        parts: Vec<(String, Vec<u8>)>,
        upload_bytes: u64,
    ) -> Result<(Arc<StoredScene>, Package), Problem> {
        let limits = self.core.limits.scene();
        let held: u64 = parts.iter().map(|(_, bytes)| bytes.len() as u64).sum();
        let memory = self.import_memory(limits.import_memory(held, Package::is_packed(&parts))).await;
        let service = self.clone();
        self.at_desk(move || {
            // Held until the work has ended, whether or not anybody still waits for it.
            let _memory = memory;
            let package = Package::from_parts(parts, &limits)?;
            let id = package.id();
            if let Some(present) = service.core.scenes.get(&id) {
                return Ok((present, package));
            }
            let scene = scene::import(&package, &limits)?;
            let (scene, _) = service.core.scenes.insert(StoredScene::new(id, scene, upload_bytes));
            Ok((scene, package))
        })
        .await
    }

    /// A scene that clients may name; none: there is no such scene.
    pub async fn scene(&self, id: &str) -> Result<Option<Arc<StoredScene>>, Problem> {
        if self.core.storage.offers_scene(id).await? { self.read_scene(id).await } else { Ok(None) }
    }

    /// A scene, even if clients have been told that it is gone.
    pub(super) async fn read_scene(&self, id: &str) -> Result<Option<Arc<StoredScene>>, Problem> {
        if let Some(present) = self.core.scenes.get(id) {
            return Ok(Some(present));
        }
        match self.core.storage.scene(id).await? {
            Some(found) => Ok(Some(self.import(found.files, found.row.upload_bytes).await?.0)),
            None => Ok(None),
        }
    }

    /// Up to `count` scenes with ids after `after`, and whether there are more.
    pub async fn scenes(&self, after: &str, count: usize) -> Result<(Vec<SceneRow>, bool), Problem> {
        self.core.storage.scenes(after, count).await
    }

    /// Forgets a scene, though jobs that use it finish; false if there is none.
    pub async fn remove_scene(&self, id: &str) -> Result<bool, Problem> {
        self.core.scenes.remove(id);
        let removed = self.core.storage.delete(Change::DeleteScene(id.to_owned())).await?;
        self.core.tidy.notify_one();
        Ok(removed)
    }

    /// Decodes an environment picture, unless it is at hand, and keeps it. `pointer` names it in errors.
    pub async fn add_image(&self, bytes: Vec<u8>, pointer: &'static str) -> Result<(Arc<StoredImage>, bool), Problem> {
        let bytes = Bytes::from(bytes);
        let image = self.decode(bytes.clone(), pointer).await?;
        let new = self.core.storage.store_image(&image.id, bytes).await?;
        Ok((image, new))
    }

    async fn decode(&self, bytes: Bytes, pointer: &'static str) -> Result<Arc<StoredImage>, Problem> {
        let limit = self.core.limits.environment_pixels;
        let memory = self.import_memory(bytes.len() as u64 + limit.saturating_mul(HDRI_PIXEL_BYTES)).await;
        let service = self.clone();
        self.at_desk(move || {
            let _memory = memory;
            let id = content_id(&bytes);
            if let Some(present) = service.core.images.get(&id) {
                return Ok(present);
            }
            let hdri = decode_hdri(&bytes, limit).map_err(|error| {
                let fault = FieldError { pointer: pointer.to_owned(), detail: error.to_string() };
                Problem::fields(Code::InvalidImage, vec![fault])
            })?;
            let image = StoredImage { id, upload_bytes: bytes.len() as u64, hdri: Arc::new(hdri) };
            Ok(service.core.images.insert(image).0)
        })
        .await
    }

    /// An image that clients may name; none: there is no such image.
    pub async fn image(&self, id: &str) -> Result<Option<Arc<StoredImage>>, Problem> {
        if self.core.storage.offers_image(id).await? { self.read_image(id).await.map(Some) } else { Ok(None) }
    }

    /// An image that must be there, even if clients have been told that it is gone.
    pub(super) async fn read_image(&self, id: &str) -> Result<Arc<StoredImage>, Problem> {
        match self.core.images.get(id) {
            Some(present) => Ok(present),
            None => self.decode(self.core.storage.get(id).await?, "/image").await,
        }
    }

    /// Forgets an image, though jobs that use it finish; false if there is none.
    pub async fn remove_image(&self, id: &str) -> Result<bool, Problem> {
        self.core.images.remove(id);
        let removed = self.core.storage.delete(Change::DeleteImage(id.to_owned())).await?;
        self.core.tidy.notify_one();
        Ok(removed)
    }

    /// Parameters with the environment's picture looked up, if they name one that is kept.
    pub async fn stored_hdri(&self, params: &RenderParams) -> Result<Option<Arc<StoredImage>>, Problem> {
        let Some(name) = hdri_name(params) else { return Ok(None) };
        let found = self.image(name).await?.map(Some);
        found.ok_or_else(|| {
            let detail = format!(
                "there is no image `{name}`: name a file part of the same form, or an id that POST /v1/images gave"
            );
            let fault = FieldError { pointer: "/params/environment/hdri".to_owned(), detail };
            Problem::fields(Code::InvalidParams, vec![fault])
        })
    }

    /// Waits until so much memory is free for an import; what is over the whole limit has to be alone.
    async fn import_memory(&self, bytes: u64) -> Option<OwnedSemaphorePermit> {
        let whole = mebibytes(self.core.limits.import_memory_bytes);
        // The semaphore is never closed.
        Arc::clone(&self.core.import_memory).acquire_many_owned(mebibytes(bytes).min(whole)).await.ok()
    }
}
