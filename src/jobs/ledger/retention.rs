//! What leaves the ledger, by age and by bytes, and which blobs are then of no more use.

use super::now;
use rusqlite::{Connection, Result};
use std::collections::HashSet;

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
    /// Ids of scenes.
    pub scenes: Vec<String>,
    /// Ids of images.
    pub images: Vec<String>,
}

impl Leaving {
    /// What is beyond the bounds: the oldest leave first, what an unfinished job needs stays.
    pub fn choose(c: &Connection, kept: &Kept) -> Result<Self> {
        let (scenes, images) = uploads(c, kept)?;
        Ok(Self { jobs: jobs(c, kept)?, scenes, images })
    }

    /// Whether nothing leaves.
    pub fn is_empty(&self) -> bool {
        self.jobs.is_empty() && self.scenes.is_empty() && self.images.is_empty()
    }

    pub(super) fn apply(&self, c: &Connection) -> Result<()> {
        let mut job = c.prepare_cached("DELETE FROM jobs WHERE number = ?1 AND ended IS NOT NULL")?;
        self.jobs.iter().try_for_each(|number| job.execute([number]).map(drop))?;
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

/// A finished job: when it ended, and the blobs of its result.
struct Ended {
    number: i64,
    ended: i64,
    blobs: [Option<(String, i64)>; 2],
}

fn jobs(c: &Connection, kept: &Kept) -> Result<Vec<i64>> {
    let sql = "SELECT number, ended, file, f.bytes, picture, p.bytes FROM jobs
               LEFT JOIN blobs f ON f.id = file LEFT JOIN blobs p ON p.id = picture
               WHERE ended IS NOT NULL ORDER BY ended DESC, number DESC";
    let mut query = c.prepare_cached(sql)?;
    let rows = query.query_map([], |row| {
        let blob = |id: Option<String>, bytes: Option<i64>| id.zip(bytes);
        let blobs = [blob(row.get(2)?, row.get(3)?), blob(row.get(4)?, row.get(5)?)];
        Ok(Ended { number: row.get(0)?, ended: row.get(1)?, blobs })
    })?;
    let (oldest, mut seen, mut bytes) = (now().saturating_sub(kept.age), HashSet::new(), 0);
    let mut leaving = Vec::new();
    for (place, row) in rows.enumerate() {
        let row = row?;
        let more = row.blobs.into_iter().flatten().filter(|(id, _)| seen.insert(id.clone()));
        bytes += more.map(|(_, bytes)| bytes as u64).sum::<u64>();
        // The newest stays even if it alone is too much: its client has just been told of it.
        let too_much = place >= kept.jobs || (bytes > kept.result_bytes && place > 0);
        if too_much || row.ended < oldest {
            leaving.push(row.number);
        }
    }
    Ok(leaving)
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
