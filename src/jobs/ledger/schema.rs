//! Opening the ledger's file, and bringing it up to date.

use super::LedgerError;
use rusqlite::{Connection, ErrorCode};
use std::path::Path;

/// Each brings the schema from the number of its place to the next; they are never changed, only added to.
const MIGRATIONS: &[&str] = &[include_str!("migrations/0001_jobs.sql"), include_str!("migrations/0002_batches.sql")];

/// Opens a file, or memory.
pub fn open(file: Option<&Path>) -> Result<Connection, LedgerError> {
    let connection = match file {
        Some(file) => Connection::open(file)?,
        None => Connection::open_in_memory()?,
    };
    prepare(&connection).map_err(|error| match error {
        LedgerError::Broken(rusqlite::Error::SqliteFailure(failure, _)) if failure.code == ErrorCode::DatabaseBusy => {
            LedgerError::InUse
        }
        other => other,
    })?;
    Ok(connection)
}

fn prepare(connection: &Connection) -> Result<(), LedgerError> {
    // The lock is held until the process ends, however it ends: a folder has one server.
    connection.pragma_update(None, "locking_mode", "EXCLUSIVE")?;
    connection.pragma_update(None, "journal_mode", "WAL")?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    connection.set_prepared_statement_cache_capacity(64);
    migrate(connection)
}

fn migrate(connection: &Connection) -> Result<(), LedgerError> {
    let transaction = connection.unchecked_transaction()?;
    let found: u32 = transaction.pragma_query_value(None, "user_version", |row| row.get(0))?;
    let found = found as usize;
    if found > MIGRATIONS.len() {
        return Err(LedgerError::Newer { found, known: MIGRATIONS.len() });
    }
    for migration in &MIGRATIONS[found..] {
        transaction.execute_batch(migration)?;
    }
    transaction.pragma_update(None, "user_version", MIGRATIONS.len() as u32)?;
    transaction.commit()?;
    Ok(())
}
