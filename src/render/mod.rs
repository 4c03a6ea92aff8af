//! Engines: (CompiledScene, Lighting, View, Settings) -> Film, in slices.

pub mod albedo;
mod apart;
pub mod cpu;
pub mod denoised;
mod engines;
pub mod forecast;
pub mod gpu;
mod guided;
pub mod layer_albedo;
mod plan;
pub mod prepare;
mod preview;
pub mod reach;
pub mod report;
pub mod schedule;
mod slice;
#[cfg(test)]
mod tests;

pub use apart::{ApartEngine, host};
pub use engines::Engines;

use crate::compile::{CompiledScene, Features, Lighting, View};
use crate::film::{Film, Guides};
use crate::params::{DirectParams, DirectShading, EngineChoice, Mode, PreviewParams};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// One picture to make. Cloning shares the heavy parts.
#[derive(Debug, Clone)]
pub struct Work {
    /// Geometry, materials, textures.
    pub scene: Arc<CompiledScene>,
    /// Light.
    pub lighting: Arc<Lighting>,
    /// Camera and film.
    pub view: View,
    /// What the three need.
    pub features: Features,
    /// Transport and when to stop.
    pub settings: Settings,
}

/// Transport parameters and stop criteria of one picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Who traces.
    pub engine: EngineChoice,
    /// Transport.
    pub mode: Mode,
    /// How light is looked for.
    pub strategy: Strategy,
    /// Scattering events per path; none: unlimited.
    pub max_bounces: Option<u32>,
    /// Energy compensation of microfacets.
    pub multiple_scattering: bool,
    /// Pieces of the way of what moves while the shutter is open; 0: it is open for no time.
    pub pieces: u32,
    /// Seed of every random number.
    pub seed: u32,
    /// Samples per pixel to stop at, on the average of the picture.
    pub max_samples: u32,
    /// More samples where the pilot has found more noise.
    pub adaptive: bool,
    /// Relative error to stop at.
    pub target_error: Option<f64>,
    /// Tracing time to stop at.
    pub deadline: Option<Duration>,
    /// Whether the picture is to be denoised, which takes [`Guides`].
    pub denoise: bool,
    /// How direct light is shaded.
    pub direct: DirectParams,
    /// How a preview is drawn.
    #[serde(with = "crate::pod::as_json")]
    pub preview: PreviewParams,
}

impl Settings {
    /// Whether surfaces reflect as Phong's do.
    pub fn is_phong(&self) -> bool {
        self.mode == Mode::Direct && self.direct.shading == DirectShading::Phong
    }
}

/// How light is looked for. Every choice gives the same picture but for noise: requests take the default, the others are there
/// to be compared with it (`candela bench error`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Strategy {
    /// Owen-scrambled Sobol points rather than independent random numbers.
    pub sobol: bool,
    /// Lights are sampled. Without, those that a scattered ray can meet are left to such rays.
    pub light_samples: bool,
    /// Scattered rays count the light that they meet, weighted where it was sampled too. Without, only light that no sample
    /// could have found counts.
    pub scattered_light: bool,
    /// Dim paths end by chance.
    pub roulette: bool,
}

impl Default for Strategy {
    fn default() -> Self {
        Self { sobol: true, light_samples: true, scattered_light: true, roulette: true }
    }
}

/// Why a render ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// `max_samples` were taken.
    MaxSamples,
    /// `target_error` was reached.
    TargetError,
    /// `deadline_ms` passed.
    Deadline,
}

impl StopReason {
    /// As the JSON has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::MaxSamples => "max_samples",
            Self::TargetError => "target_error",
            Self::Deadline => "deadline",
        }
    }
}

/// Samples that were dropped because they were not finite, by cause. A fault of the renderer: reported, never hidden.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct NonFinite {
    /// Radiance was NaN.
    pub nan: u64,
    /// Radiance was infinite.
    pub infinite: u64,
}

impl NonFinite {
    /// Those of both.
    pub fn and(self, other: Self) -> Self {
        Self { nan: self.nan + other.nan, infinite: self.infinite + other.infinite }
    }
}

/// What traces.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct DeviceInfo {
    /// `gpu` or `cpu`, as a request names it.
    #[serde(skip)]
    pub engine: &'static str,
    /// Name that the driver gives.
    pub name: String,
    /// `vulkan`, `metal`, `dx12`, `cpu`.
    pub backend: String,
    /// Driver and version; of a processor the instructions in use.
    pub driver: String,
    /// False for software rasterisers.
    pub hardware: bool,
}

/// Why a render failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, Serialize, Deserialize)]
pub enum RenderError {
    /// The scene does not fit this device.
    #[error("the scene does not fit the device: {0}")]
    TooLarge(String),
    /// The device was lost; begin again with the film so far.
    #[error("the device was lost: {0}")]
    DeviceLost(String),
    /// No usable adapter.
    #[error("no usable graphics adapter: {0}")]
    NoAdapter(String),
}

/// Something that traces, and what it holds. Lives on one thread.
pub trait Engine {
    /// Starts a render: uploads what the device does not hold yet. `film`: what an earlier, lost device had made.
    ///
    /// What takes long to make (a kernel) may still be in the making when this returns: see [`Render::is_ready`].
    fn begin(&mut self, work: Work, film: Option<Film>) -> Result<Box<dyn Render>, RenderError>;

    /// Starts a render, and waits until it is ready: for those who have nothing else to do meanwhile.
    fn begin_ready(&mut self, work: Work, film: Option<Film>) -> Result<Box<dyn Render>, RenderError> {
        let mut render = self.begin(work, film)?;
        while !render.is_ready() {
            render.step()?;
        }
        Ok(render)
    }
}

/// A render under way.
pub trait Render {
    /// What traces.
    fn device(&self) -> &DeviceInfo;

    /// Whether all is made that tracing needs. Until then a [`Self::step`] waits for it, a few milliseconds at most.
    fn is_ready(&self) -> bool {
        true
    }

    /// Traces one slice, at most about 50 ms on any device, and returns why the render ended, if it has.
    fn step(&mut self) -> Result<Option<StopReason>, RenderError>;

    /// The picture so far. It grows by whole passes over all pixels.
    fn film(&self) -> &Film;

    /// Ends the render early and hands the film out.
    fn into_film(self: Box<Self>) -> Film;

    /// Part of `max_samples` done, 0 to 1, finer than passes.
    fn progress(&self) -> f64;

    /// Dropped samples.
    fn non_finite(&self) -> NonFinite;

    /// What guides a denoiser, handed out once: of renders whose settings ask for it, before the first sample.
    fn take_guides(&mut self) -> Option<Guides> {
        None
    }
}
