//! When the shutter is open.

use super::validate::Check;
use super::{Mode, RenderParams};
use serde::{Deserialize, Serialize};

/// Most straight pieces of a motion.
pub const MAX_STEPS: u32 = 32;

/// The time for which light is collected: each path sees the scene at a moment of its own, all moments alike.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShutterParams {
    /// Seconds from `time` to when it opens; negative: before.
    pub open: f64,
    /// Seconds from `time` to when it closes.
    pub close: f64,
    /// Pieces of equal time in which everything moves along straight lines.
    #[serde(default = "default_steps")]
    pub steps: u32,
}

fn default_steps() -> u32 {
    8
}

impl RenderParams {
    /// The shutter of a picture that takes time.
    pub fn open_shutter(&self) -> Option<ShutterParams> {
        self.shutter.filter(|shutter| self.mode == Mode::Path && shutter.close > shutter.open)
    }
}

/// Checks a shutter.
pub fn check(check: &mut Check, shutter: &ShutterParams) {
    check.finite(&[shutter.open], "open");
    if check.finite(&[shutter.close], "close") {
        check.require(shutter.close >= shutter.open, "close", || "must not lie before `open`".to_owned());
    }
    check.require((1..=MAX_STEPS).contains(&shutter.steps), "steps", || format!("must lie between 1 and {MAX_STEPS}"));
}

#[cfg(test)]
mod tests {
    use crate::params::from_json;
    use crate::params::validate::tests::faults;

    #[test]
    fn shutters_open_before_they_close() {
        for (shutter, field) in [
            (r#"{"open": 1, "close": 0.5}"#, "/close"),
            (r#"{"open": 0, "close": 1, "steps": 0}"#, "/steps"),
            (r#"{"open": 0, "close": 1, "steps": 33}"#, "/steps"),
        ] {
            assert_eq!(faults(&format!(r#"{{"shutter": {shutter}}}"#)), [format!("/params/shutter{field}")]);
        }
        assert!(faults(r#"{"shutter": {"open": -0.5, "close": 0.5}}"#).is_empty());
        assert!(from_json(r#"{"shutter": {"open": 0}}"#).is_err(), "both ends are needed");
    }

    #[test]
    fn only_paths_take_time() {
        let open = |json: &str| from_json(json).unwrap().open_shutter().is_some();
        assert!(open(r#"{"shutter": {"open": 0, "close": 1}}"#));
        assert!(!open(r#"{"shutter": {"open": 1, "close": 1}}"#));
        assert!(!open(r#"{"mode": "direct", "shutter": {"open": 0, "close": 1}}"#));
        assert!(!open("{}"));
    }
}
