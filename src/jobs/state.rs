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
    /// All there are.
    pub const ALL: [Self; 5] = [Self::Queued, Self::Running, Self::Succeeded, Self::Failed, Self::Cancelled];

    /// Whether a job may go from this state to `next`.
    pub fn may_become(self, next: Self) -> bool {
        use State::{Cancelled, Failed, Queued, Running, Succeeded};
        match self {
            // Success at once: the result was there. Queued again: the server has restarted.
            Queued => matches!(next, Running | Succeeded | Failed | Cancelled),
            Running => matches!(next, Queued | Succeeded | Failed | Cancelled),
            Succeeded | Failed | Cancelled => false,
        }
    }

    /// Whether nothing can follow.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }

    /// The state of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name() == name)
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
    use super::State;

    #[test]
    fn what_is_over_stays_as_it_is() {
        for from in State::ALL {
            assert_eq!(from.is_over(), State::ALL.iter().all(|to| !from.may_become(*to)), "{from:?}");
        }
    }

    #[test]
    fn names_are_read_back() {
        assert!(State::ALL.iter().all(|state| State::from_name(state.name()) == Some(*state)));
    }
}
