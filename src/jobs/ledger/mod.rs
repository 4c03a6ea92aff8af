//! What the service must not forget, in SQLite: one thread owns the connection, and writes what has gathered in one
//! transaction. After a change was confirmed it survives the end of the process and the loss of power.

mod audit;
mod change;
mod deliveries;
mod read;
mod retention;
mod schema;

pub use audit::audit;
pub use change::{Change, Standing};
pub use deliveries::{Delivery, deliveries};
pub use read::{
    Restored, ScenePage, SceneRow, batches, jobs, next_batch, next_number, offers_image, offers_scene, scene, scenes,
    usage,
};
pub use retention::{Kept, Leaving, known_blobs, unused_blobs};
pub use schema::is_new;

use rusqlite::{Connection, ErrorCode};
use std::path::Path;
use std::sync::mpsc;
use std::time::Duration;
use tokio::sync::{oneshot, watch};

/// Changes of one transaction, at the most.
const BATCH: usize = 256;

/// Pause after the medium was at fault (a full disk, say), until the same changes are tried again.
const RETRY: Duration = Duration::from_millis(500);

/// How long the medium may be at fault before whoever waits is told.
const GRACE: Duration = Duration::from_secs(1);

/// Why the ledger did not take a change, or cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// The change does not fit what is there: it names a scene that is gone, for one.
    #[error("the change does not fit what the ledger holds: {0}")]
    Refused(rusqlite::Error),
    /// It cannot be opened or read.
    #[error("the ledger cannot be read: {0} (is its disk full, failing or read-only? docs/operations.md has backups)")]
    Broken(#[from] rusqlite::Error),
    /// It was written by a newer version.
    #[error(
        "the ledger has schema {found}, newer than {known} of this version: start the newer one, or with another folder (--data)"
    )]
    Newer {
        /// Schema of the file.
        found: usize,
        /// Newest schema that this version knows.
        known: usize,
    },
    /// Another process has it.
    #[error("another server uses this folder: end that one, or give this one a folder of its own (--data)")]
    InUse,
    /// The medium is at fault (a full disk, say). What was given to it is written once that is over.
    #[error("the ledger cannot be written at present")]
    Stuck,
    /// Its thread has ended.
    #[error("the ledger is closed")]
    Closed,
}

/// What to do once a change is durable, or was refused.
type Then = Box<dyn FnOnce(Result<(), LedgerError>) + Send>;

/// A question to the ledger, on its thread.
type Question = Box<dyn FnOnce(&Connection) + Send>;

enum Command {
    Write(Box<Change>, Then),
    Read(Question),
    Close(oneshot::Sender<()>),
}

/// A handle to the ledger. Cloning gives another handle to the same ledger; its thread ends with the last one.
#[derive(Debug, Clone)]
pub struct Ledger {
    commands: mpsc::Sender<Command>,
    /// Whether the last try to write failed.
    is_stuck: watch::Receiver<bool>,
}

impl Ledger {
    /// Opens the ledger of a file, or makes it; none: one that ends with the process. Blocks.
    pub fn open(file: Option<&Path>) -> Result<Self, LedgerError> {
        let connection = schema::open(file)?;
        let (commands, inbox) = mpsc::channel();
        let (stuck, is_stuck) = watch::channel(false);
        std::thread::spawn(move || serve(connection, &inbox, &stuck));
        Ok(Self { commands, is_stuck })
    }

    /// Whether it cannot be written at present.
    pub fn is_stuck(&self) -> bool {
        *self.is_stuck.borrow()
    }

    /// Waits for what the ledger does, though not while the medium is at fault.
    ///
    /// # Errors
    /// [`LedgerError::Stuck`].
    pub async fn unless_stuck<T>(&self, work: impl Future<Output = T>) -> Result<T, LedgerError> {
        let mut news = self.is_stuck.clone();
        let stuck = async {
            loop {
                // Its thread has ended: `work` says so.
                if news.wait_for(|stuck| *stuck).await.is_err() {
                    std::future::pending::<()>().await;
                }
                if tokio::time::timeout(GRACE, news.wait_for(|stuck| !*stuck)).await.is_err() {
                    return;
                }
            }
        };
        tokio::select! {
            biased;
            done = work => Ok(done),
            () = stuck => Err(LedgerError::Stuck),
        }
    }

    /// Writes a change some time soon, after all that were given before; `then` is called when it is durable.
    pub fn record(&self, change: Change, then: impl FnOnce() + Send + 'static) {
        let then = move |done: Result<(), LedgerError>| match done {
            Ok(()) => then(),
            Err(error) => tracing::error!(%error, "a change was not recorded"),
        };
        // The thread ends only after the last handle, so that this cannot fail.
        let _ = self.commands.send(Command::Write(Box::new(change), Box::new(then)));
    }

    /// Writes a change after all that were given before; what it returns waits until it is durable. One that is told
    /// [`LedgerError::Stuck`] is written all the same, later.
    pub fn commit(&self, change: Change) -> impl Future<Output = Result<(), LedgerError>> + Send + use<> {
        let (tell, told) = oneshot::channel();
        let then = move |done| {
            let _ = tell.send(done);
        };
        let _ = self.commands.send(Command::Write(Box::new(change), Box::new(then)));
        let ledger = self.clone();
        async move { ledger.unless_stuck(told).await?.unwrap_or(Err(LedgerError::Closed)) }
    }

    /// Ends the ledger after all that was given before: its file is free for another process then, and later changes are not
    /// taken. While the medium is at fault it does not end: what nobody was told of is then lost with the process.
    pub async fn close(&self) {
        let (tell, told) = oneshot::channel();
        let _ = self.commands.send(Command::Close(tell));
        let _ = self.unless_stuck(told).await;
    }

    /// Asks something, after all changes that were given before.
    pub async fn ask<T: Send + 'static>(
        &self,
        question: impl FnOnce(&Connection) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, LedgerError> {
        let (tell, told) = oneshot::channel();
        let asked = move |connection: &Connection| {
            let _ = tell.send(question(connection));
        };
        let _ = self.commands.send(Command::Read(Box::new(asked)));
        Ok(self.unless_stuck(told).await?.map_err(|_| LedgerError::Closed)??)
    }
}

/// The ledger's thread.
fn serve(connection: Connection, inbox: &mpsc::Receiver<Command>, stuck: &watch::Sender<bool>) {
    let mut batch = Vec::new();
    while let Ok(first) = inbox.recv() {
        for command in std::iter::once(first).chain(inbox.try_iter().take(BATCH)) {
            match command {
                Command::Write(change, then) => batch.push((change, then)),
                Command::Read(question) => {
                    write(&connection, &mut batch, stuck);
                    question(&connection);
                }
                Command::Close(done) => {
                    write(&connection, &mut batch, stuck);
                    drop(connection);
                    let _ = done.send(());
                    return;
                }
            }
        }
        write(&connection, &mut batch, stuck);
    }
}

/// Writes a batch, however long it takes, and empties it.
fn write(connection: &Connection, batch: &mut Vec<(Box<Change>, Then)>, stuck: &watch::Sender<bool>) {
    if batch.is_empty() {
        return;
    }
    let results = loop {
        match try_write(connection, batch) {
            Ok(results) => break results,
            Err(error) => {
                tracing::error!(%error, "the ledger cannot be written; trying again");
                stuck.send_replace(true);
                std::thread::sleep(RETRY);
            }
        }
    };
    stuck.send_if_modified(std::mem::take);
    for ((_, then), result) in batch.drain(..).zip(results) {
        then(result.map_err(LedgerError::Refused));
    }
}

/// One transaction; a change that does not fit leaves the others as they are.
fn try_write(connection: &Connection, batch: &[(Box<Change>, Then)]) -> rusqlite::Result<Vec<rusqlite::Result<()>>> {
    let transaction = connection.unchecked_transaction()?;
    let mut results = Vec::with_capacity(batch.len());
    for (change, _) in batch {
        transaction.execute_batch("SAVEPOINT change")?;
        let done = change.apply(&transaction);
        match &done {
            Ok(()) => {}
            Err(error) if does_not_fit(error) => transaction.execute_batch("ROLLBACK TO change")?,
            Err(_) => return done.map(|()| results),
        }
        transaction.execute_batch("RELEASE change")?;
        results.push(done);
    }
    transaction.commit()?;
    Ok(results)
}

/// Whether the change is at fault rather than the medium.
fn does_not_fit(error: &rusqlite::Error) -> bool {
    match error {
        rusqlite::Error::SqliteFailure(failure, _) => failure.code == ErrorCode::ConstraintViolation,
        rusqlite::Error::QueryReturnedNoRows | rusqlite::Error::ToSqlConversionFailure(_) => true,
        _ => false,
    }
}

/// Milliseconds of a day.
pub const DAY: i64 = 24 * 3_600_000;

/// Milliseconds since 1970.
pub fn now() -> i64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests;
