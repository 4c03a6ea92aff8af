//! Ranges and combinations of parameters.

use super::environment;
use super::light_groups;
use super::lights;
use super::preview;
use super::shutter;
use super::surfaces;
use super::{
    CameraParams, EngineChoice, EnvironmentChoice, Filter, ImageFormat, Mode, OrbitParams, OutputParams, RenderParams,
};
use glam::DVec3;
use std::fmt;
use std::ops::RangeInclusive;

/// Exposures beyond this many stops leave the range of f32.
const MAX_STOPS: f32 = 64.0;

/// Sides of a lens that is not round.
const BLADES: RangeInclusive<u32> = 3..=64;

/// Widest reconstruction filter, half width in pixels.
const MAX_FILTER_RADIUS: f32 = 8.0;

/// One fault of one field.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, serde::Serialize, serde::Deserialize)]
pub struct FieldError {
    /// JSON pointer, like `/params/width`; empty: the whole.
    pub pointer: String,
    /// What, why, how to fix.
    pub detail: String,
}

impl FieldError {
    /// A fault of the field at `pointer`.
    pub fn new(pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { pointer: pointer.into(), detail: detail.into() }
    }
}

impl fmt::Display for FieldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pointer, detail } = self;
        if pointer.is_empty() { write!(f, "the body {detail}") } else { write!(f, "{pointer}: {detail}") }
    }
}

/// What one request may ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct ParamLimits {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Pixels in all.
    pub pixels: u64,
    /// Samples per pixel.
    pub samples: u32,
    /// Pixels x samples.
    pub pixel_samples: u64,
    /// Scattering events per path that may be asked for; unlimited is always allowed.
    pub bounces: u32,
    /// Lights of the request.
    pub lights: usize,
    /// Spheres of the request, and overrides of materials.
    pub spheres: usize,
}

impl Default for ParamLimits {
    fn default() -> Self {
        Self {
            width: 16_384,
            height: 16_384,
            pixels: 16 << 20,
            samples: 1 << 24,
            pixel_samples: 1_000_000_000_000,
            bounces: 100_000,
            lights: 10_000,
            spheres: 10_000,
        }
    }
}

impl RenderParams {
    /// Whether every value is in its range and all of them go together.
    ///
    /// # Errors
    /// All faults, each with its JSON pointer. What depends on the scene (indices, names) is not checked here.
    pub fn validate(&self, limits: &ParamLimits) -> Result<(), Vec<FieldError>> {
        let mut check = Check::default();
        check.at("/params", |check| {
            self.check_size(check, limits);
            self.check_stopping(check, limits);
            check.require(self.exposure.abs() <= MAX_STOPS, "exposure", || {
                format!("must lie between -{MAX_STOPS} and {MAX_STOPS} stops")
            });
            check.require(self.time.is_none_or(f64::is_finite), "time", || "must be finite".to_owned());
            if let Some(shutter) = &self.shutter {
                check.at("shutter", |check| shutter::check(check, shutter));
            }
            check.at("filter", |check| check_filter(check, &self.filter));
            check.at("output", |check| check_output(check, &self.output));
            check.at("preview", |check| preview::check(check, &self.preview, self.width));
            check.require(self.mode != Mode::Preview || self.engine != EngineChoice::Cpu, "engine", || {
                "previews are drawn by graphics drivers alone: leave it out, or ask for gpu".to_owned()
            });
            check.require(self.mode != Mode::Preview || !self.denoise, "denoise", || {
                "previews have no noise: leave it out, or ask for mode path".to_owned()
            });
            if let Some(camera) = &self.camera {
                check.at("camera", |check| check_camera(check, camera));
            }
            if let EnvironmentChoice::Given(given) = &self.environment {
                check.at("environment", |check| environment::check(check, given));
            }
            lights::check(check, &self.lights, limits.lights);
            light_groups::check(check, self);
            surfaces::check(check, self, limits.spheres);
            check.at("direct", |check| check.light(&[self.direct.specular], "specular"));
        });
        if check.faults.is_empty() { Ok(()) } else { Err(check.faults) }
    }

    fn check_size(&self, check: &mut Check, limits: &ParamLimits) {
        let format_side = self.output.format.max_side();
        for (name, side, most) in [("width", self.width, limits.width), ("height", self.height, limits.height)] {
            let most = most.min(format_side);
            check.require((1..=most).contains(&side), name, || {
                format!("must lie between 1 and {most} pixels for this format, and is {side}")
            });
        }
        let pixels = u64::from(self.width) * u64::from(self.height);
        check.require(pixels <= limits.pixels, "width", || {
            format!("width x height is {pixels} pixels, more than the {} allowed here", limits.pixels)
        });
        let pixel_samples = pixels.saturating_mul(u64::from(self.max_samples));
        // What is beyond the other limit is told of that one alone.
        let is_too_much = pixel_samples > limits.pixel_samples && self.max_samples <= limits.samples;
        check.require(!is_too_much, "max_samples", || {
            format!(
                "width x height x max_samples is {pixel_samples}, more than the {} allowed here: ask for fewer samples, or a \
                 smaller picture",
                limits.pixel_samples
            )
        });
    }

    fn check_stopping(&self, check: &mut Check, limits: &ParamLimits) {
        check.require((1..=limits.samples).contains(&self.max_samples), "max_samples", || {
            format!("must lie between 1 and {}, and is {}", limits.samples, self.max_samples)
        });
        if let Some(target) = self.target_error {
            check.require(target > 0.0 && target.is_finite(), "target_error", || {
                "must be above 0, like 0.02 for an error of 2 %".to_owned()
            });
        }
        check.require(self.deadline_ms != Some(0), "deadline_ms", || "must be at least 1".to_owned());
        if let Some(bounces) = self.max_bounces {
            check.require(bounces <= limits.bounces, "max_bounces", || {
                format!("must be at most {}; leave it out for no limit at all", limits.bounces)
            });
        }
    }
}

/// Faults so far, and the pointer to what is being looked at.
#[derive(Default)]
pub(super) struct Check {
    pointer: String,
    faults: Vec<FieldError>,
}

impl Check {
    /// Runs `body` one step down.
    pub fn at(&mut self, name: &str, body: impl FnOnce(&mut Self)) {
        let outer = self.pointer.len();
        if !name.starts_with('/') {
            self.pointer.push('/');
        }
        self.pointer.push_str(name);
        body(self);
        self.pointer.truncate(outer);
    }

    /// Notes a fault of the field `name`, or of the whole if that is empty, unless `holds`.
    pub fn require(&mut self, holds: bool, name: &str, detail: impl FnOnce() -> String) {
        if !holds {
            let slash = if name.is_empty() { "" } else { "/" };
            self.faults.push(FieldError::new(format!("{}{slash}{name}", self.pointer), detail()));
        }
    }

    pub fn finite(&mut self, values: &[f64], name: &str) -> bool {
        let finite = values.iter().all(|value| value.is_finite());
        self.require(finite, name, || "must be finite".to_owned());
        finite
    }

    /// Radiance, intensity and the like.
    pub fn light(&mut self, values: &[f32], name: &str) {
        self.require(values.iter().all(|&value| value >= 0.0 && value.is_finite()), name, || {
            "must be finite and not negative".to_owned()
        });
    }

    pub fn positive(&mut self, value: Option<f64>, name: &str) {
        self.require(value.is_none_or(|value| value > 0.0 && value.is_finite()), name, || {
            "must be finite and above 0; leave it out for the default".to_owned()
        });
    }

    pub fn direction(&mut self, value: [f64; 3], name: &str) {
        if self.finite(&value, name) {
            self.require(DVec3::from(value).try_normalize().is_some(), name, || {
                "is too short to be a direction: give it a length".to_owned()
            });
        }
    }
}

fn check_filter(check: &mut Check, filter: &Filter) {
    if let Some(radius) = filter.radius {
        check.require(radius > 0.0 && radius <= MAX_FILTER_RADIUS, "radius", || {
            format!("must be above 0 and at most {MAX_FILTER_RADIUS} pixels")
        });
    }
}

fn check_output(check: &mut Check, output: &OutputParams) {
    check.require(matches!(output.bits, 8 | 16), "bits", || format!("must be 8 or 16, and is {}", output.bits));
    check.require(output.bits != 16 || output.format == ImageFormat::Png, "bits", || {
        "16 is for png only; exr always has 32-bit floats, webp and jpeg 8 bits".to_owned()
    });
    check.require(!(output.transparent && output.format == ImageFormat::Jpeg), "transparent", || {
        "jpeg has no alpha: ask for png, webp or exr".to_owned()
    });
}

fn check_camera(check: &mut Check, camera: &CameraParams) {
    let ways = [camera.index.is_some(), camera.name.is_some(), camera.orbit.is_some(), camera.position.is_some()];
    check.require(ways.into_iter().filter(|&way| way).count() <= 1, "", || {
        "give only one of `index`, `name`, `orbit` and `position`".to_owned()
    });
    let aims = camera.orbit.is_some() || camera.position.is_some();
    check.require(aims || camera.target.is_none(), "target", || {
        "needs `position` or `orbit` beside it: a camera of the scene has its own direction".to_owned()
    });
    if let Some(orbit) = &camera.orbit {
        check.at("orbit", |check| check_orbit(check, orbit));
    }
    check.direction(camera.up, "up");
    let position = camera.position.filter(|position| check.finite(position, "position")).map(DVec3::from);
    let target = camera.target.filter(|target| check.finite(target, "target")).map(DVec3::from);
    if let (Some(position), Some(target)) = (position, target) {
        check.require(target != position, "target", || "is where the camera is: move one of them".to_owned());
    }
    if let Some(yfov) = camera.yfov_degrees {
        check.require(yfov > 0.0 && yfov < 180.0, "yfov_degrees", || "must lie above 0 and below 180".to_owned());
    }
    check.require(camera.aperture_radius >= 0.0 && camera.aperture_radius.is_finite(), "aperture_radius", || {
        "must be finite and not negative; 0 is a pinhole".to_owned()
    });
    check.require(camera.blades == 0 || BLADES.contains(&camera.blades), "blades", || {
        format!("must be 0 for a round lens, or lie between {} and {}", BLADES.start(), BLADES.end())
    });
    check.finite(&[camera.blade_rotation_degrees], "blade_rotation_degrees");
    check.positive(camera.focus_distance, "focus_distance");
}

fn check_orbit(check: &mut Check, orbit: &OrbitParams) {
    check.finite(&[orbit.azimuth_degrees], "azimuth_degrees");
    check.require(orbit.elevation_degrees.abs() <= 90.0, "elevation_degrees", || {
        "must lie between -90 and 90".to_owned()
    });
    check.positive(orbit.distance, "distance");
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::params::from_json;

    /// Pointers of what is wrong.
    pub fn faults(json: &str) -> Vec<String> {
        let faults = from_json(json).unwrap().validate(&ParamLimits::default());
        faults.map_or_else(|faults| faults.into_iter().map(|fault| fault.pointer).collect(), |()| Vec::new())
    }

    #[test]
    fn the_defaults_are_valid() {
        assert!(faults("{}").is_empty());
        assert!(faults(r#"{"camera": {}, "environment": null}"#).is_empty());
    }

    #[test]
    fn every_range_is_checked() {
        for (json, pointer) in [
            (r#"{"width": 0}"#, "/params/width"),
            (r#"{"height": 20000, "width": 1}"#, "/params/height"),
            (r#"{"width": 16000, "height": 16000}"#, "/params/width"),
            (r#"{"width": 4000, "height": 4000, "max_samples": 100000}"#, "/params/max_samples"),
            (r#"{"max_samples": 0}"#, "/params/max_samples"),
            (r#"{"target_error": 0}"#, "/params/target_error"),
            (r#"{"deadline_ms": 0}"#, "/params/deadline_ms"),
            (r#"{"max_bounces": 100001}"#, "/params/max_bounces"),
            (r#"{"denoise": true, "mode": "preview"}"#, "/params/denoise"),
            (r#"{"exposure": 65}"#, "/params/exposure"),
            (r#"{"exposure": 1e300}"#, "/params/exposure"),
            (r#"{"filter": {"radius": 0}}"#, "/params/filter/radius"),
            (r#"{"filter": {"radius": 8.5}}"#, "/params/filter/radius"),
            (r#"{"output": {"bits": 12}}"#, "/params/output/bits"),
            (r#"{"output": {"bits": 16, "format": "webp"}}"#, "/params/output/bits"),
            (r#"{"output": {"transparent": true, "format": "jpeg"}}"#, "/params/output/transparent"),
        ] {
            assert_eq!(faults(json), [pointer], "{json}");
        }
    }

    #[test]
    fn cameras_must_make_sense() {
        for (camera, field) in [
            (r#"{"index": 0, "name": "a"}"#, ""),
            (r#"{"orbit": {}, "position": [0, 0, 1]}"#, ""),
            (r#"{"index": 0, "target": [0, 0, 0]}"#, "/target"),
            (r#"{"orbit": {"elevation_degrees": 91}}"#, "/orbit/elevation_degrees"),
            (r#"{"orbit": {"distance": 0}}"#, "/orbit/distance"),
            (r#"{"up": [0, 0, 0]}"#, "/up"),
            (r#"{"position": [1, 2, 3], "target": [1, 2, 3]}"#, "/target"),
            (r#"{"target": [0, 0, 0]}"#, "/target"),
            (r#"{"yfov_degrees": 180}"#, "/yfov_degrees"),
            (r#"{"yfov_degrees": 0}"#, "/yfov_degrees"),
            (r#"{"aperture_radius": -1}"#, "/aperture_radius"),
            (r#"{"focus_distance": 0}"#, "/focus_distance"),
            (r#"{"blades": 2}"#, "/blades"),
            (r#"{"blades": 65}"#, "/blades"),
        ] {
            assert_eq!(faults(&format!(r#"{{"camera": {camera}}}"#)), [format!("/params/camera{field}")], "{camera}");
        }
        assert!(faults(r#"{"camera": {"orbit": {"elevation_degrees": 90}, "target": [0, 1, 0]}}"#).is_empty());
    }

    #[test]
    fn all_faults_come_at_once() {
        let json = r#"{"width": 0, "exposure": 99, "camera": {"yfov_degrees": 500}, "environment": {}}"#;
        assert_eq!(faults(json).len(), 4);
    }
}
