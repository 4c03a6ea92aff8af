//! The ledger and the blobs it names, kept in step: a blob is written before the ledger names it, and deleted only after
//! the ledger has dropped it.

use super::batch::BatchSpec;
use super::blobs::{BlobError, BlobRef, Blobs};
use super::job::Job;
use super::ledger::{Change, Kept, Leaving, Ledger, LedgerError, Restored, ScenePage, SceneRow};
use super::ledger::{audit, batches, jobs, known_blobs, next_batch, next_number, now, offers_image, offers_scene};
use super::ledger::{scene, scenes, unused_blobs, usage};
use super::outcome::{Developed, Outcome, Record};
use super::problem::{Code, Problem};
use super::saved::SavedFilm;
use bytes::Bytes;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::RwLock;

/// Seconds after which a client that met a fault of the storage should try again.
const RETRY_SECONDS: u32 = 10;

/// Longest time that a client waits for the ledger to take its job.
const PATIENCE: Duration = Duration::from_secs(10);

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
                let blobs = folder.join("blobs");
                std::fs::create_dir_all(&blobs)?;
                (Ledger::open(Some(&folder.join("ledger.sqlite")))?, Blobs::in_folder(&blobs)?)
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
        if self.ledger.commit(Change::UseScene(id.to_owned())).await.is_ok() {
            return Ok(false);
        }
        let mut stored = Vec::new();
        for (name, bytes) in files {
            stored.push((name.to_owned(), self.put(Bytes::from_owner(Arc::clone(bytes))).await?));
        }
        self.commit(Change::Scene { id: id.to_owned(), upload_bytes, files: stored }).await?;
        Ok(true)
    }

    /// Stores an image under the id that its content has, and says whether it is new.
    pub async fn store_image(&self, id: &str, bytes: Bytes) -> Result<bool, Problem> {
        let _gate = self.gate.read().await;
        if self.ledger.commit(Change::UseImage(id.to_owned())).await.is_ok() {
            return Ok(false);
        }
        let blob = self.put(bytes).await?;
        self.commit(Change::Image(blob)).await?;
        Ok(true)
    }

    /// A scene's files, the deleted one's too.
    pub async fn scene(&self, id: &str) -> Result<Option<SceneFiles>, Problem> {
        let wanted = id.to_owned();
        let found = self.ledger.ask(move |c| scene(c, &wanted)).await.map_err(|error| fault(&error))?;
        let Some((row, names)) = found else { return Ok(None) };
        let mut files = Vec::new();
        for (name, blob) in names {
            files.push((name, self.get(&blob).await?.to_vec()));
        }
        Ok(Some(SceneFiles { row, files }))
    }

    /// A page of scenes by id.
    pub async fn scenes(&self, after: &str, count: usize) -> Result<ScenePage, Problem> {
        let after = after.to_owned();
        self.ledger.ask(move |c| scenes(c, &after, count)).await.map_err(|error| fault(&error))
    }

    /// Whether there is a scene that clients may name.
    pub async fn offers_scene(&self, id: &str) -> Result<bool, Problem> {
        let id = id.to_owned();
        self.ledger.ask(move |c| offers_scene(c, &id)).await.map_err(|error| fault(&error))
    }

    /// Whether there is an image that clients may name.
    pub async fn offers_image(&self, id: &str) -> Result<bool, Problem> {
        let id = id.to_owned();
        self.ledger.ask(move |c| offers_image(c, &id)).await.map_err(|error| fault(&error))
    }

    /// Deletes a scene or an image as far as clients see; false if there is none.
    pub async fn delete(&self, change: Change) -> Result<bool, Problem> {
        match self.ledger.commit(change).await {
            Ok(()) => Ok(true),
            Err(LedgerError::Refused(_)) => Ok(false),
            Err(error) => Err(fault(&error)),
        }
    }

    /// Waits until the ledger has a job that was sent to it; false: its scene or its image is gone.
    pub async fn accepted(&self, sent: impl Future<Output = Result<(), LedgerError>>) -> Result<bool, Problem> {
        match tokio::time::timeout(PATIENCE, sent).await {
            Ok(Ok(())) => Ok(true),
            Ok(Err(LedgerError::Refused(_))) => Ok(false),
            Ok(Err(error)) => Err(fault(&error)),
            Err(late) => Err(fault(&late)),
        }
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
        job.settled().await;
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
        job.succeed(outcome, true);
        job.settled().await;
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
        let leaving = self.ledger.ask(move |c| Leaving::choose(c, &kept)).await.map_err(|error| fault(&error))?;
        if !leaving.is_empty() {
            self.forget(&leaving).await?;
            tell(&leaving);
        }
        let unused = self.ledger.ask(unused_blobs).await.map_err(|error| fault(&error))?;
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
        self.ledger.commit(change).await.map_err(|error| fault(&error))
    }
}

/// What a client is told when the storage is at fault; the log says more.
fn fault(error: &dyn std::error::Error) -> Problem {
    tracing::error!(%error, "storage");
    let detail = "the server cannot write or read its data; its log says more";
    Problem::new(Code::StorageUnavailable, detail).retry_after(RETRY_SECONDS)
}

/// Checks a data folder that no server uses: every rule that is broken, in words.
pub async fn audit_folder(folder: &Path) -> Result<Vec<String>, StorageError> {
    let ledger = Ledger::open(Some(&folder.join("ledger.sqlite")))?;
    let blobs = Blobs::in_folder(&folder.join("blobs"))?;
    let mut faults = ledger.ask(audit).await?;
    for id in ledger.ask(known_blobs).await? {
        if let Err(error) = blobs.get(&id).await {
            faults.push(format!("blob {id}: {error}"));
        }
    }
    ledger.close().await;
    Ok(faults)
}
