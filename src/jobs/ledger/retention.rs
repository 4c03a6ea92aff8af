//! What leaves the ledger, by age and by bytes, and which blobs are then of no more use.

use super::{DAY, now};
use rusqlite::{Connection, Result};
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
        let (jobs, batches) = jobs(c, kept)?;
        Ok(Self { jobs, batches, scenes, images })
    }

    /// Whether nothing leaves.
    pub fn is_empty(&self) -> bool {
        self.jobs.is_empty() && self.scenes.is_empty() && self.images.is_empty()
    }

    pub(super) fn apply(&self, c: &Connection) -> Result<()> {
        let mut job = c.prepare_cached("DELETE FROM jobs WHERE number = ?1 AND ended IS NOT NULL")?;
        self.jobs.iter().try_for_each(|number| job.execute([number]).map(drop))?;
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
    jobs: Vec<i64>,
    batch: Option<i64>,
    /// When the last of them ended.
    ended: i64,
    /// Those of the results.
    blobs: Vec<(String, i64)>,
}

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
        let batch: Option<i64> = row.get(6)?;
        if batch.is_some_and(|batch| open.contains(&batch)) {
            continue;
        }
        let place = batch.map_or(units.len(), |batch| *places.entry(batch).or_insert(units.len()));
        if place == units.len() {
            units.push(Unit { jobs: Vec::new(), batch, ended: row.get(1)?, blobs: Vec::new() });
        }
        let Some(unit) = units.get_mut(place) else { continue };
        unit.jobs.push(row.get(0)?);
        for column in [2, 4] {
            let (id, bytes): (Option<String>, Option<i64>) = (row.get(column)?, row.get(column + 1)?);
            unit.blobs.extend(id.zip(bytes));
        }
    }
    Ok(units)
}

/// Numbers of the jobs and of the batches that leave.
fn jobs(c: &Connection, kept: &Kept) -> Result<(Vec<i64>, Vec<i64>)> {
    let (oldest, mut seen, mut bytes, mut count) = (now().saturating_sub(kept.age), HashSet::new(), 0, 0);
    let (mut leaving, mut batches) = (Vec::new(), Vec::new());
    for (place, unit) in units(c)?.into_iter().enumerate() {
        let more = unit.blobs.into_iter().filter(|(id, _)| seen.insert(id.clone()));
        bytes += more.map(|(_, bytes)| bytes as u64).sum::<u64>();
        // The newest stays even if it alone is too much: its client has just been told of it.
        let too_much = count >= kept.jobs || (bytes > kept.result_bytes && place > 0);
        count += unit.jobs.len();
        if too_much || unit.ended < oldest {
            leaving.extend(unit.jobs);
            batches.extend(unit.batch);
        }
    }
    Ok((leaving, batches))
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
