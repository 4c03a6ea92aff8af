//! Content-addressed things in memory, bounded in bytes: the least recently used leave first.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a [`Store`] keeps.
pub trait Stored {
    /// `sha256-...`
    fn id(&self) -> &str;

    /// Memory that it holds now.
    fn bytes(&self) -> u64;
}

/// A bounded map from id to thing. Things in use elsewhere live on after they left.
#[derive(Debug)]
pub struct Store<T> {
    limit: u64,
    shelf: Mutex<Shelf<T>>,
}

#[derive(Debug)]
struct Shelf<T> {
    /// Ordered by id, so that pages are stable.
    items: BTreeMap<String, Item<T>>,
    clock: u64,
}

#[derive(Debug)]
struct Item<T> {
    thing: Arc<T>,
    used: u64,
}

impl<T: Stored> Store<T> {
    /// An empty store that keeps up to `limit` bytes, and always the newest thing.
    pub fn new(limit: u64) -> Self {
        Self { limit, shelf: Mutex::new(Shelf { items: BTreeMap::new(), clock: 0 }) }
    }

    /// Keeps a thing and says whether it is new; if its id is there already, the one that is there stays.
    pub fn insert(&self, thing: T) -> (Arc<T>, bool) {
        let id = thing.id().to_owned();
        if let Some(present) = self.get(&id) {
            return (present, false);
        }
        let thing = Arc::new(thing);
        let mut shelf = self.lock();
        shelf.clock += 1;
        let item = Item { thing: Arc::clone(&thing), used: shelf.clock };
        shelf.items.insert(id, item);
        shelf.trim(self.limit);
        (thing, true)
    }

    /// Looks a thing up and marks it as used.
    pub fn get(&self, id: &str) -> Option<Arc<T>> {
        let mut shelf = self.lock();
        shelf.clock += 1;
        let now = shelf.clock;
        let item = shelf.items.get_mut(id)?;
        item.used = now;
        Some(Arc::clone(&item.thing))
    }

    /// Forgets a thing; false if there was none.
    pub fn remove(&self, id: &str) -> bool {
        self.lock().items.remove(id).is_some()
    }

    /// Up to `count` things with ids after `after`, and whether there are more.
    pub fn page(&self, after: Option<&str>, count: usize) -> (Vec<Arc<T>>, bool) {
        let shelf = self.lock();
        let mut rest =
            shelf.items.iter().filter(|(id, _)| after.is_none_or(|after| id.as_str() > after)).map(|(_, item)| item);
        let page = rest.by_ref().take(count).map(|item| Arc::clone(&item.thing)).collect();
        (page, rest.next().is_some())
    }

    /// Drops what has become too much since, as things may grow.
    pub fn trim(&self) {
        self.lock().trim(self.limit);
    }

    fn lock(&self) -> MutexGuard<'_, Shelf<T>> {
        self.shelf.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Stored> Shelf<T> {
    fn trim(&mut self, limit: u64) {
        while self.items.len() > 1 && self.items.values().map(|item| item.thing.bytes()).sum::<u64>() > limit {
            let oldest = self.items.iter().min_by_key(|(_, item)| item.used).map(|(id, _)| id.clone());
            let Some(oldest) = oldest else { return };
            self.items.remove(&oldest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Thing(String, u64);

    impl Stored for Thing {
        fn id(&self) -> &str {
            &self.0
        }
        fn bytes(&self) -> u64 {
            self.1
        }
    }

    fn thing(id: &str, bytes: u64) -> Thing {
        Thing(id.to_owned(), bytes)
    }

    #[test]
    fn the_least_recently_used_leaves_first() {
        let store = Store::new(10);
        store.insert(thing("a", 4));
        store.insert(thing("b", 4));
        assert!(store.get("a").is_some());
        store.insert(thing("c", 4));
        assert!(store.get("b").is_none());
        assert!(store.get("a").is_some() && store.get("c").is_some());
    }

    #[test]
    fn the_newest_stays_even_if_too_large() {
        let store = Store::new(10);
        store.insert(thing("a", 4));
        store.insert(thing("b", 40));
        assert!(store.get("a").is_none());
        assert!(store.get("b").is_some());
    }

    #[test]
    fn the_same_content_is_kept_once() {
        let store = Store::new(10);
        assert!(store.insert(thing("a", 4)).1);
        assert!(!store.insert(thing("a", 4)).1);
    }

    #[test]
    fn pages_follow_each_other() {
        let store = Store::new(10);
        for id in ["b", "a", "c"] {
            store.insert(thing(id, 1));
        }
        let (first, more) = store.page(None, 2);
        assert_eq!((first[0].id(), first[1].id(), more), ("a", "b", true));
        let (last, more) = store.page(Some("b"), 2);
        assert_eq!((last[0].id(), last.len(), more), ("c", 1, false));
    }
}
