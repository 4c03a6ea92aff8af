//! Scenes and images: kept as files by their content, and in memory as long as they are used.

use super::ledger::{Change, SceneRow};
use super::problem::{Code, Problem};
use super::scenes::{ImageContent, StoredImage, StoredScene, content_id};
use super::{HDRI_PIXEL_BYTES, Service, mebibytes};
use crate::compile::{decode_hdri, map_size};
use crate::params::{FieldError, RenderParams};
use crate::scene::{self, Package, Profile};
use bytes::Bytes;
use std::collections::HashMap;
use std::sync::Arc;
use tokio::sync::OwnedSemaphorePermit;

/// Files that one request names.
#[derive(Debug, Default)]
pub struct Images {
    /// Of the environment.
    pub environment: Option<Arc<StoredImage>>,
    /// Of spheres and overrides.
    pub maps: Vec<Arc<StoredImage>>,
    /// Of lights.
    pub profiles: Vec<Arc<StoredImage>>,
}

/// Size and use of a file: a picture that has a format of maps is one.
fn content(bytes: &Bytes, environment_pixels: u64, map_pixels: u64) -> Result<((u32, u32), ImageContent), String> {
    if let Some(size) = map_size(bytes, map_pixels) {
        return Ok((size?, ImageContent::Map(Arc::from(bytes.as_ref()))));
    }
    if Profile::is_ies(bytes) {
        let profile = Profile::read(bytes)?;
        return Ok((profile.size(), ImageContent::Profile(Arc::new(profile))));
    }
    let hdri = decode_hdri(bytes, environment_pixels).map_err(|error| error.to_string())?;
    Ok(((hdri.width, hdri.height), ImageContent::Environment(Arc::new(hdri))))
}

fn invalid(pointer: String, detail: String) -> Problem {
    Problem::fields(Code::InvalidParams, vec![FieldError { pointer, detail }])
}

impl Service {
    /// Imports the files (name, bytes) of a glTF, unless they are at hand, and keeps them. Says whether the scene is new.
    /// `to_render`: a scene that is not at hand is refused while the queue is full.
    pub async fn add_scene(
        &self,
        parts: Vec<(String, Vec<u8>)>,
        to_render: bool,
    ) -> Result<(Arc<StoredScene>, bool), Problem> {
        let upload_bytes = parts.iter().map(|(_, bytes)| bytes.len() as u64).sum();
        let (scene, package) = self.import(parts, upload_bytes, to_render).await?;
        let new = self.core.storage.store_scene(&scene.id, upload_bytes, package.files()).await?;
        Ok((scene, new))
    }

    async fn import(
        &self,
        parts: Vec<(String, Vec<u8>)>,
        upload_bytes: u64,
        to_render: bool,
    ) -> Result<(Arc<StoredScene>, Package), Problem> {
        let limits = self.core.limits.scene();
        let held: u64 = parts.iter().map(|(_, bytes)| bytes.len() as u64).sum();
        // A process that reads it first needs as much.
        let copies = 1 + u64::from(self.core.trial.get().is_some());
        let needed = limits.import_memory(held, Package::is_packed(&parts));
        let memory = self.import_memory(needed.saturating_mul(copies)).await;
        let service = self.clone();
        self.at_desk(move || {
            // Held until the work has ended, whether or not anybody still waits for it.
            let _memory = memory;
            let package = Package::from_parts(parts, &limits)?;
            let id = package.id();
            if let Some(present) = service.core.scenes.get(&id) {
                return Ok((present, package));
            }
            if to_render {
                service.refuse_without_a_place()?;
            }
            if let Some(trial) = service.core.trial.get() {
                trial.hold(&package, &limits)?;
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
            Some(found) => Ok(Some(self.import(found.files, found.row.upload_bytes, false).await?.0)),
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

    /// Decodes an environment picture or a profile, or looks at a map, unless it is at hand, and keeps it. `pointer` names it in errors.
    pub async fn add_image(&self, bytes: Vec<u8>, pointer: &str) -> Result<(Arc<StoredImage>, bool), Problem> {
        let bytes = Bytes::from(bytes);
        let image = self.decode(bytes.clone(), pointer).await?;
        let new = self.core.storage.store_image(&image.id, bytes).await?;
        Ok((image, new))
    }

    async fn decode(&self, bytes: Bytes, pointer: &str) -> Result<Arc<StoredImage>, Problem> {
        let limit = self.core.limits.environment_pixels;
        let memory = self.import_memory(bytes.len() as u64 + limit.saturating_mul(HDRI_PIXEL_BYTES)).await;
        let (service, pointer) = (self.clone(), pointer.to_owned());
        self.at_desk(move || {
            let _memory = memory;
            let id = content_id(&bytes);
            if let Some(present) = service.core.images.get(&id) {
                return Ok(present);
            }
            let invalid = |detail| Problem::fields(Code::InvalidImage, vec![FieldError { pointer, detail }]);
            let (size, content) = content(&bytes, limit, service.core.limits.texture_pixels).map_err(invalid)?;
            let image = StoredImage { id, upload_bytes: bytes.len() as u64, size, content };
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

    /// The files that parameters name: parts of the same form, which are taken out of `files` and kept, else ones that are
    /// kept already. Maps and profiles are named by their ids from then on.
    pub async fn take_images(
        &self,
        params: &mut RenderParams,
        files: &mut Vec<(String, Vec<u8>)>,
    ) -> Result<Images, Problem> {
        let (mut taken, mut images) = (HashMap::new(), Images::default());
        if let Some(name) = params.hdri_name().map(str::to_owned) {
            let pointer = "/params/environment/hdri";
            let image = self.take_image(&name, pointer, files, &mut taken).await?;
            if image.environment().is_none() {
                let detail = format!("`{name}` is no environment: send an equirectangular .hdr or .exr");
                return Err(invalid(pointer.to_owned(), detail));
            }
            images.environment = Some(image);
        }
        for (pointer, name) in params.map_names_mut() {
            let image = self.take_image(name, &pointer, files, &mut taken).await?;
            if image.map().is_none() {
                return Err(invalid(pointer, format!("`{name}` is no map: send a .png, .jpg or .webp")));
            }
            name.clone_from(&image.id);
            images.maps.push(image);
        }
        for (pointer, name) in params.profile_names_mut() {
            let image = self.take_image(name, &pointer, files, &mut taken).await?;
            if image.profile().is_none() {
                return Err(invalid(pointer, format!("`{name}` is no profile: send an IES LM-63 file (.ies)")));
            }
            name.clone_from(&image.id);
            images.profiles.push(image);
        }
        Ok(images)
    }

    async fn take_image(
        &self,
        name: &str,
        pointer: &str,
        files: &mut Vec<(String, Vec<u8>)>,
        taken: &mut HashMap<String, Arc<StoredImage>>,
    ) -> Result<Arc<StoredImage>, Problem> {
        if let Some(image) = taken.get(name) {
            return Ok(Arc::clone(image));
        }
        let image = match files.iter().position(|(file, _)| file == name) {
            Some(place) => self.add_image(files.remove(place).1, pointer).await?.0,
            None => self.image(name).await?.ok_or_else(|| {
                let detail = format!(
                    "there is no image `{name}`: name a file part of the same form, or an id that POST /v1/images gave"
                );
                invalid(pointer.to_owned(), detail)
            })?,
        };
        taken.insert(name.to_owned(), Arc::clone(&image));
        Ok(image)
    }

    /// Waits until so much memory is free for an import; what is over the whole limit has to be alone.
    async fn import_memory(&self, bytes: u64) -> Option<OwnedSemaphorePermit> {
        let whole = mebibytes(self.core.limits.import_memory_bytes);
        // The semaphore is never closed.
        Arc::clone(&self.core.import_memory).acquire_many_owned(mebibytes(bytes).min(whole)).await.ok()
    }
}
