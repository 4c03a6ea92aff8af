//! The states of a job, and the only place that says which may follow which.

use serde::Serialize;

/// Where a job stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Accepted: being compiled, or waiting for the device.
    Queued,
    /// The device works on it.
    Running,
    /// Its picture can be fetched.
    Succeeded,
    /// It ended with a problem.
    Failed,
    /// Someone ended it.
    Cancelled,
}

impl State {
    /// Whether a job may go from this state to `next`.
    pub fn may_become(self, next: Self) -> bool {
        use State::{Cancelled, Failed, Queued, Running, Succeeded};
        matches!((self, next), (Queued, Running | Failed | Cancelled) | (Running, Succeeded | Failed | Cancelled))
    }

    /// Whether nothing can follow.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }

    /// Name, as in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::State::{Cancelled, Failed, Queued, Running, Succeeded};

    #[test]
    fn what_is_over_stays_as_it_is() {
        let all = [Queued, Running, Succeeded, Failed, Cancelled];
        for from in all {
            assert_eq!(from.is_over(), all.iter().all(|to| !from.may_become(*to)), "{from:?}");
        }
    }

    #[test]
    fn success_comes_only_from_running() {
        assert!(Running.may_become(Succeeded));
        assert!(!Queued.may_become(Succeeded));
        assert!(!Running.may_become(Queued));
    }
}
