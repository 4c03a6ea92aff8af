//! What leaves the ledger, by age and by bytes, and which blobs are then of no more use.
//!
//! Linear pictures, most of the bytes, leave before any file does: a job without one is whole but for other formats and AOVs.

use super::{DAY, now};
use rusqlite::{Connection, Result};
use std::cmp::Reverse;
use std::collections::{HashMap, HashSet};

/// How much is kept.
#[derive(Debug, Clone, Copy)]
pub struct Kept {
    /// Finished jobs.
    pub jobs: usize,
    /// Bytes of their results, each blob counted once.
    pub result_bytes: u64,
    /// Bytes of scenes and images.
    pub upload_bytes: u64,
    /// Milliseconds since a job ended, or an upload was last used.
    pub age: i64,
}

/// What leaves.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Leaving {
    /// Numbers of jobs.
    pub jobs: Vec<i64>,
    /// Numbers of jobs that stay, and whose linear pictures leave.
    pub pictures: Vec<i64>,
    /// Numbers of batches, all of whose jobs leave.
    pub batches: Vec<i64>,
    /// Ids of scenes.
    pub scenes: Vec<String>,
    /// Ids of images.
    pub images: Vec<String>,
}

impl Leaving {
    /// What is beyond the bounds: the oldest leave first, what an unfinished job needs stays.
    pub fn choose(c: &Connection, kept: &Kept) -> Result<Self> {
        let (scenes, images) = uploads(c, kept)?;
        Ok(Self { scenes, images, ..jobs(c, kept)? })
    }

    /// Whether nothing leaves.
    pub fn is_empty(&self) -> bool {
        self.jobs.is_empty() && self.pictures.is_empty() && self.scenes.is_empty() && self.images.is_empty()
    }

    pub(super) fn apply(&self, c: &Connection) -> Result<()> {
        let mut job = c.prepare_cached("DELETE FROM jobs WHERE number = ?1 AND ended IS NOT NULL")?;
        self.jobs.iter().try_for_each(|number| job.execute([number]).map(drop))?;
        let mut picture = c.prepare_cached("UPDATE jobs SET picture = NULL WHERE number = ?1")?;
        self.pictures.iter().try_for_each(|number| picture.execute([number]).map(drop))?;
        let mut batch = c.prepare_cached("DELETE FROM batches WHERE number = ?1")?;
        self.batches.iter().try_for_each(|number| batch.execute([number]).map(drop))?;
        c.execute("DELETE FROM usage WHERE day < ?1", [now() / DAY])?;
        let unused = |table: &str, needs: &str| {
            let sql = format!(
                "DELETE FROM {table} WHERE id = ?1 AND NOT EXISTS (SELECT 1 FROM jobs WHERE ({needs}) AND ended IS NULL)"
            );
            c.prepare_cached(&sql)
        };
        // Parameters name maps by their ids.
        let (mut scene, mut image) =
            (unused("scenes", "scene = ?1")?, unused("images", "image = ?1 OR instr(params, ?1)")?);
        self.scenes.iter().try_for_each(|id| scene.execute([id]).map(drop))?;
        self.images.iter().try_for_each(|id| image.execute([id]).map(drop))
    }
}

/// Finished jobs that leave together: one, or those of a batch.
struct Unit {
    jobs: Vec<Finished>,
    batch: Option<i64>,
    /// When the last of them ended.
    ended: i64,
    /// Jobs of its batch are under way: it stays.
    is_open: bool,
}

/// A finished job.
struct Finished {
    number: i64,
    ended: i64,
    file: Option<Held>,
    picture: Option<Held>,
}

/// A blob and its bytes.
type Held = (String, u64);

/// All units, the one that ended last first.
fn units(c: &Connection) -> Result<Vec<Unit>> {
    let mut open = c.prepare_cached("SELECT DISTINCT batch FROM jobs WHERE ended IS NULL AND batch IS NOT NULL")?;
    let open = open.query_map([], |row| row.get(0))?.collect::<Result<HashSet<i64>>>()?;
    let sql = "SELECT number, ended, file, f.bytes, picture, p.bytes, batch FROM jobs
               LEFT JOIN blobs f ON f.id = file LEFT JOIN blobs p ON p.id = picture
               WHERE ended IS NOT NULL ORDER BY ended DESC, number DESC";
    let mut query = c.prepare_cached(sql)?;
    let mut rows = query.query([])?;
    let (mut units, mut places) = (Vec::<Unit>::new(), HashMap::new());
    while let Some(row) = rows.next()? {
        let (ended, batch): (i64, Option<i64>) = (row.get(1)?, row.get(6)?);
        let place = batch.map_or(units.len(), |batch| *places.entry(batch).or_insert(units.len()));
        if place == units.len() {
            let is_open = batch.is_some_and(|batch| open.contains(&batch));
            units.push(Unit { jobs: Vec::new(), batch, ended, is_open });
        }
        let held = |column: usize| -> Result<Option<Held>> {
            let bytes: Option<i64> = row.get(column + 1)?;
            Ok(row.get::<_, Option<String>>(column)?.zip(bytes.map(|bytes| bytes as u64)))
        };
        let job = Finished { number: row.get(0)?, ended, file: held(2)?, picture: held(4)? };
        if let Some(unit) = units.get_mut(place) {
            unit.jobs.push(job);
        }
    }
    Ok(units)
}

/// The jobs and the batches that leave, and the linear pictures.
fn jobs(c: &Connection, kept: &Kept) -> Result<Leaving> {
    let oldest = now().saturating_sub(kept.age);
    let (mut files, mut count, mut is_newest) = (Blobs::default(), 0, true);
    let (mut leaving, mut staying) = (Leaving::default(), Vec::new());
    for unit in units(c)? {
        for file in unit.jobs.iter().filter_map(|job| job.file.as_ref()) {
            files.add(file);
        }
        // The newest stays even if it alone is too much: its client has just been told of it.
        let too_much = count >= kept.jobs || (files.bytes > kept.result_bytes && !is_newest);
        is_newest &= unit.is_open;
        count += unit.jobs.len();
        if !unit.is_open && (too_much || unit.ended < oldest) {
            leaving.jobs.extend(unit.jobs.iter().map(|job| job.number));
            leaving.batches.extend(unit.batch);
        } else {
            staying.extend(unit.jobs);
        }
    }
    leaving.pictures = pictures(staying, kept.result_bytes);
    Ok(leaving)
}

/// Of jobs that stay those whose linear pictures leave, so that they and all files fit: those of the jobs that ended first.
fn pictures(mut jobs: Vec<Finished>, room: u64) -> Vec<i64> {
    jobs.sort_by_key(|job| Reverse((job.ended, job.number)));
    let (mut held, mut stay) = (Blobs::default(), HashSet::new());
    for file in jobs.iter().filter_map(|job| job.file.as_ref()) {
        held.add(file);
    }
    let mut leaving = Vec::new();
    for (place, job) in jobs.iter().enumerate() {
        let Some(picture) = &job.picture else { continue };
        if held.add(picture) <= room || place == 0 || stay.contains(&picture.0) {
            stay.insert(&picture.0);
        } else {
            leaving.push(job.number);
        }
    }
    leaving
}

/// Blobs that have been counted, each once.
#[derive(Default)]
struct Blobs {
    seen: HashSet<String>,
    bytes: u64,
}

impl Blobs {
    /// Counts another one, and says how many bytes there are in all.
    fn add(&mut self, (id, bytes): &Held) -> u64 {
        if self.seen.insert(id.clone()) {
            self.bytes += bytes;
        }
        self.bytes
    }
}

fn uploads(c: &Connection, kept: &Kept) -> Result<(Vec<String>, Vec<String>)> {
    let sql = "SELECT id, used, deleted, bytes, is_scene FROM (
                   SELECT s.id AS id, used, deleted, 1 AS is_scene,
                          (SELECT SUM(b.bytes) FROM scene_files f JOIN blobs b ON b.id = f.blob WHERE f.scene = s.id) AS bytes,
                          EXISTS (SELECT 1 FROM jobs WHERE scene = s.id AND ended IS NULL) AS needed
                   FROM scenes s
                   UNION ALL
                   SELECT i.id, used, deleted, 0, b.bytes,
                          EXISTS (SELECT 1 FROM jobs WHERE (image = i.id OR instr(params, i.id)) AND ended IS NULL)
                   FROM images i JOIN blobs b ON b.id = i.id
               ) WHERE NOT needed ORDER BY deleted, used DESC";
    let mut query = c.prepare_cached(sql)?;
    let rows = query.query_map([], |row| {
        Ok((row.get::<_, String>(0)?, row.get::<_, i64>(1)?, row.get::<_, bool>(2)?, row.get(3)?, row.get(4)?))
    })?;
    let (oldest, mut bytes) = (now().saturating_sub(kept.age), 0);
    let (mut scenes, mut images) = (Vec::new(), Vec::new());
    for (place, row) in rows.enumerate() {
        let (id, used, deleted, more, is_scene): (_, _, _, Option<i64>, bool) = row?;
        bytes += more.unwrap_or_default() as u64;
        if deleted || used < oldest || (bytes > kept.upload_bytes && place > 0) {
            if is_scene { scenes.push(id) } else { images.push(id) }
        }
    }
    Ok((scenes, images))
}

/// Blobs that nothing names.
pub fn unused_blobs(c: &Connection) -> Result<Vec<String>> {
    let sql = "SELECT id FROM blobs b
               WHERE NOT EXISTS (SELECT 1 FROM scene_files WHERE blob = b.id)
                 AND NOT EXISTS (SELECT 1 FROM images WHERE id = b.id)
                 AND NOT EXISTS (SELECT 1 FROM jobs WHERE file = b.id)
                 AND NOT EXISTS (SELECT 1 FROM jobs WHERE picture = b.id)
                 AND NOT EXISTS (SELECT 1 FROM jobs WHERE film = b.id)";
    c.prepare_cached(sql)?.query_map([], |row| row.get(0))?.collect()
}

/// All blobs that the ledger knows.
pub fn known_blobs(c: &Connection) -> Result<HashSet<String>> {
    c.prepare_cached("SELECT id FROM blobs")?.query_map([], |row| row.get(0))?.collect()
}
