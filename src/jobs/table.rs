//! All jobs that the server knows: those under way, and the latest finished ones.

use super::job::{Job, Order};
use super::state::State;
use std::collections::{BTreeMap, VecDeque};
use std::hash::{BuildHasher, RandomState};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The jobs, oldest first.
#[derive(Debug)]
pub struct Table {
    queue_length: usize,
    kept_jobs: usize,
    kept_bytes: u64,
    rows: Mutex<Rows>,
}

#[derive(Debug, Default)]
struct Rows {
    next: u32,
    jobs: BTreeMap<String, Arc<Job>>,
    /// Ids of jobs that are over, in the order of their ends, with the bytes of their results.
    over: VecDeque<(String, u64)>,
    over_bytes: u64,
}

impl Table {
    /// An empty table with its bounds.
    pub fn new(queue_length: usize, kept_jobs: usize, kept_bytes: u64) -> Self {
        Self { queue_length, kept_jobs, kept_bytes, rows: Mutex::default() }
    }

    /// Accepts an order; none if the queue is full.
    pub fn accept(&self, order: Order) -> Option<Arc<Job>> {
        let mut rows = self.rows();
        if rows.queued().count() >= self.queue_length {
            return None;
        }
        let id = format!("job-{:08x}{:016x}", rows.next, RandomState::new().hash_one(rows.next));
        rows.next = rows.next.wrapping_add(1);
        let job = Arc::new(Job::new(id.clone(), order));
        rows.jobs.insert(id, Arc::clone(&job));
        Some(job)
    }

    /// Notes that a job is over, and forgets the oldest such jobs beyond the bounds.
    pub fn retire(&self, job: &Job) {
        let mut rows = self.rows();
        let bytes = job.result_bytes();
        rows.over.push_back((job.id.clone(), bytes));
        rows.over_bytes += bytes;
        while rows.over.len() > self.kept_jobs || (rows.over_bytes > self.kept_bytes && rows.over.len() > 1) {
            let Some((id, bytes)) = rows.over.pop_front() else { return };
            rows.over_bytes -= bytes;
            rows.jobs.remove(&id);
        }
    }

    /// Looks a job up.
    pub fn get(&self, id: &str) -> Option<Arc<Job>> {
        self.rows().jobs.get(id).cloned()
    }

    /// Up to `count` jobs older than `before`, newest first, and whether there are more.
    pub fn page(&self, before: Option<&str>, count: usize) -> (Vec<Arc<Job>>, bool) {
        let rows = self.rows();
        let mut rest = rows
            .jobs
            .iter()
            .rev()
            .filter(|(id, _)| before.is_none_or(|before| id.as_str() < before))
            .map(|(_, job)| job);
        let page = rest.by_ref().take(count).cloned().collect();
        (page, rest.next().is_some())
    }

    /// How many queued jobs are older than this queued one.
    pub fn position(&self, job: &Job) -> Option<usize> {
        (job.state() == State::Queued).then(|| self.rows().queued().filter(|other| other.id < job.id).count())
    }

    /// Jobs that are not over.
    pub fn under_way(&self) -> Vec<Arc<Job>> {
        self.rows().jobs.values().filter(|job| !job.is_over()).cloned().collect()
    }

    fn rows(&self) -> MutexGuard<'_, Rows> {
        self.rows.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Rows {
    fn queued(&self) -> impl Iterator<Item = &Arc<Job>> {
        self.jobs.values().filter(|job| job.state() == State::Queued)
    }
}
