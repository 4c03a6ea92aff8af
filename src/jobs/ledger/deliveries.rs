//! Messages of jobs' ends that have not been taken yet.

use crate::jobs::events::Event;
use rusqlite::{Connection, OptionalExtension, Result, params};
use serde_json::{Value, json};

/// A message on its way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Delivery {
    /// The same for every attempt.
    pub id: String,
    /// Where it goes.
    pub url: String,
    /// JSON.
    pub body: String,
    /// Attempts that have failed.
    pub attempts: u32,
}

/// Messages that are due, those that have waited longest first.
pub fn deliveries(c: &Connection, now: i64, most: usize) -> Result<Vec<Delivery>> {
    let sql = "SELECT id, url, body, attempts FROM deliveries WHERE due <= ?1 ORDER BY due LIMIT ?2";
    let mut query = c.prepare_cached(sql)?;
    let rows = query.query_map(params![now, most as i64], |row| {
        Ok(Delivery { id: row.get(0)?, url: row.get(1)?, body: row.get(2)?, attempts: row.get(3)? })
    })?;
    rows.collect()
}

/// Notes that a job's end is to be told, if its client has asked for that.
pub(super) fn note(c: &Connection, job: i64, state: &str, now: i64, event: &Event) -> Result<()> {
    let sql = "SELECT id, webhook, strftime('%Y-%m-%dT%H:%M:%fZ', ?2 / 1000.0, 'unixepoch') FROM jobs
               WHERE number = ?1 AND webhook IS NOT NULL";
    let found = c.prepare_cached(sql)?.query_row(params![job, now], |row| {
        Ok((row.get::<_, String>(0)?, row.get::<_, String>(1)?, row.get::<_, String>(2)?))
    });
    let Some((id, url, time)) = found.optional()? else { return Ok(()) };
    let body = json!({ "type": format!("job.{state}"), "timestamp": time, "data": data(&id, state, &event.data) });
    let insert = "INSERT INTO deliveries (id, url, body, due) VALUES (?1, ?2, ?3, ?4)";
    c.prepare_cached(insert)?.execute(params![format!("msg_{id}"), url, body.to_string(), now]).map(drop)
}

/// What is told: of a success the report and where the picture is, of a failure the problem.
fn data(id: &str, state: &str, event: &Value) -> Value {
    let mut data = json!({ "job": id, "state": state, "url": format!("/v1/jobs/{id}") });
    match state {
        "succeeded" => {
            data["result"] = event["result"].clone();
            data["report"] = event["report"].clone();
        }
        "failed" => data["problem"] = event.clone(),
        _ => {}
    }
    data
}

pub(super) fn postpone(c: &Connection, id: &str, due: i64) -> Result<()> {
    let sql = "UPDATE deliveries SET attempts = attempts + 1, due = ?2 WHERE id = ?1";
    c.prepare_cached(sql)?.execute(params![id, due]).map(drop)
}

pub(super) fn forget(c: &Connection, id: &str) -> Result<()> {
    c.prepare_cached("DELETE FROM deliveries WHERE id = ?1")?.execute([id]).map(drop)
}
