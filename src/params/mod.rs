//! Render parameters: one JSON shape for HTTP, the command line and the page.
//!
//! Pure data: this room knows nothing of scenes, devices or HTTP. Unknown fields are refused by name.
//! Angles are in degrees where the name says so, lengths in scene units, colours linear Rec. 709.

mod biases;
mod environment;
mod images;
mod light_groups;
mod lights;
mod parse;
mod preview;
mod query;
mod shutter;
mod strict;
mod surfaces;
mod validate;
mod wording;

pub use environment::{EnvironmentChoice, EnvironmentParams, GradientParams};
pub use light_groups::{LightGroups, STANDING_GROUPS};
pub use lights::{LightParams, ProfileParams, SpotFalloff};
pub use parse::{from_json, from_json_and_query, from_query, read};
pub use preview::{
    Attenuation, AttenuationKind, MAX_SHADOW_LIGHTS, PreviewParams, Shading, ShadingPath, ShadowAlgorithm, ShadowBias,
    ShadowHash, ShadowParams, SpotEdge,
};
pub use shutter::{MAX_STEPS, ShutterParams};
pub use strict::{JsonError, json};
pub use surfaces::{
    Axis, Maps, NormalParams, OverrideParams, ParallaxMethod, ParallaxParams, ReliefParams, SphereParams, TextureParams,
};
pub use validate::{FieldError, ParamLimits};
pub(crate) use wording::nearest;

use serde::{Deserialize, Serialize};

/// Everything that a picture depends on, besides the scene's bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RenderParams {
    /// Transport: full path tracing, direct light with mirrors only, or a rasterised preview.
    pub mode: Mode,
    /// Which engine traces.
    pub engine: EngineChoice,
    /// Picture width in pixels.
    pub width: u32,
    /// Picture height in pixels.
    pub height: u32,
    /// Index of the glTF scene to draw; none: the file's default scene, else its first.
    pub scene: Option<usize>,
    /// Name of the variant whose materials are drawn (KHR_materials_variants); none: the default materials.
    pub variant: Option<String>,
    /// Seconds into the animation; none: the scene stands as the file stores it.
    pub time: Option<f64>,
    /// Which animation of the file moves the scene; none: its first, if there is a `time`.
    pub animation: Option<AnimationChoice>,
    /// How long light is collected, so that what moves is blurred; none: for no time at all.
    pub shutter: Option<ShutterParams>,
    /// Where to look from; none: the scene's first camera, else automatic framing.
    pub camera: Option<CameraParams>,
    /// Lights added to those of the file.
    pub lights: Vec<LightParams>,
    /// Whether the lights of the file (KHR_lights_punctual) shine.
    pub scene_lights: bool,
    /// Groups of lights that a picture's light is split by, besides the standing ones; none: it is not split.
    pub light_groups: Option<LightGroups>,
    /// Spheres added to the file's meshes.
    pub spheres: Vec<SphereParams>,
    /// Other values and maps for materials of the file.
    pub overrides: Vec<OverrideParams>,
    /// Light from infinity. Absent: automatic (neutral unless other light is enough for a picture); `null`: none.
    #[serde(skip_serializing_if = "EnvironmentChoice::is_auto")]
    pub environment: EnvironmentChoice,
    /// Samples per pixel at which the render stops, on the average of the picture.
    pub max_samples: u32,
    /// More samples where there is more noise, as a pilot of 16 samples per pixel finds it (unbiased: docs/accuracy.md).
    pub adaptive: bool,
    /// Relative error at which the render stops (docs/accuracy.md has the definition); none: not a criterion.
    pub target_error: Option<f64>,
    /// Wall time of tracing after which the render stops with what it has; none: not a criterion.
    pub deadline_ms: Option<u64>,
    /// Scattering events per path: 0 shows emission only, 1 adds direct light. None: unlimited (unbiased).
    pub max_bounces: Option<u32>,
    /// Seed of every random number.
    pub seed: u32,
    /// Reconstruction filter of the pixels.
    pub filter: Filter,
    /// Energy compensation for multiple scattering in microfacets (docs/accuracy.md). Off: the single-scattering
    /// formulas of the glTF appendix.
    pub multiple_scattering: bool,
    /// Whether the noise that is left is smoothed by Open Image Denoise.
    pub denoise: bool,
    /// How `mode: direct` shades.
    pub direct: DirectParams,
    /// How `mode: preview` draws.
    pub preview: PreviewParams,
    /// Curve from scene-linear to display-linear.
    pub tone_mapping: ToneMapping,
    /// Exposure in stops.
    pub exposure: f32,
    /// File format and what goes with it.
    pub output: OutputParams,
}

impl Default for RenderParams {
    fn default() -> Self {
        Self {
            mode: Mode::Path,
            engine: EngineChoice::Auto,
            width: 1200,
            height: 500,
            scene: None,
            variant: None,
            time: None,
            animation: None,
            shutter: None,
            camera: None,
            lights: Vec::new(),
            scene_lights: true,
            light_groups: None,
            spheres: Vec::new(),
            overrides: Vec::new(),
            environment: EnvironmentChoice::Auto,
            max_samples: 256,
            adaptive: true,
            target_error: None,
            deadline_ms: None,
            max_bounces: None,
            seed: 1,
            filter: Filter::default(),
            multiple_scattering: true,
            denoise: false,
            direct: DirectParams::default(),
            preview: PreviewParams::default(),
            tone_mapping: ToneMapping::Aces,
            exposure: 0.0,
            output: OutputParams::default(),
        }
    }
}

/// An animation of the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected the index or the name of an animation")]
pub enum AnimationChoice {
    /// By its place in the file.
    Index(usize),
    /// By its name.
    Name(String),
}

/// Kind of light transport.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// All paths of light.
    Path,
    /// Light straight from punctual lights with hard shadows; only perfect mirrors are followed.
    Direct,
    /// Rasterised: light straight from punctual lights and the environment, shadow maps ([`PreviewParams`]).
    Preview,
}

/// How `mode: direct` shades.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DirectParams {
    /// Reflection of surfaces.
    pub shading: DirectShading,
    /// Strength of Phong's highlight.
    pub specular: f32,
}

impl Default for DirectParams {
    fn default() -> Self {
        Self { shading: DirectShading::Pbr, specular: 0.5 }
    }
}

/// Reflection of surfaces in `mode: direct`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DirectShading {
    /// As in `mode: path`; mirrors are surfaces of roughness 0.
    #[default]
    Pbr,
    /// Phong's: a mirror of the surface's reflectivity, and of what it leaves Lambert and `specular (R.V)^s` over pi, where the
    /// roughness says how narrow the highlight is.
    Phong,
}

/// Which engine traces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EngineChoice {
    /// The server chooses; the reply says what it chose.
    Auto,
    /// The wgpu compute tracer, f32.
    Gpu,
    /// The tracer for processors, f64.
    Cpu,
}

/// A camera of the scene by index or name, or one given in place, or an orbit around the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraParams {
    /// Index of a camera node of the chosen glTF scene, in the order that the scene's description lists them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub index: Option<usize>,
    /// Name of a camera (or of its node) of the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Angles around the target, and distance from it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orbit: Option<OrbitParams>,
    /// Eye point, world space.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 3]>,
    /// Point looked at, world space; with `orbit`, its centre (none: the centre of the scene's bounds).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<[f64; 3]>,
    /// Up direction.
    pub up: [f64; 3],
    /// Vertical field of view; none: 45, or what the scene's camera has.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub yfov_degrees: Option<f64>,
    /// Radius of the thin lens in scene units; 0 is a pinhole.
    pub aperture_radius: f64,
    /// Sides of the lens' opening, a regular polygon in the circle of that radius; 0: round.
    pub blades: u32,
    /// Turn of the polygon, whose first corner else points up, counter-clockwise as the camera sees.
    pub blade_rotation_degrees: f64,
    /// Distance of the plane in focus along the view axis; none: the distance to the target.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focus_distance: Option<f64>,
}

impl Default for CameraParams {
    fn default() -> Self {
        Self {
            index: None,
            name: None,
            orbit: None,
            position: None,
            target: None,
            up: [0.0, 1.0, 0.0],
            yfov_degrees: None,
            aperture_radius: 0.0,
            blades: 0,
            blade_rotation_degrees: 0.0,
            focus_distance: None,
        }
    }
}

/// `eye = target + distance * (sin azimuth cos elevation, sin elevation, cos azimuth cos elevation)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OrbitParams {
    /// Turn about +y from +z towards +x.
    pub azimuth_degrees: f64,
    /// Height above the horizon.
    pub elevation_degrees: f64,
    /// Distance from the target; none: so that the whole scene is in the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance: Option<f64>,
}

impl Default for OrbitParams {
    fn default() -> Self {
        Self { azimuth_degrees: 30.0, elevation_degrees: 20.0, distance: None }
    }
}

/// Reconstruction filter, importance sampled per pixel (so that pixels stay independent).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Filter {
    /// Shape.
    pub kind: FilterKind,
    /// Half width in pixels; none: the kind's own (box 0.5, triangle 1, gaussian 1.5, Blackman-Harris 1.5).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius: Option<f32>,
}

impl Default for Filter {
    fn default() -> Self {
        Self { kind: FilterKind::BlackmanHarris, radius: None }
    }
}

impl Filter {
    /// Half width in pixels.
    pub fn radius(&self) -> f32 {
        self.radius.unwrap_or(match self.kind {
            FilterKind::Box => 0.5,
            FilterKind::Triangle => 1.0,
            FilterKind::Gaussian | FilterKind::BlackmanHarris => 1.5,
        })
    }
}

/// Shape of the reconstruction filter (all of them positive).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FilterKind {
    /// Uniform over the pixel.
    Box,
    /// Tent.
    Triangle,
    /// Gaussian, standard deviation a third of the radius.
    Gaussian,
    /// Four-term Blackman-Harris window.
    BlackmanHarris,
}

/// Curve from scene-linear to display-linear.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToneMapping {
    /// Clip at 1.
    Linear,
    /// `x / (1 + x)` per channel.
    Reinhard,
    /// ACESFilmicToneMapping of three.js.
    Aces,
    /// AgX.
    Agx,
    /// Khronos PBR Neutral.
    PbrNeutral,
}

/// File format of the result.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutputParams {
    /// Container.
    pub format: ImageFormat,
    /// Bits per channel of a PNG: 8 or 16.
    pub bits: u8,
    /// Pixels where the camera sees nothing have alpha 0.
    pub transparent: bool,
}

impl Default for OutputParams {
    fn default() -> Self {
        Self { format: ImageFormat::Png, bits: 8, transparent: false }
    }
}

/// Container of the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageFormat {
    /// Tone mapped, sRGB, with the render's facts as text.
    Png,
    /// Scene-linear f32.
    Exr,
    /// Tone mapped, lossless.
    Webp,
    /// Tone mapped, quality 95, no alpha.
    Jpeg,
}

impl ImageFormat {
    /// What the name of a file of this format ends in.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Exr => "exr",
            Self::Webp => "webp",
            Self::Jpeg => "jpg",
        }
    }
}

impl ImageFormat {
    /// Longest side in pixels that the format can hold.
    pub fn max_side(self) -> u32 {
        match self {
            Self::Webp => 1 << 14,
            Self::Jpeg => u32::from(u16::MAX),
            Self::Png | Self::Exr => i32::MAX as u32,
        }
    }
}
