//! All jobs that the server knows: those under way, and the latest finished ones.

use super::job::{Job, Spec};
use super::state::State;
use std::collections::{BTreeMap, HashMap};
use std::hash::{BuildHasher, RandomState};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The jobs, oldest first.
#[derive(Debug)]
pub struct Table {
    queue_length: usize,
    rows: Mutex<Rows>,
}

#[derive(Debug, Default)]
struct Rows {
    next: i64,
    jobs: BTreeMap<i64, Arc<Job>>,
    numbers: HashMap<String, i64>,
    keys: HashMap<String, i64>,
    /// Jobs with a result that may serve others, by what it depends on.
    results: HashMap<String, i64>,
}

/// What became of a request for a job.
#[derive(Debug)]
pub enum Admission<T> {
    /// It is a new job.
    New(Arc<Job>, T),
    /// A job of that id is there.
    SameId(Arc<Job>),
    /// A job of that idempotency key is there.
    SameKey(Arc<Job>),
    /// Too many jobs are waiting.
    Full,
}

impl Table {
    /// A table of the jobs that the ledger has; `next` is the number of the next one.
    pub fn new(queue_length: usize, jobs: impl IntoIterator<Item = Arc<Job>>, next: i64) -> Self {
        let mut rows = Rows { next, ..Rows::default() };
        jobs.into_iter().for_each(|job| rows.insert(job));
        Self { queue_length, rows: Mutex::new(rows) }
    }

    /// Admits a job, unless one of that id or key is there. An empty id is replaced by one of the server's. `shares`: the
    /// result of another job will do. `make` is called with the whole specification, and what it gives besides the job is
    /// handed on.
    pub fn admit<T>(&self, mut spec: Spec, shares: bool, make: impl FnOnce(Spec) -> (Job, T)) -> Admission<T> {
        let mut rows = self.rows();
        if let Some(job) = rows.numbers.get(&spec.id).and_then(|number| rows.jobs.get(number)) {
            return Admission::SameId(Arc::clone(job));
        }
        let by_key = spec.key.as_ref().and_then(|key| rows.keys.get(key));
        if let Some(job) = by_key.and_then(|number| rows.jobs.get(number)) {
            return Admission::SameKey(Arc::clone(job));
        }
        let is_at_hand = shares && rows.results.contains_key(&spec.content);
        if !is_at_hand && rows.queued().count() >= self.queue_length {
            return Admission::Full;
        }
        spec.number = rows.next;
        rows.next += 1;
        if spec.id.is_empty() {
            let noise = RandomState::new().hash_one(spec.number);
            spec.id = format!("job-{:08x}{noise:016x}", spec.number);
        }
        let (job, change) = make(spec);
        let job = Arc::new(job);
        rows.insert(Arc::clone(&job));
        Admission::New(job, change)
    }

    /// A job whose result is that of any other with the same content.
    pub fn result_of(&self, content: &str) -> Option<Arc<Job>> {
        let rows = self.rows();
        rows.results.get(content).and_then(|number| rows.jobs.get(number)).cloned()
    }

    /// Notes that the job has a result, which may serve others.
    pub fn share_result(&self, job: &Job) {
        self.rows().results.insert(job.spec.content.clone(), job.spec.number);
    }

    /// Forgets jobs.
    pub fn forget(&self, numbers: &[i64]) {
        let mut rows = self.rows();
        for number in numbers {
            let Some(job) = rows.jobs.remove(number) else { continue };
            rows.numbers.remove(&job.spec.id);
            if let Some(key) = &job.spec.key {
                rows.keys.remove(key);
            }
            if rows.results.get(&job.spec.content) == Some(number) {
                rows.results.remove(&job.spec.content);
            }
        }
    }

    /// Looks a job up.
    pub fn get(&self, id: &str) -> Option<Arc<Job>> {
        let rows = self.rows();
        rows.numbers.get(id).and_then(|number| rows.jobs.get(number)).cloned()
    }

    /// Up to `count` jobs older than `before`, newest first, and whether there are more.
    pub fn page(&self, before: Option<&Job>, count: usize) -> (Vec<Arc<Job>>, bool) {
        let rows = self.rows();
        let end = before.map_or(i64::MAX, |job| job.spec.number);
        let mut rest = rows.jobs.range(..end).rev().map(|(_, job)| job);
        let page = rest.by_ref().take(count).cloned().collect();
        (page, rest.next().is_some())
    }

    /// How many queued jobs are older than this queued one.
    pub fn position(&self, job: &Job) -> Option<usize> {
        let older = |other: &&Arc<Job>| other.spec.number < job.spec.number;
        (job.state() == State::Queued).then(|| self.rows().queued().filter(older).count())
    }

    /// Jobs that are not over, oldest first.
    pub fn under_way(&self) -> Vec<Arc<Job>> {
        self.rows().jobs.values().filter(|job| !job.is_over()).cloned().collect()
    }

    /// Number of jobs by state, in the order of [`State::ALL`].
    pub fn counts(&self) -> [usize; State::ALL.len()] {
        let rows = self.rows();
        State::ALL.map(|state| rows.jobs.values().filter(|job| job.state() == state).count())
    }

    fn rows(&self) -> MutexGuard<'_, Rows> {
        self.rows.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Rows {
    fn insert(&mut self, job: Arc<Job>) {
        let spec = &job.spec;
        self.numbers.insert(spec.id.clone(), spec.number);
        if let Some(key) = &spec.key {
            self.keys.insert(key.clone(), spec.number);
        }
        if job.outcome().is_some_and(|outcome| outcome.record.repeatable) {
            self.results.insert(spec.content.clone(), spec.number);
        }
        self.jobs.insert(spec.number, job);
    }

    fn queued(&self) -> impl Iterator<Item = &Arc<Job>> {
        self.jobs.values().filter(|job| job.state() == State::Queued)
    }
}
