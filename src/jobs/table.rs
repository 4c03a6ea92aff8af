//! All jobs that the server knows: those under way, and the latest finished ones.

use super::batch::{Batch, BatchSpec};
use super::index::{Index, Numbered};
use super::job::{Job, Spec};
use super::problem::Problem;
use super::state::State;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

impl Numbered for Job {
    const KIND: &str = "job";

    fn number(&self) -> i64 {
        self.spec.number
    }

    fn id(&self) -> &str {
        &self.spec.id
    }

    fn key(&self) -> Option<&str> {
        self.spec.key.as_deref()
    }
}

impl Numbered for Batch {
    const KIND: &str = "batch";

    fn number(&self) -> i64 {
        self.spec.number
    }

    fn id(&self) -> &str {
        &self.spec.id
    }

    fn key(&self) -> Option<&str> {
        self.spec.key.as_deref()
    }
}

/// The jobs and the batches.
#[derive(Debug)]
pub struct Table {
    queue_length: usize,
    rows: Mutex<Rows>,
}

#[derive(Debug)]
struct Rows {
    jobs: Index<Job>,
    batches: Index<Batch>,
    /// Jobs that may not be over: whoever asks takes out those that are, so that a question costs as much as there is under
    /// way, however many jobs are kept.
    unfinished: BTreeMap<i64, Arc<Job>>,
    /// Jobs with a result that may serve others, by what it depends on.
    results: HashMap<String, i64>,
}

/// What became of a request for a job or a batch.
#[derive(Debug)]
pub enum Admission<J, T> {
    /// It is a new one.
    New(Arc<J>, T),
    /// One of that id or idempotency key is there.
    Known(Arc<J>),
    /// So many jobs are waiting, too many for this.
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
        let (jobs_index, batches_index) = (Index::new(next.0), Index::new(next.1));
        let mut rows =
            Rows { jobs: jobs_index, batches: batches_index, unfinished: BTreeMap::new(), results: HashMap::new() };
        jobs.into_iter().for_each(|job| rows.insert(job));
        batches.into_iter().for_each(|batch| rows.batches.insert(Arc::new(batch)));
        Self { queue_length, rows: Mutex::new(rows) }
    }

    /// Admits a job, unless one of that id or key is there. An empty id is replaced by one of the server's. `shares`: the
    /// result of another job will do. `make` is called with the whole specification; it may refuse, and what it gives besides
    /// the job is handed on.
    pub fn admit<T>(
        &self,
        mut spec: Spec,
        shares: bool,
        make: impl FnOnce(Spec) -> Result<(Job, T), Problem>,
    ) -> Result<Admission<Job, T>, Problem> {
        let mut rows = self.rows();
        if let Some(job) = rows.known(Some(&spec.id), spec.key.as_deref()) {
            return Ok(Admission::Known(Arc::clone(job)));
        }
        let is_at_hand = shares && rows.results.contains_key(&spec.content);
        let waiting = rows.waiting().0;
        if !is_at_hand && waiting >= self.queue_length {
            return Ok(Admission::Full(waiting));
        }
        let (number, id) = rows.jobs.next();
        spec.number = number;
        if spec.id.is_empty() {
            spec.id = id;
        }
        let (job, change) = make(spec)?;
        let job = Arc::new(job);
        rows.insert(Arc::clone(&job));
        Ok(Admission::New(job, change))
    }

    /// The job of an id or an idempotency key.
    pub fn known(&self, id: Option<&str>, key: Option<&str>) -> Option<Arc<Job>> {
        self.rows().known(id, key).cloned()
    }

    /// The batch of an idempotency key.
    pub fn known_batch(&self, key: Option<&str>) -> Option<Arc<Batch>> {
        self.rows().batches.by_key(key).cloned()
    }

    /// Whether [`Table::admit`] would say `Full` of a new job, whatever its scene is.
    pub fn refuses(&self, content: Option<&str>) -> bool {
        let mut rows = self.rows();
        let is_at_hand = content.is_some_and(|content| rows.results.contains_key(content));
        !is_at_hand && rows.waiting().0 >= self.queue_length
    }

    /// Admits a batch with all its jobs, unless one of its key is there or more than `most` jobs of batches would wait. `make` may
    /// refuse.
    pub fn admit_batch<T>(
        &self,
        mut spec: BatchSpec,
        mut jobs: Vec<Spec>,
        most: usize,
        make: impl FnOnce(Arc<BatchSpec>, Vec<Spec>) -> Result<(Vec<Job>, T), Problem>,
    ) -> Result<Admission<Batch, T>, Problem> {
        let mut rows = self.rows();
        if let Some(batch) = rows.batches.by_key(spec.key.as_deref()) {
            return Ok(Admission::Known(Arc::clone(batch)));
        }
        let waiting = rows.waiting().1;
        if waiting + jobs.len() > most {
            return Ok(Admission::Full(waiting));
        }
        (spec.number, spec.id) = rows.batches.next();
        for job in &mut jobs {
            (job.number, job.id) = rows.jobs.next();
            if let Some(place) = &mut job.place {
                place.batch = spec.number;
            }
        }
        let spec = Arc::new(spec);
        let (jobs, sent) = make(Arc::clone(&spec), jobs)?;
        let batch = Arc::new(Batch { spec, jobs: jobs.into_iter().map(Arc::new).collect() });
        batch.jobs.iter().for_each(|job| rows.insert(Arc::clone(job)));
        rows.batches.insert(Arc::clone(&batch));
        Ok(Admission::New(batch, sent))
    }

    /// Looks a job up.
    pub fn get(&self, id: &str) -> Option<Arc<Job>> {
        self.rows().jobs.by_id(id).cloned()
    }

    /// Looks a batch up.
    pub fn batch(&self, id: &str) -> Option<Arc<Batch>> {
        self.rows().batches.by_id(id).cloned()
    }

    /// Up to `count` jobs older than `before`, newest first, and whether there are more.
    pub fn page(&self, before: Option<&Job>, count: usize) -> (Vec<Arc<Job>>, bool) {
        self.rows().jobs.page(before, count)
    }

    /// The same of batches.
    pub fn batches(&self, before: Option<&Batch>, count: usize) -> (Vec<Arc<Batch>>, bool) {
        self.rows().batches.page(before, count)
    }

    /// A job whose result is that of any other with the same content.
    pub fn result_of(&self, content: &str) -> Option<Arc<Job>> {
        let rows = self.rows();
        rows.results.get(content).and_then(|number| rows.jobs.get(*number)).cloned()
    }

    /// Notes that the job has a result, which may serve others.
    pub fn share_result(&self, job: &Job) {
        self.rows().results.insert(job.spec.content.clone(), job.spec.number);
    }

    /// Forgets jobs and batches; the jobs of a batch are to be among the jobs.
    pub fn forget(&self, jobs: &[i64], batches: &[i64]) {
        let mut rows = self.rows();
        for number in jobs {
            let Some(job) = rows.jobs.remove(*number) else { continue };
            rows.unfinished.remove(number);
            if rows.results.get(&job.spec.content) == Some(number) {
                rows.results.remove(&job.spec.content);
            }
        }
        for number in batches {
            rows.batches.remove(*number);
        }
    }

    /// Notes that the linear pictures of jobs have left.
    pub fn lose_pictures(&self, jobs: &[i64]) {
        let rows = self.rows();
        jobs.iter().filter_map(|number| rows.jobs.get(*number)).for_each(|job| job.lose_picture());
    }

    /// Jobs that wait: those that were asked for one by one, and those of batches.
    pub fn waiting(&self) -> (usize, usize) {
        self.rows().waiting()
    }

    /// How many queued jobs are older than this queued one.
    pub fn position(&self, job: &Job) -> Option<usize> {
        let older = |other: &&Arc<Job>| other.spec.number < job.spec.number;
        (job.state() == State::Queued).then(|| self.rows().queued().filter(older).count())
    }

    /// Jobs that are not over, oldest first.
    pub fn under_way(&self) -> Vec<Arc<Job>> {
        self.rows().unfinished().values().cloned().collect()
    }

    /// Number of jobs by state, in the order of [`State::ALL`].
    pub fn counts(&self) -> [usize; State::ALL.len()] {
        let rows = self.rows();
        State::ALL.map(|state| rows.jobs.iter().filter(|job| job.state() == state).count())
    }

    fn rows(&self) -> MutexGuard<'_, Rows> {
        self.rows.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Rows {
    fn insert(&mut self, job: Arc<Job>) {
        let spec = &job.spec;
        if job.outcome().is_some_and(|outcome| outcome.record.repeatable) {
            self.results.insert(spec.content.clone(), spec.number);
        }
        self.unfinished.insert(spec.number, Arc::clone(&job));
        self.jobs.insert(job);
    }

    fn known(&self, id: Option<&str>, key: Option<&str>) -> Option<&Arc<Job>> {
        id.and_then(|id| self.jobs.by_id(id)).or_else(|| self.jobs.by_key(key))
    }

    /// Jobs that wait: those that were asked for one by one, and those of batches.
    fn waiting(&mut self) -> (usize, usize) {
        self.queued().fold((0, 0), |(alone, in_batches), job| match job.spec.place {
            None => (alone + 1, in_batches),
            Some(_) => (alone, in_batches + 1),
        })
    }

    fn queued(&mut self) -> impl Iterator<Item = &Arc<Job>> {
        self.unfinished().values().filter(|job| job.state() == State::Queued)
    }

    fn unfinished(&mut self) -> &BTreeMap<i64, Arc<Job>> {
        // What is over stays so.
        self.unfinished.retain(|_, job| !job.is_over());
        &self.unfinished
    }
}
