//! Light groups: the picture's light split by what emitted it, as an AOV.

use super::validate::Check;
use super::{EngineChoice, Mode, RenderParams};
use std::collections::{BTreeMap, BTreeSet};

/// Named groups by the indices of their lights in `lights`.
pub type LightGroups = BTreeMap<String, Vec<usize>>;

/// Groups that there always are: light from infinity, surfaces that emit, and lights of the file and the request that no named group has.
pub const STANDING_GROUPS: [&str; 3] = ["environment", "surfaces", "lights"];

/// Named groups at the most.
const MOST: usize = 8;
/// Letters of a name at the most.
const LONGEST: usize = 32;

impl RenderParams {
    /// Groups that the picture's light is split by; 0: it is not split.
    pub fn groups(&self) -> usize {
        self.light_groups.as_ref().map_or(0, |named| STANDING_GROUPS.len() + named.len())
    }
}

pub(super) fn check(check: &mut Check, params: &RenderParams) {
    let Some(groups) = &params.light_groups else { return };
    check.require(params.mode != Mode::Preview, "light_groups", || {
        "previews have none: leave it out, or ask for mode path".to_owned()
    });
    check.require(params.engine != EngineChoice::Gpu, "light_groups", || {
        "the engine for processors alone splits light: leave `engine` out, or ask for cpu".to_owned()
    });
    check.require(groups.len() <= MOST, "light_groups", || format!("at most {MOST} groups can have names"));
    let mut taken = BTreeSet::new();
    check.at("light_groups", |check| {
        for (name, lights) in groups {
            let plain = |letter: u8| letter.is_ascii_alphanumeric() || letter == b'_' || letter == b'-';
            check.require((1..=LONGEST).contains(&name.len()) && name.bytes().all(plain), "", || {
                let name: String = name.chars().take(LONGEST).collect();
                format!("`{name}` is no name for a group: use 1 to {LONGEST} letters, digits, _ and -, which are safe in EXR layers")
            });
            check.require(!STANDING_GROUPS.contains(&name.as_str()), "", || {
                format!("`{name}` is a group that there always is: take another name")
            });
            for light in lights {
                check.require(*light < params.lights.len(), "", || {
                    format!("`{name}` names light {light}, and `lights` has {}; the first is 0", params.lights.len())
                });
                check.require(taken.insert(*light), "", || format!("light {light} is named twice: it goes to one group"));
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use crate::params::from_json;
    use crate::params::validate::tests::faults;

    #[test]
    fn groups_have_safe_names_and_lights_one_group() {
        let lights = r#""lights": [{"type": "ambient"}, {"type": "ambient"}]"#;
        for groups in [
            r#"{"a.b": [0]}"#,
            r#"{"": []}"#,
            r#"{"lights": [0]}"#,
            r#"{"key": [2]}"#,
            r#"{"key": [0], "fill": [0]}"#,
            r#"{"a":[],"b":[],"c":[],"d":[],"e":[],"f":[],"g":[],"h":[],"i":[]}"#,
        ] {
            let json = format!(r#"{{"light_groups": {groups}, {lights}}}"#);
            assert_eq!(faults(&json), ["/params/light_groups"], "{groups}");
        }
        assert_eq!(faults(r#"{"light_groups": {}, "engine": "gpu"}"#), ["/params/light_groups"]);
        assert_eq!(faults(r#"{"light_groups": {}, "mode": "preview"}"#), ["/params/light_groups"]);
        let params = from_json(&format!(r#"{{"light_groups": {{"key": [1]}}, {lights}}}"#)).unwrap();
        assert_eq!(params.light_groups.unwrap()["key"], [1]);
    }
}
