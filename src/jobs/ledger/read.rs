//! What is read back: the jobs at the start, scenes and images when they are wanted.

use super::DAY;
use crate::jobs::batch::BatchSpec;
use crate::jobs::blobs::BlobRef;
use crate::jobs::events::{Event, EventKind};
use crate::jobs::job::{Place, Spec};
use crate::jobs::outcome::Outcome;
use crate::jobs::problem::Problem;
use crate::jobs::state::State;
use rusqlite::types::Type;
use rusqlite::{Connection, OptionalExtension, Result, Row};
use serde::de::DeserializeOwned;

/// A job as the ledger has it.
#[derive(Debug)]
pub struct Restored {
    /// What was asked for.
    pub spec: Spec,
    /// Where it stands.
    pub state: State,
    /// What came of it.
    pub outcome: Option<Outcome>,
    /// Why it failed.
    pub problem: Option<Problem>,
    /// The film that was saved last.
    pub film: Option<String>,
    /// Its news.
    pub events: Vec<Event>,
    /// Newest id of an event that was ever given out.
    pub last_event: u64,
}

/// The number that the next job gets. No number is given out twice, whatever has left since.
pub fn next_number(c: &Connection) -> Result<i64> {
    let sql = "SELECT seq + 1 FROM sqlite_sequence WHERE name = 'jobs'";
    Ok(c.query_row(sql, [], |row| row.get(0)).optional()?.unwrap_or(1))
}

/// The number that the next batch gets.
pub fn next_batch(c: &Connection) -> Result<i64> {
    let sql = "SELECT seq + 1 FROM sqlite_sequence WHERE name = 'batches'";
    Ok(c.query_row(sql, [], |row| row.get(0)).optional()?.unwrap_or(1))
}

/// All batches, oldest first.
pub fn batches(c: &Connection) -> Result<Vec<BatchSpec>> {
    let mut query =
        c.prepare("SELECT number, id, idempotency_key, created, client, content FROM batches ORDER BY number")?;
    let rows = query.query_map([], |row| {
        Ok(BatchSpec {
            number: row.get(0)?,
            id: row.get(1)?,
            key: row.get(2)?,
            created: row.get(3)?,
            client: row.get(4)?,
            content: row.get(5)?,
        })
    })?;
    rows.collect()
}

/// Renders that clients were granted on the day of a time.
pub fn usage(c: &Connection, now: i64) -> Result<Vec<(String, u64)>> {
    let mut query = c.prepare("SELECT client, renders FROM usage WHERE day = ?1")?;
    let rows = query.query_map([now / DAY], |row| Ok((row.get(0)?, row.get::<_, i64>(1)? as u64)))?;
    rows.collect()
}

/// All jobs, oldest first.
pub fn jobs(c: &Connection) -> Result<Vec<Restored>> {
    let sql =
        "SELECT number, jobs.id, idempotency_key, created, scene, image, params, priority, client, attended, content,
                      state, problem, record, file, f.bytes, picture, p.bytes, film, last_event, batch, item, name, webhook
               FROM jobs LEFT JOIN blobs f ON f.id = file LEFT JOIN blobs p ON p.id = picture ORDER BY number";
    let mut query = c.prepare(sql)?;
    let mut jobs = query.query_map([], job)?.collect::<Result<Vec<_>>>()?;
    for job in &mut jobs {
        job.events = events(c, job.spec.number)?;
    }
    Ok(jobs)
}

fn job(row: &Row) -> Result<Restored> {
    let spec = Spec {
        number: row.get(0)?,
        id: row.get(1)?,
        key: row.get(2)?,
        created: row.get(3)?,
        scene: row.get(4)?,
        image: row.get(5)?,
        params: json(row, 6)?,
        priority: row.get(7)?,
        client: row.get(8)?,
        attended: row.get(9)?,
        content: row.get(10)?,
        place: place(row)?,
        webhook: row.get(23)?,
    };
    let blob = |id: usize| -> Result<Option<BlobRef>> {
        let bytes: Option<i64> = row.get(id + 1)?;
        Ok(row.get::<_, Option<String>>(id)?.zip(bytes).map(|(id, bytes)| BlobRef { id, bytes: bytes as u64 }))
    };
    let outcome = match (optional(row, 13)?, blob(14)?, blob(16)?) {
        (Some(record), Some(file), picture) => Some(Outcome { record, file, picture }),
        _ => None,
    };
    let state: String = row.get(11)?;
    Ok(Restored {
        spec,
        state: State::from_name(&state).ok_or_else(|| unreadable(11, format!("no state is named {state}")))?,
        outcome,
        problem: optional(row, 12)?,
        film: row.get(18)?,
        events: Vec::new(),
        last_event: row.get::<_, i64>(19)? as u64,
    })
}

fn place(row: &Row) -> Result<Option<Place>> {
    match (row.get(20)?, row.get(21)?, row.get(22)?) {
        (Some(batch), Some(item), Some(name)) => Ok(Some(Place { batch, item, name })),
        _ => Ok(None),
    }
}

fn events(c: &Connection, job: i64) -> Result<Vec<Event>> {
    let mut query = c.prepare_cached("SELECT id, kind, data FROM events WHERE job = ?1 ORDER BY id")?;
    let rows = query.query_map([job], |row| {
        let kind: String = row.get(1)?;
        let kind = EventKind::from_name(&kind).ok_or_else(|| unreadable(1, format!("no event is named {kind}")))?;
        Ok(Event { id: row.get::<_, i64>(0)? as u64, kind, data: json(row, 2)? })
    })?;
    rows.collect()
}

fn json<T: DeserializeOwned>(row: &Row, column: usize) -> Result<T> {
    serde_json::from_str(&row.get::<_, String>(column)?).map_err(|error| unreadable(column, error.to_string()))
}

fn optional<T: DeserializeOwned>(row: &Row, column: usize) -> Result<Option<T>> {
    match row.get::<_, Option<String>>(column)? {
        Some(_) => json(row, column).map(Some),
        None => Ok(None),
    }
}

fn unreadable(column: usize, why: String) -> rusqlite::Error {
    rusqlite::Error::FromSqlConversionFailure(column, Type::Text, why.into())
}

/// A scene as the ledger has it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneRow {
    /// Id of the scene.
    pub id: String,
    /// Bytes of the upload.
    pub upload_bytes: u64,
}

/// A page of scenes by id, and whether there are more.
pub type ScenePage = (Vec<SceneRow>, bool);

/// A scene, and name and blob of each of its files.
pub type SceneWithFiles = (SceneRow, Vec<(String, String)>);

/// A scene of an id.
pub fn scene(c: &Connection, id: &str) -> Result<Option<SceneWithFiles>> {
    let sql = "SELECT id, upload_bytes FROM scenes WHERE id = ?1";
    let Some(found) = c.query_row(sql, [id], scene_row).optional()? else { return Ok(None) };
    let mut query = c.prepare_cached("SELECT name, blob FROM scene_files WHERE scene = ?1")?;
    let files = query.query_map([id], |row| Ok((row.get(0)?, row.get(1)?)))?.collect::<Result<_>>()?;
    Ok(Some((found, files)))
}

/// Up to `count` scenes with ids after `after`.
pub fn scenes(c: &Connection, after: &str, count: usize) -> Result<ScenePage> {
    let sql = "SELECT id, upload_bytes FROM scenes WHERE id > ?1 AND NOT deleted ORDER BY id LIMIT ?2";
    let mut query = c.prepare_cached(sql)?;
    let mut rows = query.query_map((after, count as i64 + 1), scene_row)?.collect::<Result<Vec<_>>>()?;
    let more = rows.len() > count;
    rows.truncate(count);
    Ok((rows, more))
}

fn scene_row(row: &Row) -> Result<SceneRow> {
    Ok(SceneRow { id: row.get(0)?, upload_bytes: row.get::<_, i64>(1)? as u64 })
}

/// Whether there is a scene that clients may name: jobs may still need one that has been deleted.
pub fn offers_scene(c: &Connection, id: &str) -> Result<bool> {
    c.prepare_cached("SELECT 1 FROM scenes WHERE id = ?1 AND NOT deleted")?.exists([id])
}

/// The same of an image.
pub fn offers_image(c: &Connection, id: &str) -> Result<bool> {
    c.prepare_cached("SELECT 1 FROM images WHERE id = ?1 AND NOT deleted")?.exists([id])
}
