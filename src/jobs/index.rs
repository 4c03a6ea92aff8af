//! Things that the ledger counts, by number, by id and by idempotency key: jobs, and batches of them.

use std::collections::{BTreeMap, HashMap};
use std::hash::{BuildHasher, RandomState};
use std::sync::Arc;

/// What an [`Index`] holds.
pub trait Numbered {
    /// What ids of the server begin with.
    const KIND: &str;

    /// Counts them.
    fn number(&self) -> i64;

    /// The client's, or the server's.
    fn id(&self) -> &str;

    /// The client's `Idempotency-Key`, as it is kept.
    fn key(&self) -> Option<&str>;
}

/// The things, oldest first.
#[derive(Debug)]
pub struct Index<T> {
    next: i64,
    things: BTreeMap<i64, Arc<T>>,
    ids: HashMap<String, i64>,
    keys: HashMap<String, i64>,
}

impl<T: Numbered> Index<T> {
    /// An empty one; `next`: number of the first thing to come.
    pub fn new(next: i64) -> Self {
        Self { next, things: BTreeMap::new(), ids: HashMap::new(), keys: HashMap::new() }
    }

    /// Number and id, which nobody can guess from others, of a thing to come.
    pub fn next(&mut self) -> (i64, String) {
        let number = self.next;
        self.next += 1;
        let noise = RandomState::new().hash_one(number);
        (number, format!("{}-{number:08x}{noise:016x}", T::KIND))
    }

    /// Adds a thing.
    pub fn insert(&mut self, thing: Arc<T>) {
        let number = thing.number();
        self.ids.insert(thing.id().to_owned(), number);
        self.keys.extend(thing.key().map(|key| (key.to_owned(), number)));
        self.things.insert(number, thing);
    }

    /// Forgets a thing, and hands it out.
    pub fn remove(&mut self, number: i64) -> Option<Arc<T>> {
        let thing = self.things.remove(&number)?;
        self.ids.remove(thing.id());
        if let Some(key) = thing.key() {
            self.keys.remove(key);
        }
        Some(thing)
    }

    /// By number.
    pub fn get(&self, number: i64) -> Option<&Arc<T>> {
        self.things.get(&number)
    }

    /// By id.
    pub fn by_id(&self, id: &str) -> Option<&Arc<T>> {
        self.ids.get(id).and_then(|number| self.get(*number))
    }

    /// By idempotency key.
    pub fn by_key(&self, key: Option<&str>) -> Option<&Arc<T>> {
        self.keys.get(key?).and_then(|number| self.get(*number))
    }

    /// Up to `count` things older than `before`, newest first, and whether there are more.
    pub fn page(&self, before: Option<&T>, count: usize) -> (Vec<Arc<T>>, bool) {
        let end = before.map_or(i64::MAX, T::number);
        let mut rest = self.things.range(..end).rev().map(|(_, thing)| thing);
        let page = rest.by_ref().take(count).cloned().collect();
        (page, rest.next().is_some())
    }

    /// All of them, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<T>> {
        self.things.values()
    }
}
