//! The news of one job, numbered, for those who listen now and those who come back.

use serde::Serialize;
use serde_json::Value;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
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

    /// The kind of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        use EventKind::{Cancelled, Completed, Failed, Preview, Progress, Queued, Started};
        [Queued, Started, Progress, Preview, Completed, Failed, Cancelled].into_iter().find(|kind| kind.name() == name)
    }

    /// Whether a newer event of this kind makes the older one useless.
    pub fn is_superseded(self) -> bool {
        matches!(self, Self::Progress | Self::Preview)
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

/// The log of one job. A newer preview or progress takes the place of the older one, so that the log stays short, and who
/// comes back sees where things stand. All other events stay.
///
/// An event is told only once it was [published](Self::publish), which is when the ledger has it: no listener has ever heard of
/// what a restart would take back.
#[derive(Debug)]
pub struct EventLog {
    entries: Mutex<Entries>,
    published: watch::Sender<u64>,
    /// The ledger takes no more: nothing will be published any more.
    is_closed: AtomicBool,
    audience: Arc<()>,
}

#[derive(Debug)]
struct Entries {
    events: VecDeque<Event>,
    newest: u64,
}

impl EventLog {
    /// A log of events that have been published, of which the newest had this id.
    pub fn new(events: impl IntoIterator<Item = Event>, newest: u64) -> Self {
        let entries = Entries { events: events.into_iter().collect(), newest };
        Self {
            entries: Mutex::new(entries),
            published: watch::Sender::new(newest),
            is_closed: AtomicBool::new(false),
            audience: Arc::new(()),
        }
    }

    /// Appends an event, which nobody hears of yet.
    pub fn push(&self, kind: EventKind, data: Value) -> Event {
        let mut entries = self.lock();
        if kind.is_superseded() {
            entries.events.retain(|event| event.kind != kind);
        }
        entries.newest += 1;
        let event = Event { id: entries.newest, kind, data };
        entries.events.push_back(event.clone());
        event
    }

    /// Tells the listeners of all events up to this one.
    pub fn publish(&self, id: u64) {
        self.published.send_if_modified(|published| {
            let is_new = id > *published;
            *published = id.max(*published);
            is_new
        });
    }

    /// Ends all waiting: what has not been published will not be.
    pub fn close(&self) {
        self.is_closed.store(true, Ordering::Release);
        self.published.send_modify(|_| {});
    }

    /// Waits until all events so far are published, or the log is closed.
    pub async fn settled(&self) {
        let newest = self.lock().newest;
        let is_settled = |published: &u64| *published >= newest || self.is_closed.load(Ordering::Acquire);
        // The sender lives in `self`, so this cannot fail.
        let _ = self.published.subscribe().wait_for(is_settled).await;
    }

    /// Published events after a given id, oldest first.
    pub fn after(&self, id: u64) -> Vec<Event> {
        let published = *self.published.borrow();
        self.lock().events.iter().filter(|event| event.id > id && event.id <= published).cloned().collect()
    }

    /// Tells of the newest published id whenever it changes.
    pub fn subscribe(&self) -> watch::Receiver<u64> {
        self.published.subscribe()
    }

    /// Counts the caller among those who look at previews, for as long as the token lives.
    pub fn join_audience(&self) -> Arc<()> {
        Arc::clone(&self.audience)
    }

    /// Whether anyone looks at previews.
    pub fn has_audience(&self) -> bool {
        Arc::strong_count(&self.audience) > 1
    }

    fn lock(&self) -> MutexGuard<'_, Entries> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ids(events: &[Event]) -> Vec<u64> {
        events.iter().map(|event| event.id).collect()
    }

    #[test]
    fn the_log_is_bounded_and_in_order() {
        let log = EventLog::new([], 0);
        log.push(EventKind::Queued, Value::Null);
        for _ in 0..1000 {
            log.push(EventKind::Progress, Value::Null);
            log.push(EventKind::Preview, Value::Null);
        }
        log.push(EventKind::Completed, Value::Null);
        log.publish(2002);
        assert_eq!(ids(&log.after(0)), [1, 2000, 2001, 2002]);
        assert_eq!(log.after(2001).len(), 1);
    }

    #[test]
    fn nobody_hears_of_what_is_not_published() {
        let log = EventLog::new([], 0);
        log.push(EventKind::Queued, Value::Null);
        log.push(EventKind::Started, Value::Null);
        assert!(log.after(0).is_empty());
        log.publish(1);
        assert_eq!(ids(&log.after(0)), [1]);
    }

    #[tokio::test]
    async fn a_closed_log_keeps_nobody_waiting() {
        let log = EventLog::new([], 0);
        log.push(EventKind::Queued, Value::Null);
        log.close();
        log.settled().await;
        assert!(log.after(0).is_empty());
    }

    #[test]
    fn ids_go_on_where_they_were_and_states_stay() {
        let event = |id, kind| Event { id, kind, data: Value::Null };
        let log = EventLog::new([event(1, EventKind::Queued), event(2, EventKind::Started)], 9);
        assert_eq!(log.push(EventKind::Queued, Value::Null).id, 10);
        log.publish(10);
        assert_eq!(ids(&log.after(0)), [1, 2, 10]);
    }
}
