//! Checks a ledger against what must always be so; the schema's own constraints are part of it.

use super::read;
use crate::jobs::events::EventKind;
use crate::jobs::state::State;
use rusqlite::{Connection, Result};

/// Every rule that is broken, in words; none if all is well. Reads everything.
pub fn audit(c: &Connection) -> Result<Vec<String>> {
    let mut faults = Vec::new();
    for check in ["integrity_check", "foreign_key_check"] {
        let mut query = c.prepare(&format!("PRAGMA {check}"))?;
        let rows = query.query_map([], |row| row.get::<_, String>(0))?.collect::<Result<Vec<_>>>()?;
        faults.extend(rows.into_iter().filter(|row| row != "ok").map(|row| format!("{check}: {row}")));
    }
    for job in read::jobs(c)? {
        faults.extend(history(&job).into_iter().map(|fault| format!("{}: {fault}", job.spec.id)));
        let held = read::scene(c, &job.spec.scene)?.is_some();
        if !job.state.is_over() && !held {
            faults.push(format!("{}: unfinished, and its scene is gone", job.spec.id));
        }
    }
    faults.extend(broken_batches(c)?);
    Ok(faults)
}

/// Batches that have lost some of their jobs, or all.
fn broken_batches(c: &Connection) -> Result<Vec<String>> {
    let sql = "SELECT b.id, COUNT(j.number), COALESCE(MAX(j.item) + 1, 0) FROM batches b
               LEFT JOIN jobs j ON j.batch = b.number GROUP BY b.number
               HAVING COUNT(j.number) = 0 OR COUNT(j.number) != MAX(j.item) + 1";
    let mut query = c.prepare(sql)?;
    let rows = query.query_map([], |row| {
        let (id, found, items): (String, i64, i64) = (row.get(0)?, row.get(1)?, row.get(2)?);
        Ok(format!("{id}: {found} jobs, of {items} or more"))
    })?;
    rows.collect()
}

/// The events of a job must lead from its beginning to where it stands, each step one that may be taken.
fn history(job: &read::Restored) -> Vec<String> {
    let mut faults = Vec::new();
    let mut at = None;
    for event in &job.events {
        let Some(next) = state_after(event.kind) else {
            if at != Some(State::Running) && at != Some(State::Queued) {
                faults.push(format!("{} while {at:?}", event.kind.name()));
            }
            continue;
        };
        let may = at.map_or(next == State::Queued, |at: State| at.may_become(next));
        if !may {
            faults.push(format!("{} follows {at:?}", event.kind.name()));
        }
        at = Some(next);
    }
    if at != Some(job.state) {
        faults.push(format!("is {}, and its events end with {at:?}", job.state.name()));
    }
    let newest = job.events.last().map_or(0, |event| event.id);
    if newest > job.last_event || (job.state.is_over() && newest != job.last_event) {
        faults.push(format!("its newest event is {newest}, and {} was given out last", job.last_event));
    }
    faults
}

fn state_after(kind: EventKind) -> Option<State> {
    match kind {
        EventKind::Queued => Some(State::Queued),
        EventKind::Started => Some(State::Running),
        EventKind::Completed => Some(State::Succeeded),
        EventKind::Failed => Some(State::Failed),
        EventKind::Cancelled => Some(State::Cancelled),
        EventKind::Progress | EventKind::Preview => None,
    }
}
