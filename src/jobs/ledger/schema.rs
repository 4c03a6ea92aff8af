//! Opening the ledger's file, and bringing it up to date.

use super::LedgerError;
use rusqlite::{Connection, ErrorCode};
use std::path::Path;

/// Each brings the schema from the number of its place to the next; they are never changed, only added to.
const MIGRATIONS: &[&str] = &[
    include_str!("migrations/0001_jobs.sql"),
    include_str!("migrations/0002_batches.sql"),
    include_str!("migrations/0003_pictures.sql"),
    include_str!("migrations/0004_idempotency.sql"),
];

/// Opens a file, or memory.
pub fn open(file: Option<&Path>) -> Result<Connection, LedgerError> {
    let connection = match file {
        Some(file) => Connection::open(file)?,
        None => Connection::open_in_memory()?,
    };
    prepare(&connection).map_err(in_use)?;
    Ok(connection)
}

/// Whether there is no ledger in a file, or an empty one that no server has opened.
pub fn is_new(file: &Path) -> Result<bool, LedgerError> {
    let version = || Connection::open(file)?.pragma_query_value(None, "user_version", |row| row.get::<_, u32>(0));
    Ok(!file.exists() || version().map_err(|error| in_use(error.into()))? == 0)
}

fn in_use(error: LedgerError) -> LedgerError {
    match error {
        LedgerError::Broken(rusqlite::Error::SqliteFailure(failure, _)) if failure.code == ErrorCode::DatabaseBusy => {
            LedgerError::InUse
        }
        other => other,
    }
}

fn prepare(connection: &Connection) -> Result<(), LedgerError> {
    // The lock is held until the process ends, however it ends: a folder has one server.
    connection.pragma_update(None, "locking_mode", "EXCLUSIVE")?;
    connection.pragma_update(None, "journal_mode", "WAL")?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.set_prepared_statement_cache_capacity(64);
    // A table that is made anew must not take with it what refers to it (https://sqlite.org/lang_altertable.html, 8).
    connection.pragma_update(None, "foreign_keys", false)?;
    migrate(connection, MIGRATIONS)?;
    connection.pragma_update(None, "foreign_keys", true)?;
    Ok(())
}

/// Brings the schema to the newest of some migrations.
fn migrate(connection: &Connection, migrations: &[&str]) -> Result<(), LedgerError> {
    let transaction = connection.unchecked_transaction()?;
    let found: u32 = transaction.pragma_query_value(None, "user_version", |row| row.get(0))?;
    let found = found as usize;
    if found > migrations.len() {
        return Err(LedgerError::Newer { found, known: migrations.len() });
    }
    for migration in &migrations[found..] {
        transaction.execute_batch(migration)?;
    }
    transaction.pragma_update(None, "user_version", migrations.len() as u32)?;
    transaction.commit()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ledger_of_an_older_schema_is_brought_up_to_date_with_all_that_is_in_it() {
        let connection = Connection::open_in_memory().unwrap();
        connection.pragma_update(None, "foreign_keys", false).unwrap();
        migrate(&connection, &MIGRATIONS[..2]).unwrap();
        let old = "INSERT INTO blobs VALUES ('f', 1), ('p', 2);
             INSERT INTO jobs (number, id, created, ended, state, scene, params, priority, client, attended, content, last_event, record,
                               file, picture, idempotency_key)
             VALUES (3, 'job-3', 1, 2, 'succeeded', 's', '{}', 0, 'key:c', 0, 'x', 2, '{}', 'f', 'p', 'k'),
                    (7, 'job-7', 1, 2, 'succeeded', 's', '{}', 0, 'key:c', 0, 'x', 2, '{}', 'f', 'p', NULL);
             INSERT INTO events VALUES (3, 1, 'queued', '{}');
             DELETE FROM jobs WHERE number = 7;";
        connection.execute_batch(old).unwrap();
        prepare(&connection).unwrap();
        let text = |sql: &str| connection.query_row(sql, [], |row| row.get::<_, String>(0)).unwrap();
        assert_eq!(text("SELECT id || file || picture FROM jobs"), "job-3fp");
        assert_eq!(text("SELECT idempotency_key FROM jobs"), "key:c k", "of one API key");
        assert_eq!(text("SELECT kind FROM events WHERE job = 3"), "queued");
        assert_eq!(text("SELECT CAST(seq AS TEXT) FROM sqlite_sequence WHERE name = 'jobs'"), "7", "given out once");
        connection.execute("UPDATE jobs SET picture = NULL", []).unwrap();
        assert!(connection.execute("UPDATE jobs SET file = NULL", []).is_err(), "a success has a file");
        assert!(connection.execute("DELETE FROM blobs WHERE id = 'f'", []).is_err(), "references hold");
        connection.execute("DELETE FROM jobs", []).unwrap();
        assert_eq!(text("SELECT CAST(COUNT(*) AS TEXT) FROM events"), "0", "events leave with their job");
    }
}
