//! [`Lighting`] and its tables, as kernels read them.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Light of one request: everything that can be sampled, as tables.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Lighting {
    /// Punctual lights that can reach the scene, of non-zero power.
    #[serde(with = "crate::pod")]
    pub lights: Vec<PunctualLight>,
    /// Alias table over `lights` then emitters; empty if there are neither.
    #[serde(with = "crate::pod")]
    pub picks: Vec<LightPick>,
    /// Light from infinity.
    pub environment: Environment,
    /// Probability of sampling the environment rather than `picks` at a shading point.
    pub environment_probability: f32,
    /// Number of lights of the request and the file that were left out, and why: for the reply.
    pub skipped: u32,
}

/// Kinds of [`PunctualLight`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum PunctualKind {
    /// Parallel.
    Directional = 0,
    /// To all sides.
    Point = 1,
    /// Cone, glTF fall-off.
    Spot = 2,
    /// Cone, fall-off linear in the angle.
    SpotLinear = 3,
}

/// A punctual light as kernels read it.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PunctualLight {
    /// Relative to the origin; directional: unused.
    pub position: [f32; 3],
    /// [`PunctualKind`].
    pub kind: u32,
    /// Direction that it shines in, unit length.
    pub direction: [f32; 3],
    /// Range; infinity: none.
    pub range: f32,
    /// Candela or lux.
    pub intensity: [f32; 3],
    /// Spot: cosine of the inner cone (`SpotLinear`: its angle).
    pub inner: f32,
    /// Spot: cosine of the outer cone (`SpotLinear`: its angle).
    pub outer: f32,
    /// Unused.
    pub pad: [f32; 3],
}

/// Entry of the alias table over lights (Walker 1974; Vose 1991), with what a sampled light needs at hand.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LightPick {
    /// Probability of keeping this entry rather than taking `alias`.
    pub keep: f32,
    /// The other entry.
    pub alias: u32,
    /// Probability of this entry being picked in all.
    pub probability: f32,
    /// World area of an emitting triangle; 0: a punctual light.
    pub area: f32,
    /// Emitter: its instance. Punctual: index into `lights`.
    pub index: u32,
    /// Emitter: its triangle.
    pub triangle: u32,
    /// Unused.
    pub pad: [u32; 2],
}

/// Light from infinity.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Environment {
    /// What it shows.
    pub kind: EnvironmentKind,
    /// Factor on the radiance (in the tables already for `Hdri`: no).
    pub intensity: f32,
    /// Turn about +y in radians; a direction d looks up `R_y(-rotation) d`.
    pub rotation: f32,
    /// Whether camera rays see it.
    pub visible: bool,
    /// Constant radiance added for all but camera rays (ambient lights).
    pub ambient: Vec3,
}

impl Default for Environment {
    fn default() -> Self {
        Self { kind: EnvironmentKind::None, intensity: 1.0, rotation: 0.0, visible: true, ambient: Vec3::ZERO }
    }
}

/// What an environment shows.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub enum EnvironmentKind {
    /// Black.
    #[default]
    None,
    /// The same from everywhere.
    Constant(Vec3),
    /// By height: bottom at y = -1, horizon at 0, top at 1, linear between.
    Gradient {
        /// Straight up.
        top: Vec3,
        /// At the horizon.
        horizon: Vec3,
        /// Straight down.
        bottom: Vec3,
    },
    /// Equirectangular picture.
    #[serde(skip)]
    Hdri(Arc<Hdri>),
}

/// An equirectangular picture with its sampling table. `u = 0.5 + atan2(z, x) / 2pi`, v from the top.
/// Radiance is bilinear between texel centres, repeated in u and clamped in v.
#[derive(Debug, Serialize, Deserialize)]
pub struct Hdri {
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Row by row from the top, linear RGB.
    #[serde(with = "crate::pod")]
    pub texels: Vec<[f32; 3]>,
    /// Cells between texel centres: `width` columns, `height + 1` rows (the first and the last row are half cells at the
    /// poles). Cell (i, j) spans u from (i + 0.5) / width to (i + 1.5) / width and v from max(j - 0.5, 0) / height to
    /// min(j + 0.5, height) / height.
    #[serde(with = "crate::pod")]
    pub cells: Vec<EnvironmentCell>,
    /// Distribution function over the rows of cells: probability of this row or one above it.
    #[serde(with = "crate::pod")]
    pub rows: Vec<f32>,
    /// Integral of luminance over the sphere.
    pub power: f32,
}

/// A cell of an environment. Cells are found by inverting distribution functions rather than by an alias table, which
/// would tear apart the neighbourhoods that well-spread samples rely on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct EnvironmentCell {
    /// Distribution function within the row: probability, given the row, of this cell or one before it.
    pub cumulative: f32,
    /// Density over solid angle within the cell (1/sr); constant, cells being sampled uniformly in solid angle.
    pub pdf: f32,
}
