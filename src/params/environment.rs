//! Light from infinity.

use super::validate::Check;
use serde::{Deserialize, Serialize};

/// What the request says about the environment.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum EnvironmentChoice {
    /// Field absent: a neutral environment, unless lights of the request or what the scene brings along is enough for a picture.
    #[default]
    Auto,
    /// `null`: no environment.
    None,
    /// As given.
    Given(EnvironmentParams),
}

impl EnvironmentChoice {
    /// Whether the field was absent.
    pub fn is_auto(&self) -> bool {
        matches!(self, Self::Auto)
    }
}

impl Serialize for EnvironmentChoice {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto | Self::None => serializer.serialize_none(),
            Self::Given(params) => params.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for EnvironmentChoice {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Ok(Option::<EnvironmentParams>::deserialize(deserializer)?.map_or(Self::None, Self::Given))
    }
}

/// Light from infinity: exactly one of `hdri`, `constant`, `gradient`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EnvironmentParams {
    /// An equirectangular picture: file name of a part of the same form, or an id from `POST /v1/images`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hdri: Option<String>,
    /// The same radiance from everywhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub constant: Option<[f32; 3]>,
    /// Radiance by height, linear in the direction's y: bottom at -1, horizon at 0, top at 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gradient: Option<GradientParams>,
    /// Factor on all radiance.
    pub intensity: f32,
    /// Turns the environment about +y.
    pub rotation_degrees: f64,
    /// Whether the camera sees it where nothing else is.
    pub visible: bool,
}

impl Default for EnvironmentParams {
    fn default() -> Self {
        Self { hdri: None, constant: None, gradient: None, intensity: 1.0, rotation_degrees: 0.0, visible: true }
    }
}

/// Radiance of a sky that depends on height alone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GradientParams {
    /// Straight up.
    pub top: [f32; 3],
    /// At the horizon.
    pub horizon: [f32; 3],
    /// Straight down.
    pub bottom: [f32; 3],
}

/// Notes what is wrong with an environment.
pub(super) fn check(check: &mut Check, environment: &EnvironmentParams) {
    let kinds = [environment.hdri.is_some(), environment.constant.is_some(), environment.gradient.is_some()];
    check.require(kinds.into_iter().filter(|&given| given).count() == 1, "", || {
        "give exactly one of `hdri`, `constant` and `gradient`, or null for no environment".to_owned()
    });
    check.require(environment.hdri.as_deref() != Some(""), "hdri", || {
        "must be a file name or the id of an image".to_owned()
    });
    check.light(&[environment.intensity], "intensity");
    check.finite(&[environment.rotation_degrees], "rotation_degrees");
    if let Some(constant) = &environment.constant {
        check.light(constant, "constant");
    }
    if let Some(gradient) = &environment.gradient {
        check.light(&gradient.top, "gradient/top");
        check.light(&gradient.horizon, "gradient/horizon");
        check.light(&gradient.bottom, "gradient/bottom");
    }
}

#[cfg(test)]
mod tests {
    use crate::params::validate::tests::faults;

    #[test]
    fn environments_are_of_one_kind() {
        for (environment, field) in [
            ("{}", ""),
            (r#"{"constant": [1, 1, 1], "hdri": "a.hdr"}"#, ""),
            (r#"{"hdri": ""}"#, "/hdri"),
            (r#"{"constant": [1, -1, 1]}"#, "/constant"),
            (r#"{"constant": [1, 1, 1], "intensity": -1}"#, "/intensity"),
            (r#"{"gradient": {"top": [1, 1, 1], "horizon": [1, 1, -1], "bottom": [0, 0, 0]}}"#, "/gradient/horizon"),
        ] {
            let json = format!(r#"{{"environment": {environment}}}"#);
            assert_eq!(faults(&json), [format!("/params/environment{field}")], "{environment}");
        }
    }
}
