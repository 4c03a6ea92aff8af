//! Everything that is ever written to the ledger.

use super::{DAY, deliveries, now};
use crate::jobs::batch::BatchSpec;
use crate::jobs::blobs::BlobRef;
use crate::jobs::events::Event;
use crate::jobs::job::Spec;
use crate::jobs::outcome::Outcome;
use crate::jobs::problem::Problem;
use rusqlite::{Connection, Result, named_params, params};
use serde::Serialize;
use std::sync::Arc;

/// A change of the ledger.
#[derive(Debug)]
pub enum Change {
    /// A scene was uploaded: its files by name. If it is known, it counts as used again.
    Scene {
        /// Id of the scene.
        id: String,
        /// Bytes of the upload.
        upload_bytes: u64,
        /// Its files.
        files: Vec<(String, BlobRef)>,
    },
    /// An image was uploaded.
    Image(BlobRef),
    /// A scene that must be known and not deleted counts as used again.
    UseScene(String),
    /// The same of an image.
    UseImage(String),
    /// A scene is gone as far as clients see.
    DeleteScene(String),
    /// The same of an image.
    DeleteImage(String),
    /// A job was accepted, with its first event. Scene and image must be there.
    Job(Arc<Spec>, Event),
    /// A batch was accepted, with all its jobs or not at all.
    Batch(Arc<BatchSpec>, Vec<(Arc<Spec>, Event)>),
    /// Something happened to a job; none: it stands as before.
    Event {
        /// Number of the job.
        job: i64,
        /// What happened.
        event: Event,
        /// Where the job stands now.
        standing: Option<Standing>,
    },
    /// The unfinished film of a job was saved; the one before it is of no more use.
    Film {
        /// Number of the job.
        job: i64,
        /// The film.
        blob: BlobRef,
    },
    /// The end of a job was told.
    Delivered(String),
    /// A message was not taken, and is to be sent again.
    Postponed {
        /// Id of the message.
        id: String,
        /// When: milliseconds since 1970.
        due: i64,
    },
    /// A message is not sent any more.
    GivenUp(String),
    /// Jobs, scenes and images leave.
    Forget(super::Leaving),
    /// Blobs that nothing names were deleted.
    DropBlobs(Vec<String>),
}

/// Where a job stands after an event, with what comes with it.
#[derive(Debug, Clone)]
pub enum Standing {
    /// Waits, for the first time or after a restart.
    Queued,
    /// The device works on it.
    Running,
    /// It has a result.
    Succeeded(Arc<Outcome>),
    /// It has a problem.
    Failed(Problem),
    /// Someone ended it.
    Cancelled,
}

impl Standing {
    /// Name of the state, if nothing can follow.
    fn end(&self) -> Option<&'static str> {
        match self {
            Self::Queued | Self::Running => None,
            Self::Succeeded(_) => Some("succeeded"),
            Self::Failed(_) => Some("failed"),
            Self::Cancelled => Some("cancelled"),
        }
    }
}

impl Change {
    /// Writes the change, within a transaction.
    pub(super) fn apply(&self, c: &Connection) -> Result<()> {
        match self {
            Self::Scene { id, upload_bytes, files } => scene(c, id, *upload_bytes, files),
            Self::Image(blob) => image(c, blob),
            Self::UseScene(id) => {
                one(c.execute("UPDATE scenes SET used = ?2 WHERE id = ?1 AND NOT deleted", params![id, now()])?)
            }
            Self::UseImage(id) => {
                one(c.execute("UPDATE images SET used = ?2 WHERE id = ?1 AND NOT deleted", params![id, now()])?)
            }
            Self::DeleteScene(id) => {
                one(c.execute("UPDATE scenes SET deleted = 1 WHERE id = ?1 AND NOT deleted", [id])?)
            }
            Self::DeleteImage(id) => {
                one(c.execute("UPDATE images SET deleted = 1 WHERE id = ?1 AND NOT deleted", [id])?)
            }
            Self::Job(spec, first) => job(c, spec, first),
            Self::Batch(spec, jobs) => batch(c, spec, jobs),
            Self::Event { job, event, standing } => {
                if let Some(standing) = standing {
                    stand(c, *job, standing)?;
                    if let Some(state) = standing.end() {
                        deliveries::note(c, *job, state, now(), event)?;
                    }
                }
                happen(c, *job, event)
            }
            Self::Film { job, blob } => {
                keep(c, blob)?;
                // A job that has ended meanwhile needs none.
                let sql = "UPDATE jobs SET film = ?2 WHERE number = ?1 AND ended IS NULL";
                c.prepare_cached(sql)?.execute(params![job, blob.id]).map(drop)
            }
            Self::Delivered(id) | Self::GivenUp(id) => deliveries::forget(c, id),
            Self::Postponed { id, due } => deliveries::postpone(c, id, *due),
            Self::Forget(leaving) => leaving.apply(c),
            Self::DropBlobs(ids) => {
                let mut drop_one = c.prepare_cached("DELETE FROM blobs WHERE id = ?1")?;
                ids.iter().try_for_each(|id| drop_one.execute([id]).map(drop))
            }
        }
    }
}

/// The change is refused unless it met a row.
fn one(rows: usize) -> Result<()> {
    if rows == 1 { Ok(()) } else { Err(rusqlite::Error::QueryReturnedNoRows) }
}

fn keep(c: &Connection, blob: &BlobRef) -> Result<()> {
    let mut insert = c.prepare_cached("INSERT INTO blobs (id, bytes) VALUES (?1, ?2) ON CONFLICT DO NOTHING")?;
    insert.execute(params![blob.id, blob.bytes as i64]).map(drop)
}

fn scene(c: &Connection, id: &str, upload_bytes: u64, files: &[(String, BlobRef)]) -> Result<()> {
    c.execute(
        "INSERT INTO scenes (id, upload_bytes, used) VALUES (?1, ?2, ?3)
         ON CONFLICT DO UPDATE SET used = excluded.used, deleted = 0",
        params![id, upload_bytes as i64, now()],
    )?;
    for (name, blob) in files {
        keep(c, blob)?;
        let sql = "INSERT INTO scene_files (scene, name, blob) VALUES (?1, ?2, ?3) ON CONFLICT DO NOTHING";
        c.execute(sql, params![id, name, blob.id])?;
    }
    Ok(())
}

fn image(c: &Connection, blob: &BlobRef) -> Result<()> {
    keep(c, blob)?;
    let sql = "INSERT INTO images (id, used) VALUES (?1, ?2)
               ON CONFLICT DO UPDATE SET used = excluded.used, deleted = 0";
    c.execute(sql, params![blob.id, now()]).map(drop)
}

fn job(c: &Connection, spec: &Spec, first: &Event) -> Result<()> {
    one(c.execute("UPDATE scenes SET used = ?2 WHERE id = ?1", params![spec.scene, now()])?)?;
    for image in spec.image.as_deref().into_iter().chain(spec.params.map_names()).chain(spec.params.profile_names()) {
        one(c.execute("UPDATE images SET used = ?2 WHERE id = ?1", params![image, now()])?)?;
    }
    let insert = "INSERT INTO jobs (number, id, idempotency_key, created, state, scene, image, params, priority,
                                    client, attended, content, last_event, batch, item, name, webhook)
                  VALUES (:number, :id, :key, :created, 'queued', :scene, :image, :params, :priority,
                          :client, :attended, :content, 0, :batch, :item, :name, :webhook)";
    let place = spec.place.as_ref();
    c.prepare_cached(insert)?.execute(named_params! {
        ":number": spec.number,
        ":id": spec.id,
        ":key": spec.key,
        ":created": spec.created,
        ":scene": spec.scene,
        ":image": spec.image,
        ":params": text(&spec.params)?,
        ":priority": spec.priority,
        ":client": spec.client,
        ":attended": spec.attended,
        ":content": spec.content,
        ":batch": place.map(|place| place.batch),
        ":item": place.map(|place| place.item),
        ":name": place.map(|place| &place.name),
        ":webhook": spec.webhook,
    })?;
    let count = "INSERT INTO usage (client, day, renders) VALUES (?1, ?2, 1)
                 ON CONFLICT DO UPDATE SET renders = renders + 1";
    c.prepare_cached(count)?.execute(params![spec.client, spec.created / DAY])?;
    happen(c, spec.number, first)
}

fn batch(c: &Connection, spec: &BatchSpec, jobs: &[(Arc<Spec>, Event)]) -> Result<()> {
    let insert = "INSERT INTO batches (number, id, idempotency_key, created, client, content)
                  VALUES (?1, ?2, ?3, ?4, ?5, ?6)";
    let BatchSpec { number, id, key, created, client, content } = spec;
    c.prepare_cached(insert)?.execute(params![number, id, key, created, client, content])?;
    jobs.iter().try_for_each(|(spec, first)| job(c, spec, first))
}

/// The newest preview or progress takes the place of the one before; all else stays.
fn happen(c: &Connection, job: i64, event: &Event) -> Result<()> {
    if event.kind.is_superseded() {
        let sql = "DELETE FROM events WHERE job = ?1 AND kind = ?2";
        c.prepare_cached(sql)?.execute(params![job, event.kind.name()])?;
    }
    let insert = "INSERT INTO events (job, id, kind, data) VALUES (?1, ?2, ?3, ?4)";
    let (id, kind, data) = (event.id as i64, event.kind.name(), event.data.to_string());
    c.prepare_cached(insert)?.execute(params![job, id, kind, data])?;
    // An id is never given out twice.
    let advance = "UPDATE jobs SET last_event = ?2 WHERE number = ?1 AND last_event < ?2";
    one(c.prepare_cached(advance)?.execute(params![job, id])?)
}

fn stand(c: &Connection, job: i64, standing: &Standing) -> Result<()> {
    let moved = |state: &str| {
        c.prepare_cached("UPDATE jobs SET state = ?2 WHERE number = ?1")?.execute(params![job, state]).map(drop)
    };
    let end = "UPDATE jobs SET state = ?2, ended = ?3, problem = ?4, film = NULL WHERE number = ?1 AND ended IS NULL";
    match standing {
        Standing::Queued => moved("queued"),
        Standing::Running => moved("running"),
        Standing::Succeeded(outcome) => succeed(c, job, outcome),
        Standing::Failed(problem) => {
            one(c.prepare_cached(end)?.execute(params![job, "failed", now(), text(problem)?])?)
        }
        Standing::Cancelled => one(c.prepare_cached(end)?.execute(params![job, "cancelled", now(), None::<String>])?),
    }
}

fn succeed(c: &Connection, job: i64, outcome: &Outcome) -> Result<()> {
    keep(c, &outcome.file)?;
    if let Some(picture) = &outcome.picture {
        keep(c, picture)?;
    }
    let sql = "UPDATE jobs SET state = 'succeeded', ended = ?2, record = ?3, file = ?4, picture = ?5, film = NULL
               WHERE number = ?1 AND ended IS NULL";
    let picture = outcome.picture.as_ref().map(|picture| &picture.id);
    let values = params![job, now(), text(&outcome.record)?, outcome.file.id, picture];
    one(c.prepare_cached(sql)?.execute(values)?)
}

fn text(value: &impl Serialize) -> Result<String> {
    serde_json::to_string(value).map_err(|error| rusqlite::Error::ToSqlConversionFailure(Box::new(error)))
}
