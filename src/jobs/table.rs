//! All jobs that the server knows: those under way, and the latest finished ones.

use super::batch::{Batch, BatchSpec};
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
    next_batch: i64,
    batches: BTreeMap<i64, Arc<Batch>>,
    batch_numbers: HashMap<String, i64>,
    batch_keys: HashMap<String, i64>,
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

/// What became of a request for a batch.
#[derive(Debug)]
pub enum BatchAdmission<T> {
    /// It is a new one.
    New(Arc<Batch>, T),
    /// One of that idempotency key is there.
    SameKey(Arc<Batch>),
    /// So many jobs of batches are waiting, too many for this one.
    Full(usize),
}

impl Table {
    /// A table of what the ledger has; `next` are the numbers of the next job and the next batch.
    pub fn new(
        queue_length: usize,
        jobs: impl IntoIterator<Item = Arc<Job>>,
        batches: impl IntoIterator<Item = Batch>,
        next: (i64, i64),
    ) -> Self {
        let mut rows = Rows { next: next.0, next_batch: next.1, ..Rows::default() };
        jobs.into_iter().for_each(|job| rows.insert(job));
        batches.into_iter().for_each(|batch| rows.insert_batch(Arc::new(batch)));
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
        if !is_at_hand && rows.queued_alone() >= self.queue_length {
            return Admission::Full;
        }
        spec.number = rows.next;
        rows.next += 1;
        if spec.id.is_empty() {
            spec.id = new_id("job", spec.number);
        }
        let (job, change) = make(spec);
        let job = Arc::new(job);
        rows.insert(Arc::clone(&job));
        Admission::New(job, change)
    }

    /// Admits a batch with all its jobs, unless one of its key is there or more than `most` jobs of batches would wait.
    pub fn admit_batch<T>(
        &self,
        mut spec: BatchSpec,
        mut jobs: Vec<Spec>,
        most: usize,
        make: impl FnOnce(Arc<BatchSpec>, Vec<Spec>) -> (Vec<Job>, T),
    ) -> BatchAdmission<T> {
        let mut rows = self.rows();
        let by_key = spec.key.as_ref().and_then(|key| rows.batch_keys.get(key));
        if let Some(batch) = by_key.and_then(|number| rows.batches.get(number)) {
            return BatchAdmission::SameKey(Arc::clone(batch));
        }
        let waiting = rows.queued_in_batches();
        if waiting + jobs.len() > most {
            return BatchAdmission::Full(waiting);
        }
        spec.number = rows.next_batch;
        spec.id = new_id("batch", spec.number);
        rows.next_batch += 1;
        for job in &mut jobs {
            job.number = rows.next;
            job.id = new_id("job", job.number);
            rows.next += 1;
            if let Some(place) = &mut job.place {
                place.batch = spec.number;
            }
        }
        let spec = Arc::new(spec);
        let (jobs, sent) = make(Arc::clone(&spec), jobs);
        let batch = Arc::new(Batch { spec, jobs: jobs.into_iter().map(Arc::new).collect() });
        batch.jobs.iter().for_each(|job| rows.insert(Arc::clone(job)));
        rows.insert_batch(Arc::clone(&batch));
        BatchAdmission::New(batch, sent)
    }

    /// Looks a batch up.
    pub fn batch(&self, id: &str) -> Option<Arc<Batch>> {
        let rows = self.rows();
        rows.batch_numbers.get(id).and_then(|number| rows.batches.get(number)).cloned()
    }

    /// Up to `count` batches older than `before`, newest first, and whether there are more.
    pub fn batches(&self, before: Option<&Batch>, count: usize) -> (Vec<Arc<Batch>>, bool) {
        let rows = self.rows();
        let end = before.map_or(i64::MAX, |batch| batch.spec.number);
        let mut rest = rows.batches.range(..end).rev().map(|(_, batch)| batch);
        let page = rest.by_ref().take(count).cloned().collect();
        (page, rest.next().is_some())
    }

    /// Forgets batches, whose jobs are forgotten by themselves.
    pub fn forget_batches(&self, numbers: &[i64]) {
        let mut rows = self.rows();
        for number in numbers {
            let Some(batch) = rows.batches.remove(number) else { continue };
            rows.batch_numbers.remove(&batch.spec.id);
            if let Some(key) = &batch.spec.key {
                rows.batch_keys.remove(key);
            }
        }
    }

    /// Jobs that wait: those that were asked for one by one, and those of batches.
    pub fn waiting(&self) -> (usize, usize) {
        let rows = self.rows();
        (rows.queued_alone(), rows.queued_in_batches())
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

    fn insert_batch(&mut self, batch: Arc<Batch>) {
        let spec = &batch.spec;
        self.batch_numbers.insert(spec.id.clone(), spec.number);
        if let Some(key) = &spec.key {
            self.batch_keys.insert(key.clone(), spec.number);
        }
        self.batches.insert(spec.number, batch);
    }

    fn queued_alone(&self) -> usize {
        self.queued().filter(|job| job.spec.place.is_none()).count()
    }

    fn queued_in_batches(&self) -> usize {
        self.queued().filter(|job| job.spec.place.is_some()).count()
    }

    fn queued(&self) -> impl Iterator<Item = &Arc<Job>> {
        self.jobs.values().filter(|job| job.state() == State::Queued)
    }
}

/// An id that nobody can guess from others.
fn new_id(kind: &str, number: i64) -> String {
    let noise = RandomState::new().hash_one(number);
    format!("{kind}-{number:08x}{noise:016x}")
}
