//! Lights of the request.

use super::validate::Check;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Most lights that rays look for one by one.
const MAX_EXTENDED_LIGHTS: usize = 64;

/// Angular diameters of suns in degrees. Directions in f32 do not resolve smaller ones.
const SUNS: RangeInclusive<f32> = 0.01..=180.0;

/// Sizes of lights in scene units, whose squares f32 holds.
const EXTENTS: RangeInclusive<f32> = 1e-6..=1e9;

/// A light of the request; units of KHR_lights_punctual.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", try_from = "LightFields")]
pub enum LightParams {
    /// Sends light to all sides from a point.
    Point {
        /// World space.
        position: [f64; 3],
        /// Where the vertical angle 0 of its profile points, if it has one; need not be of unit length; none: straight down.
        #[serde(skip_serializing_if = "Option::is_none")]
        direction: Option<[f64; 3]>,
        /// Linear colour, multiplied by the intensity.
        color: [f32; 3],
        /// Candela; with a profile a factor on its candela.
        intensity: f32,
        /// Distance at which the light is cut off smoothly; none: infinite.
        #[serde(skip_serializing_if = "Option::is_none")]
        range: Option<f32>,
        /// How the intensity depends on direction, as measured.
        #[serde(flatten)]
        profile: Option<ProfileParams>,
    },
    /// A point light within a cone.
    Spot {
        /// World space.
        position: [f64; 3],
        /// Direction that the light shines in; need not be of unit length.
        direction: [f64; 3],
        /// Linear colour, multiplied by the intensity.
        color: [f32; 3],
        /// Candela; with a profile a factor on its candela.
        intensity: f32,
        /// Distance at which the light is cut off smoothly; none: infinite.
        #[serde(skip_serializing_if = "Option::is_none")]
        range: Option<f32>,
        /// Half angle of full light.
        inner_cone_degrees: f32,
        /// Half angle of no light.
        outer_cone_degrees: f32,
        /// Curve between the two cones.
        falloff: SpotFalloff,
        /// How the intensity within the cone depends on direction, as measured.
        #[serde(flatten)]
        profile: Option<ProfileParams>,
    },
    /// Parallel light from infinity.
    Directional {
        /// Direction that the light shines in.
        direction: [f64; 3],
        /// Linear colour, multiplied by the intensity.
        color: [f32; 3],
        /// Lux.
        intensity: f32,
        /// Of the disk that it comes from, like 0.53 for the sun; 0: a point, whose shadows are hard.
        #[serde(skip_serializing_if = "is_zero")]
        angular_diameter_degrees: f32,
        /// Whether the camera sees the disk, if it has an extent.
        #[serde(skip_serializing_if = "is_true")]
        visible: bool,
    },
    /// A rectangle that shines to one side.
    Rect {
        /// Centre, world space.
        position: [f64; 3],
        /// Direction that it shines in, at right angles to it; need not be of unit length.
        direction: [f64; 3],
        /// The height lies along this direction, as far as the plane allows.
        up: [f64; 3],
        /// Side across `up`, scene units.
        width: f32,
        /// Side along `up`.
        height: f32,
        /// Linear colour, multiplied by the intensity.
        color: [f32; 3],
        /// Radiance, cd/m2.
        intensity: f32,
        /// Whether the camera sees it.
        visible: bool,
    },
    /// A disk that shines to one side.
    Disk {
        /// Centre, world space.
        position: [f64; 3],
        /// Direction that it shines in, at right angles to it; need not be of unit length.
        direction: [f64; 3],
        /// Scene units.
        radius: f32,
        /// Linear colour, multiplied by the intensity.
        color: [f32; 3],
        /// Radiance, cd/m2.
        intensity: f32,
        /// Whether the camera sees it.
        visible: bool,
    },
    /// A ball that shines outwards.
    Sphere {
        /// Centre, world space.
        position: [f64; 3],
        /// Scene units.
        radius: f32,
        /// Linear colour, multiplied by the intensity.
        color: [f32; 3],
        /// Radiance, cd/m2.
        intensity: f32,
        /// Whether the camera sees it.
        visible: bool,
    },
    /// The same radiance from all sides, not seen by the camera.
    Ambient {
        /// Linear colour, multiplied by the intensity.
        color: [f32; 3],
        /// Radiance, cd/m2.
        intensity: f32,
    },
}

/// The measured distribution of a luminaire.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProfileParams {
    /// An IES LM-63 file: file name of a part of the same form, or an id from `POST /v1/images`.
    pub ies: String,
    /// Where the horizontal angle 0 lies, as far as at right angles to the light's direction.
    pub zero_azimuth: [f64; 3],
}

fn is_zero(value: &f32) -> bool {
    *value == 0.0
}

fn is_true(value: &bool) -> bool {
    *value
}

impl LightParams {
    /// Whether it has an extent, so that its shadows are soft and rays can meet it.
    pub fn has_extent(&self) -> bool {
        match self {
            Self::Rect { .. } | Self::Disk { .. } | Self::Sphere { .. } => true,
            Self::Directional { angular_diameter_degrees, .. } => *angular_diameter_degrees > 0.0,
            Self::Point { .. } | Self::Spot { .. } | Self::Ambient { .. } => false,
        }
    }

    /// Its measured distribution.
    pub fn profile(&self) -> Option<&ProfileParams> {
        match self {
            Self::Point { profile, .. } | Self::Spot { profile, .. } => profile.as_ref(),
            _ => None,
        }
    }

    /// The same, to be changed.
    pub fn profile_mut(&mut self) -> Option<&mut ProfileParams> {
        match self {
            Self::Point { profile, .. } | Self::Spot { profile, .. } => profile.as_mut(),
            _ => None,
        }
    }
}

/// Curve of a spot light between its inner and outer cone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpotFalloff {
    /// Linear in the cosine, then squared (KHR_lights_punctual).
    #[default]
    Gltf,
    /// Linear in the angle.
    Linear,
}

/// [`LightParams`] as the JSON has it. A tagged enum would be buffered by serde, which loses the place of an error.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LightFields {
    r#type: LightType,
    position: Option<[f64; 3]>,
    direction: Option<[f64; 3]>,
    color: Option<[f32; 3]>,
    intensity: Option<f32>,
    range: Option<f32>,
    inner_cone_degrees: Option<f32>,
    outer_cone_degrees: Option<f32>,
    falloff: Option<SpotFalloff>,
    angular_diameter_degrees: Option<f32>,
    up: Option<[f64; 3]>,
    width: Option<f32>,
    height: Option<f32>,
    radius: Option<f32>,
    visible: Option<bool>,
    ies: Option<String>,
    zero_azimuth: Option<[f64; 3]>,
}

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum LightType {
    Point,
    Spot,
    Directional,
    Rect,
    Disk,
    Sphere,
    Ambient,
}

impl TryFrom<LightFields> for LightParams {
    type Error = String;

    fn try_from(fields: LightFields) -> Result<Self, String> {
        fields.check_applicable()?;
        let color = fields.color.unwrap_or([1.0; 3]);
        let intensity = fields.intensity.unwrap_or(1.0);
        let range = fields.range;
        let radius = fields.radius.unwrap_or(0.5);
        let visible = fields.visible.unwrap_or(true);
        let zero_azimuth = fields.zero_azimuth.unwrap_or([1.0, 0.0, 0.0]);
        let profile = fields.ies.clone().map(|ies| ProfileParams { ies, zero_azimuth });
        let position = || fields.position.ok_or("missing field `position`: where the light is, as [x, y, z]");
        let direction = || fields.direction.ok_or("missing field `direction`: where the light shines, as [x, y, z]");
        Ok(match fields.r#type {
            LightType::Point => {
                let direction = fields.direction;
                Self::Point { position: position()?, direction, color, intensity, range, profile }
            }
            LightType::Spot => Self::Spot {
                position: position()?,
                direction: direction()?,
                color,
                intensity,
                range,
                inner_cone_degrees: fields.inner_cone_degrees.unwrap_or(0.0),
                outer_cone_degrees: fields.outer_cone_degrees.unwrap_or(45.0),
                falloff: fields.falloff.unwrap_or_default(),
                profile,
            },
            LightType::Directional => Self::Directional {
                direction: direction()?,
                color,
                intensity,
                angular_diameter_degrees: fields.angular_diameter_degrees.unwrap_or(0.0),
                visible,
            },
            LightType::Rect => Self::Rect {
                position: position()?,
                direction: direction()?,
                up: fields.up.unwrap_or([0.0, 1.0, 0.0]),
                width: fields.width.unwrap_or(1.0),
                height: fields.height.unwrap_or(1.0),
                color,
                intensity,
                visible,
            },
            LightType::Disk => {
                Self::Disk { position: position()?, direction: direction()?, radius, color, intensity, visible }
            }
            LightType::Sphere => Self::Sphere { position: position()?, radius, color, intensity, visible },
            LightType::Ambient => Self::Ambient { color, intensity },
        })
    }
}

impl LightFields {
    /// Refuses fields that this kind of light does not have.
    fn check_applicable(&self) -> Result<(), String> {
        use LightType::{Directional, Disk, Point, Rect, Sphere, Spot};
        let fields: [(&str, bool, &[LightType]); 14] = [
            ("position", self.position.is_some(), &[Point, Spot, Rect, Disk, Sphere]),
            ("direction", self.direction.is_some(), &[Point, Spot, Directional, Rect, Disk]),
            ("range", self.range.is_some(), &[Point, Spot]),
            ("inner_cone_degrees", self.inner_cone_degrees.is_some(), &[Spot]),
            ("outer_cone_degrees", self.outer_cone_degrees.is_some(), &[Spot]),
            ("falloff", self.falloff.is_some(), &[Spot]),
            ("angular_diameter_degrees", self.angular_diameter_degrees.is_some(), &[Directional]),
            ("up", self.up.is_some(), &[Rect]),
            ("width", self.width.is_some(), &[Rect]),
            ("height", self.height.is_some(), &[Rect]),
            ("radius", self.radius.is_some(), &[Disk, Sphere]),
            ("visible", self.visible.is_some(), &[Directional, Rect, Disk, Sphere]),
            ("ies", self.ies.is_some(), &[Point, Spot]),
            ("zero_azimuth", self.zero_azimuth.is_some(), &[Point, Spot]),
        ];
        for (name, given, kinds) in fields {
            if given && !kinds.contains(&self.r#type) {
                return Err(format!("unknown field `{name}`: this kind of light has none; leave it out"));
            }
        }
        let of_profile = [
            ("direction", self.direction.is_some() && self.r#type == Point),
            ("zero_azimuth", self.zero_azimuth.is_some()),
        ];
        if let Some((name, _)) = of_profile.iter().find(|(_, given)| *given && self.ies.is_none()) {
            return Err(format!("unknown field `{name}`: this light has none without a profile (`ies`); leave it out"));
        }
        Ok(())
    }
}

pub(super) fn check(check: &mut Check, lights: &[LightParams], most: usize) {
    check.require(lights.len() <= most, "lights", || format!("at most {most} lights are allowed here"));
    let extended = lights.iter().filter(|light| light.has_extent()).count();
    check.require(extended <= MAX_EXTENDED_LIGHTS, "lights", || {
        format!(
            "at most {MAX_EXTENDED_LIGHTS} may have an extent (rect, disk, sphere, angular_diameter_degrees), because each \
             ray looks for each of them: make the small ones points, or emitting meshes"
        )
    });
    for (index, light) in lights.iter().enumerate() {
        check.at(&format!("lights/{index}"), |check| check_light(check, light));
    }
}

fn check_light(check: &mut Check, light: &LightParams) {
    match light {
        LightParams::Point { position, direction, color, intensity, range, profile } => {
            check.finite(position, "position");
            direction.iter().for_each(|direction| check.direction(*direction, "direction"));
            check_profile(check, profile.as_ref());
            check_emission(check, color, *intensity);
            check.positive(range.map(f64::from), "range");
        }
        LightParams::Spot {
            position,
            direction,
            color,
            intensity,
            range,
            inner_cone_degrees: inner,
            outer_cone_degrees: outer,
            falloff: _,
            profile,
        } => {
            check.finite(position, "position");
            check_profile(check, profile.as_ref());
            check.direction(*direction, "direction");
            check_emission(check, color, *intensity);
            check.positive(range.map(f64::from), "range");
            check.require(*outer > 0.0 && *outer <= 90.0, "outer_cone_degrees", || {
                "must be above 0 and at most 90".to_owned()
            });
            check.require(*inner >= 0.0 && inner < outer, "inner_cone_degrees", || {
                "must be at least 0 and below `outer_cone_degrees`".to_owned()
            });
        }
        LightParams::Directional { direction, color, intensity, angular_diameter_degrees: diameter, visible: _ } => {
            check.direction(*direction, "direction");
            check_emission(check, color, *intensity);
            check.require(*diameter == 0.0 || SUNS.contains(diameter), "angular_diameter_degrees", || {
                format!("must be 0 for parallel light, or lie between {} and {}", SUNS.start(), SUNS.end())
            });
        }
        LightParams::Rect { position, direction, up, width, height, color, intensity, visible: _ } => {
            check.finite(position, "position");
            check.direction(*direction, "direction");
            check.direction(*up, "up");
            check_extent(check, *width, "width");
            check_extent(check, *height, "height");
            check_emission(check, color, *intensity);
        }
        LightParams::Disk { position, direction, radius, color, intensity, visible: _ } => {
            check.finite(position, "position");
            check.direction(*direction, "direction");
            check_extent(check, *radius, "radius");
            check_emission(check, color, *intensity);
        }
        LightParams::Sphere { position, radius, color, intensity, visible: _ } => {
            check.finite(position, "position");
            check_extent(check, *radius, "radius");
            check_emission(check, color, *intensity);
        }
        LightParams::Ambient { color, intensity } => check_emission(check, color, *intensity),
    }
}

fn check_profile(check: &mut Check, profile: Option<&ProfileParams>) {
    if let Some(ProfileParams { ies, zero_azimuth }) = profile {
        check.require(!ies.is_empty(), "ies", || "must be a file name or the id of a profile".to_owned());
        check.direction(*zero_azimuth, "zero_azimuth");
    }
}

fn check_extent(check: &mut Check, value: f32, name: &str) {
    check.require(EXTENTS.contains(&value), name, || {
        format!("must lie between {:e} and {:e} scene units", EXTENTS.start(), EXTENTS.end())
    });
}

fn check_emission(check: &mut Check, color: &[f32; 3], intensity: f32) {
    check.light(color, "color");
    check.light(&[intensity], "intensity");
    if intensity.is_finite() && color.iter().all(|c| c.is_finite()) {
        check.require(color.iter().all(|c| (c * intensity).is_finite()), "intensity", || {
            "times the colour is beyond what a 32-bit float holds".to_owned()
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::params::validate::tests::faults;

    #[test]
    fn lights_are_checked_each() {
        for (light, field) in [
            (r#"{"type": "point", "position": [0, 0, 0], "range": 0}"#, "/range"),
            (r#"{"type": "ambient", "color": [1, 1, -0.5]}"#, "/color"),
            (r#"{"type": "ambient", "intensity": -1}"#, "/intensity"),
            (r#"{"type": "ambient", "intensity": 1e30, "color": [1e20, 0, 0]}"#, "/intensity"),
            (r#"{"type": "directional", "direction": [0, 0, 0]}"#, "/direction"),
            (
                r#"{"type": "directional", "direction": [0, -1, 0], "angular_diameter_degrees": 181}"#,
                "/angular_diameter_degrees",
            ),
            (r#"{"type": "point", "position": [0, 0, 0], "ies": ""}"#, "/ies"),
            (r#"{"type": "point", "position": [0, 0, 0], "ies": "a.ies", "direction": [0, 0, 0]}"#, "/direction"),
            (r#"{"type": "point", "position": [0, 0, 0], "ies": "a.ies", "zero_azimuth": [0, 0, 0]}"#, "/zero_azimuth"),
            (r#"{"type": "sphere", "position": [0, 0, 0], "radius": 0}"#, "/radius"),
            (r#"{"type": "disk", "position": [0, 0, 0], "direction": [0, 0, 0]}"#, "/direction"),
            (r#"{"type": "rect", "position": [0, 0, 0], "direction": [0, -1, 0], "width": -1}"#, "/width"),
            (r#"{"type": "rect", "position": [0, 0, 0], "direction": [0, -1, 0], "up": [0, 0, 0]}"#, "/up"),
            (
                r#"{"type": "spot", "position": [0, 0, 0], "direction": [1, 0, 0], "outer_cone_degrees": 91}"#,
                "/outer_cone_degrees",
            ),
            (
                r#"{"type": "spot", "position": [0, 0, 0], "direction": [1, 0, 0], "inner_cone_degrees": 45}"#,
                "/inner_cone_degrees",
            ),
        ] {
            let json = format!(r#"{{"lights": [{{"type": "ambient"}}, {light}]}}"#);
            assert_eq!(faults(&json), [format!("/params/lights/1{field}")], "{light}");
        }
    }
}
