//! The ledger and the blobs it names, kept in step: a blob is written before the ledger names it, and deleted only after
//! the ledger has dropped it.

use super::batch::BatchSpec;
use super::blobs::{BlobError, BlobRef, Blobs};
use super::job::Job;
use super::ledger::{Change, Kept, Leaving, Ledger, LedgerError, Restored, ScenePage, SceneRow};
use super::ledger::{
    audit, batches, is_new, jobs, known_blobs, next_batch, next_number, now, offers_image, offers_scene,
};
use super::ledger::{scene, scenes, unused_blobs, usage};
use super::outcome::{Developed, Outcome, Record};
use super::problem::{Code, Problem};
use super::saved::SavedFilm;
use bytes::Bytes;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::RwLock;

/// Seconds after which a client that met a fault of the storage should try again.
const RETRY_SECONDS: u32 = 10;

/// Why the storage cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum StorageError {
    /// The folder.
    #[error("the folder cannot be made: {0}")]
    Folder(#[from] std::io::Error),
    /// The blobs.
    #[error(transparent)]
    Blobs(#[from] BlobError),
    /// The ledger.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// There are blobs, and a ledger that has never named any.
    #[error(
        "the folder holds {0} files of an earlier server in `blobs`, but no ledger that knows them: put its `ledger.sqlite` back, or move \
         `blobs` away"
    )]
    Orphans(usize),
}

/// What outlives a request, and a process where there is a folder for it.
#[derive(Debug)]
pub struct Storage {
    /// What there is and where it stands.
    pub ledger: Ledger,
    blobs: Blobs,
    is_durable: bool,
    /// Held for writing while blobs are deleted, for reading from before a blob is written until the ledger names it.
    gate: RwLock<()>,
}

/// What the ledger knew at the start.
pub struct Found {
    /// Its jobs, oldest first.
    pub jobs: Vec<Restored>,
    /// Its batches, oldest first.
    pub batches: Vec<BatchSpec>,
    /// Numbers of the next job and of the next batch.
    pub next: (i64, i64),
    /// Renders that clients were granted today.
    pub usage: Vec<(String, u64)>,
}

/// A scene as it was uploaded.
pub struct SceneFiles {
    /// What the ledger has of it.
    pub row: SceneRow,
    /// Name and content of each file.
    pub files: Vec<(String, Vec<u8>)>,
}

impl Storage {
    /// Opens what is in a folder, or makes it; none: memory.
    pub async fn open(folder: Option<&Path>) -> Result<(Self, Found), StorageError> {
        let (ledger, blobs) = match folder {
            None => (Ledger::open(None)?, Blobs::in_memory()),
            Some(folder) => {
                std::fs::create_dir_all(folder.join("blobs"))?;
                open_folder(folder).await?
            }
        };
        let jobs = ledger.ask(jobs).await?;
        let batches = ledger.ask(batches).await?;
        let next = (ledger.ask(next_number).await?, ledger.ask(next_batch).await?);
        let usage = ledger.ask(|c| usage(c, now())).await?;
        let storage = Self { ledger, blobs, is_durable: folder.is_some(), gate: RwLock::default() };
        storage.drop_strays().await?;
        Ok((storage, Found { jobs, batches, next, usage }))
    }

    /// Whether what is stored outlives the process.
    pub fn is_durable(&self) -> bool {
        self.is_durable
    }

    /// Blobs of a process that ended before the ledger named them.
    async fn drop_strays(&self) -> Result<(), StorageError> {
        let known = self.ledger.ask(known_blobs).await?;
        for id in self.blobs.list().await? {
            if !known.contains(&id) {
                self.blobs.delete(&id).await?;
            }
        }
        Ok(())
    }

    /// Stores a scene's files and says whether it is new.
    pub async fn store_scene<'a>(
        &self,
        id: &str,
        upload_bytes: u64,
        files: impl Iterator<Item = (&'a str, &'a Arc<[u8]>)>,
    ) -> Result<bool, Problem> {
        let _gate = self.gate.read().await;
        // Also what is known already: a file that was lost comes back with the upload.
        let mut stored = Vec::new();
        for (name, bytes) in files {
            stored.push((name.to_owned(), self.put(Bytes::from_owner(Arc::clone(bytes))).await?));
        }
        if self.known(Change::UseScene(id.to_owned())).await? {
            return Ok(false);
        }
        self.commit(Change::Scene { id: id.to_owned(), upload_bytes, files: stored }).await?;
        Ok(true)
    }

    /// Stores an image under the id that its content has, and says whether it is new.
    pub async fn store_image(&self, id: &str, bytes: Bytes) -> Result<bool, Problem> {
        let _gate = self.gate.read().await;
        let blob = self.put(bytes).await?;
        if self.known(Change::UseImage(id.to_owned())).await? {
            return Ok(false);
        }
        self.commit(Change::Image(blob)).await?;
        Ok(true)
    }

    /// Whether the ledger took a change, which it refuses for what it does not know.
    async fn known(&self, change: Change) -> Result<bool, Problem> {
        taken(self.ledger.commit(change).await)
    }

    /// A scene's files, the deleted one's too; none: there is no such scene, or a file of it is lost.
    pub async fn scene(&self, id: &str) -> Result<Option<SceneFiles>, Problem> {
        let wanted = id.to_owned();
        let found = self.ledger.ask(move |c| scene(c, &wanted)).await?;
        let Some((row, names)) = found else { return Ok(None) };
        let mut files = Vec::new();
        for (name, blob) in names {
            match self.blobs.get(&blob).await {
                Ok(bytes) => files.push((name, bytes.to_vec())),
                Err(error) if error.is_missing() => {
                    tracing::error!(%error, scene = %id, "a file is lost: the scene has to be uploaded again");
                    return Ok(None);
                }
                Err(error) => return Err(fault(&error)),
            }
        }
        Ok(Some(SceneFiles { row, files }))
    }

    /// A page of scenes by id.
    pub async fn scenes(&self, after: &str, count: usize) -> Result<ScenePage, Problem> {
        let after = after.to_owned();
        Ok(self.ledger.ask(move |c| scenes(c, &after, count)).await?)
    }

    /// Whether there is a scene that clients may name.
    pub async fn offers_scene(&self, id: &str) -> Result<bool, Problem> {
        let id = id.to_owned();
        Ok(self.ledger.ask(move |c| offers_scene(c, &id)).await?)
    }

    /// Whether there is an image that clients may name.
    pub async fn offers_image(&self, id: &str) -> Result<bool, Problem> {
        let id = id.to_owned();
        Ok(self.ledger.ask(move |c| offers_image(c, &id)).await?)
    }

    /// Deletes a scene or an image as far as clients see; false if there is none.
    pub async fn delete(&self, change: Change) -> Result<bool, Problem> {
        self.known(change).await
    }

    /// Waits until the ledger has a job that was sent to it; false: its scene or its image is gone.
    pub async fn accepted(&self, sent: impl Future<Output = Result<(), LedgerError>>) -> Result<bool, Problem> {
        taken(sent.await)
    }

    /// Stores a result and ends its job with it; false if the job was over.
    pub async fn succeed(
        &self,
        job: &Job,
        record: Record,
        file: Bytes,
        developed: &Developed,
    ) -> Result<bool, Problem> {
        let developed = developed.to_bytes().map_err(|error| fault(&error))?;
        let _gate = self.gate.read().await;
        let outcome = Outcome { record, file: self.put(file).await?, picture: Some(self.put(developed).await?) };
        let changed = job.succeed(Arc::new(outcome), false);
        // While the ledger cannot be written nothing is deleted either, so that the gate may open.
        let _ = job.settled().await;
        Ok(changed)
    }

    /// Ends a job with the result of another; false if that has left meanwhile.
    pub async fn succeed_with(&self, job: &Job, other: &Job) -> bool {
        let _gate = self.gate.read().await;
        let named = other.spec.number;
        let there = self.ledger.ask(move |c| {
            c.query_row("SELECT COUNT(*) FROM jobs WHERE number = ?1 AND file IS NOT NULL", [named], |row| row.get(0))
        });
        let there: i64 = there.await.unwrap_or(0);
        let Some(outcome) = other.outcome().filter(|_| there == 1) else { return false };
        if !self.blobs.holds(&outcome.file).await {
            return false;
        }
        job.succeed(outcome, true);
        let _ = job.settled().await;
        true
    }

    /// Saves an unfinished film.
    pub async fn save_film(&self, job: i64, film: Bytes) -> Result<(), Problem> {
        let _gate = self.gate.read().await;
        let blob = self.put(film).await?;
        self.commit(Change::Film { job, blob }).await
    }

    /// A film that was saved; none if it cannot be used: the job then begins anew.
    pub async fn film(&self, id: &str) -> Option<SavedFilm> {
        let bytes =
            self.blobs.get(id).await.inspect_err(|error| tracing::warn!(%error, "a saved film is lost")).ok()?;
        SavedFilm::from_bytes(&bytes)
    }

    /// Reads a blob.
    pub async fn get(&self, id: &str) -> Result<Bytes, Problem> {
        self.blobs.get(id).await.map_err(|error| fault(&error))
    }

    /// Lets go of what is beyond the bounds. `tell` hears what leaves as soon as the ledger has dropped it, while its files are still
    /// there.
    pub async fn tidy(&self, kept: Kept, tell: impl FnOnce(&Leaving)) -> Result<(), Problem> {
        let _gate = self.gate.write().await;
        let leaving = self.ledger.ask(move |c| Leaving::choose(c, &kept)).await?;
        if !leaving.is_empty() {
            self.forget(&leaving).await?;
            tell(&leaving);
        }
        let unused = self.ledger.ask(unused_blobs).await?;
        if !unused.is_empty() {
            // First the names, then the files: what a crash leaves between is a stray of the next start.
            self.commit(Change::DropBlobs(unused.clone())).await?;
        }
        for id in &unused {
            self.blobs.delete(id).await.map_err(|error| fault(&error))?;
        }
        Ok(())
    }

    /// Forgets jobs that are over, batches and uploads.
    pub async fn forget(&self, leaving: &Leaving) -> Result<(), Problem> {
        self.commit(Change::Forget(leaving.clone())).await
    }

    async fn put(&self, bytes: Bytes) -> Result<BlobRef, Problem> {
        self.blobs.put(bytes).await.map_err(|error| fault(&error))
    }

    async fn commit(&self, change: Change) -> Result<(), Problem> {
        Ok(self.ledger.commit(change).await?)
    }
}

/// Whether the ledger took a change; it refuses what does not fit.
fn taken(done: Result<(), LedgerError>) -> Result<bool, Problem> {
    match done {
        Ok(()) => Ok(true),
        Err(LedgerError::Refused(_)) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

impl From<LedgerError> for Problem {
    fn from(error: LedgerError) -> Self {
        fault(&error)
    }
}

/// What a client is told when the storage is at fault; the log says more.
fn fault(error: &dyn std::error::Error) -> Problem {
    tracing::error!(%error, "storage");
    let detail = "the server cannot write or read its data; its log says more";
    Problem::new(Code::StorageUnavailable, detail).retry_after(RETRY_SECONDS)
}

/// Ledger and blobs of a folder. Blobs without a ledger are somebody's who has restored one and not the other: nothing is made, and nothing deleted.
async fn open_folder(folder: &Path) -> Result<(Ledger, Blobs), StorageError> {
    let (file, blobs) = (folder.join("ledger.sqlite"), Blobs::in_folder(&folder.join("blobs"))?);
    if is_new(&file)? {
        match blobs.list().await?.len() {
            0 => {}
            orphans => return Err(StorageError::Orphans(orphans)),
        }
    }
    Ok((Ledger::open(Some(&file))?, blobs))
}

/// Checks a data folder that no server uses: every rule that is broken, in words.
pub async fn audit_folder(folder: &Path) -> Result<Vec<String>, StorageError> {
    let (ledger, blobs) = open_folder(folder).await?;
    let mut faults = ledger.ask(audit).await?;
    for id in ledger.ask(known_blobs).await? {
        if let Err(error) = blobs.get(&id).await {
            faults.push(format!("blob {id}: {error}"));
        }
    }
    ledger.close().await;
    Ok(faults)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn files_without_their_ledger_are_not_thrown_away() {
        let folder = tempfile::tempdir().unwrap();
        let open = || Storage::open(Some(folder.path()));
        let (storage, _) = open().await.unwrap();
        storage.store_image("sha256-x", Bytes::from_static(b"x")).await.unwrap();
        storage.ledger.close().await;
        open().await.unwrap().0.ledger.close().await;
        std::fs::remove_file(folder.path().join("ledger.sqlite")).unwrap();
        assert!(matches!(open().await, Err(StorageError::Orphans(1))));
        assert!(matches!(audit_folder(folder.path()).await, Err(StorageError::Orphans(1))));
        assert!(matches!(open().await, Err(StorageError::Orphans(1))), "nothing was made meanwhile");
    }
}
