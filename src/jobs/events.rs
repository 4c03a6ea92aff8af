//! The news of one job, numbered, for those who listen now and those who come back.

use serde::Serialize;
use serde_json::Value;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// Accepted.
    Queued,
    /// The device works on it.
    Started,
    /// Samples were added.
    Progress,
    /// There is a newer picture of the unfinished render.
    Preview,
    /// The result is there.
    Completed,
    /// It ended with a problem.
    Failed,
    /// Someone ended it.
    Cancelled,
}

impl EventKind {
    /// Name on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Started => "started",
            Self::Progress => "progress",
            Self::Preview => "preview",
            Self::Completed => "completed",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// Whether nothing follows.
    pub fn is_last(self) -> bool {
        matches!(self, Self::Completed | Self::Failed | Self::Cancelled)
    }
}

/// One piece of news.
#[derive(Debug, Clone)]
pub struct Event {
    /// Counts from 1 within the job.
    pub id: u64,
    /// What happened.
    pub kind: EventKind,
    /// Its facts.
    pub data: Value,
}

/// The log of one job. A newer event of a kind takes the place of the older one, so that the log holds at most
/// one event of each kind, and who comes back sees where things stand rather than all that has been.
#[derive(Debug)]
pub struct EventLog {
    entries: Mutex<VecDeque<Event>>,
    newest: watch::Sender<u64>,
    audience: Arc<()>,
}

impl EventLog {
    /// An empty log.
    pub fn new() -> Self {
        Self { entries: Mutex::new(VecDeque::new()), newest: watch::Sender::new(0), audience: Arc::new(()) }
    }

    /// Appends an event and wakes the listeners.
    pub fn push(&self, kind: EventKind, data: Value) {
        let mut entries = self.lock();
        let id = *self.newest.borrow() + 1;
        entries.retain(|event| event.kind != kind);
        entries.push_back(Event { id, kind, data });
        drop(entries);
        self.newest.send_replace(id);
    }

    /// Events after a given id, oldest first.
    pub fn after(&self, id: u64) -> Vec<Event> {
        self.lock().iter().filter(|event| event.id > id).cloned().collect()
    }

    /// Tells of the newest id whenever it changes.
    pub fn subscribe(&self) -> watch::Receiver<u64> {
        self.newest.subscribe()
    }

    /// Counts the caller among those who look at previews, for as long as the token lives.
    pub fn join_audience(&self) -> Arc<()> {
        Arc::clone(&self.audience)
    }

    /// Whether anyone looks at previews.
    pub fn has_audience(&self) -> bool {
        Arc::strong_count(&self.audience) > 1
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Event>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Default for EventLog {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_is_bounded_and_in_order() {
        let log = EventLog::new();
        log.push(EventKind::Queued, Value::Null);
        for _ in 0..1000 {
            log.push(EventKind::Progress, Value::Null);
            log.push(EventKind::Preview, Value::Null);
        }
        log.push(EventKind::Completed, Value::Null);
        let events = log.after(0);
        assert_eq!(events.iter().map(|event| event.id).collect::<Vec<_>>(), [1, 2000, 2001, 2002]);
        assert_eq!(log.after(2001).len(), 1);
    }
}
