//! How many renders clients were granted today, for those that have a quota.

use super::ledger::{DAY, now};
use super::problem::{Code, Problem};
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Counts of one day (UTC). The ledger counts too, so that they hold over a restart.
#[derive(Debug)]
pub struct Usage {
    today: Mutex<Today>,
}

#[derive(Debug)]
struct Today {
    day: i64,
    renders: HashMap<String, u64>,
}

/// Renders that were granted; given back unless [kept](Self::keep).
#[derive(Debug)]
pub struct Taken<'a> {
    usage: &'a Usage,
    client: &'a str,
    day: i64,
    renders: u64,
}

impl Usage {
    /// As the ledger has them for the day of `now`.
    pub fn new(rows: Vec<(String, u64)>, now: i64) -> Self {
        Self { today: Mutex::new(Today { day: now / DAY, renders: rows.into_iter().collect() }) }
    }

    /// Grants renders to a client, at most `quota` on one day.
    ///
    /// # Errors
    /// The quota does not allow so many more today.
    pub fn take<'a>(&'a self, client: &'a str, renders: u64, quota: Option<u64>) -> Result<Taken<'a>, Problem> {
        self.take_at(now(), client, renders, quota)
    }

    fn take_at<'a>(
        &'a self,
        now: i64,
        client: &'a str,
        renders: u64,
        quota: Option<u64>,
    ) -> Result<Taken<'a>, Problem> {
        let day = now / DAY;
        let taken = |renders| Taken { usage: self, client, day, renders };
        let Some(quota) = quota else { return Ok(taken(0)) };
        let mut today = self.lock();
        if today.day != day {
            *today = Today { day, renders: HashMap::new() };
        }
        let count = today.renders.entry(client.to_owned()).or_default();
        if count.saturating_add(renders) > quota {
            let detail = format!(
                "this key may have {quota} renders a day (UTC), has had {count} today, and asks for {renders} more"
            );
            let left = u32::try_from((DAY - now % DAY) / 1000 + 1).unwrap_or(u32::MAX);
            return Err(Problem::new(Code::QuotaExceeded, detail).retry_after(left));
        }
        *count += renders;
        Ok(taken(renders))
    }

    fn lock(&self) -> MutexGuard<'_, Today> {
        self.today.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Taken<'_> {
    /// The jobs are in the ledger.
    pub fn keep(mut self) {
        self.renders = 0;
    }
}

impl Drop for Taken<'_> {
    fn drop(&mut self) {
        if self.renders == 0 {
            return;
        }
        let mut today = self.usage.lock();
        if today.day == self.day
            && let Some(count) = today.renders.get_mut(self.client)
        {
            *count = count.saturating_sub(self.renders);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quota_is_of_a_day_and_what_was_refused_is_given_back() {
        let (usage, noon) = (Usage::new(vec![("a".to_owned(), 1)], DAY / 2), DAY / 2);
        usage.take_at(noon, "a", 1, Some(3)).unwrap().keep();
        drop(usage.take_at(noon, "a", 1, Some(3)).unwrap());
        usage.take_at(noon, "a", 1, Some(3)).unwrap().keep();
        let refused = usage.take_at(noon, "a", 1, Some(3)).unwrap_err();
        assert_eq!((refused.status, refused.retry_after), (429, Some(12 * 3600 + 1)));
        assert!(usage.take_at(noon, "b", 4, Some(3)).is_err(), "more at once than a day allows");
        usage.take_at(noon, "b", 3, Some(3)).unwrap().keep();
        usage.take_at(noon, "a", 1, None).unwrap().keep();
        usage.take_at(DAY + 1, "a", 3, Some(3)).unwrap().keep();
    }
}
