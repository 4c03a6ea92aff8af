//! [`Lighting`] and its tables, as kernels read them.

use crate::scene::Profile;
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
use std::sync::Arc;

/// Light of one request: everything that can be sampled, as tables.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Lighting {
    /// Lights that can reach the scene, of non-zero power; those with an extent first.
    #[serde(with = "crate::pod")]
    pub lights: Vec<PunctualLight>,
    /// Number of those with an extent.
    pub extended: u32,
    /// The same lights at the ends of the pieces of their way while the shutter is open, a list behind the other, where one of them
    /// moves; else empty.
    #[serde(with = "crate::pod")]
    pub way: Vec<PunctualLight>,
    /// Measured distributions of some of the lights.
    pub profiles: Vec<Profile>,
    /// Names of the groups that the picture's light is split by, the standing ones first ([`STANDING_GROUPS`]); empty: it is not split.
    ///
    /// [`STANDING_GROUPS`]: crate::params::STANDING_GROUPS
    pub groups: Vec<String>,
    /// Entries of `lights` then emitters; empty if there are neither. All are an alias table; if there is a tree, those of `lights`.
    #[serde(with = "crate::pod")]
    pub picks: Vec<LightPick>,
    /// Probability of looking in [`CompiledScene::light_tree`](super::CompiledScene::light_tree) rather than in the table; 0: there is
    /// no tree.
    pub tree_probability: f32,
    /// Light from infinity.
    pub environment: Environment,
    /// Probability of sampling the environment rather than `picks` at a shading point.
    pub environment_probability: f32,
    /// Number of lights of the request and the file that were left out, and why: for the reply.
    pub skipped: u32,
}

impl Lighting {
    /// The lights at every moment at which any of them is looked at; the first come first.
    pub fn over_time(&self) -> &[PunctualLight] {
        if self.moves() { &self.way } else { &self.lights }
    }

    /// Whether a light moves while the shutter is open.
    pub fn moves(&self) -> bool {
        !self.way.is_empty()
    }

    /// Candela of a light's profile towards a direction of unit length, on which its intensity is a factor; 1 without a profile.
    pub fn profile_factor(&self, light: &PunctualLight, direction: DVec3) -> f64 {
        profile_factor(&self.profiles, light, direction)
    }

    /// Entries of `picks` that are the alias table.
    pub fn table(&self) -> &[LightPick] {
        let count = if self.tree_probability > 0.0 { self.lights.len() } else { self.picks.len() };
        self.picks.get(..count).unwrap_or_default()
    }
}

/// Index into [`Lighting::groups`] of light from infinity.
pub const ENVIRONMENT_GROUP: usize = 0;
/// Of surfaces that emit.
pub const SURFACES_GROUP: usize = 1;
/// Of lights that no named group has.
pub const LIGHTS_GROUP: usize = 2;

/// Kinds of [`PunctualLight`]. Those from `Sun` on have an extent: rays can meet them, which go on behind them, for they emit and
/// block nothing.
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
    /// To one side, with the cosine from the axis.
    Cosine = 4,
    /// Disk at infinity.
    Sun = 5,
    /// Ball that shines outwards.
    Sphere = 6,
    /// Disk that shines to one side.
    Disk = 7,
    /// Rectangle that shines to one side.
    Rect = 8,
}

impl PunctualKind {
    /// As [`PunctualLight::kind`] has it, of a light with an extent that the camera sees or not.
    pub fn record(self, visible: bool) -> u32 {
        self as u32 | if visible { PunctualLight::VISIBLE } else { 0 }
    }
}

/// A light that is no triangle, as kernels read it.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PunctualLight {
    /// Relative to the origin; directional: unused.
    pub position: [f32; 3],
    /// [`PunctualKind`], [`PunctualLight::VISIBLE`], from [`PunctualLight::GROUP_SHIFT`] on its group where light is split, and
    /// from [`PunctualLight::PROFILE_SHIFT`] on one more than the index into [`Lighting::profiles`], or 0.
    pub kind: u32,
    /// Direction that it shines in, unit length.
    pub direction: [f32; 3],
    /// Range; infinity: none.
    pub range: f32,
    /// Candela, or with a profile a factor on it; lux (directional, sun); radiance (sphere, disk, rect).
    pub intensity: [f32; 3],
    /// Spot: cosine of the inner cone (`SpotLinear`: its angle). Sun: 1 less the cosine of its half angle. Sphere, disk: radius.
    /// Rect: half width.
    pub inner: f32,
    /// Rect: unit vector along its width. With a profile: its zero azimuth, a unit vector at right angles to the direction.
    pub axis: [f32; 3],
    /// Spot: cosine of the outer cone (`SpotLinear`: its angle). Rect: half height.
    pub outer: f32,
}

impl PunctualLight {
    /// Bit of `kind`: the camera sees it.
    pub const VISIBLE: u32 = 1 << 8;
    /// Bits of `kind` below the index of its group, which has seven.
    pub const GROUP_SHIFT: u32 = 9;
    /// Bits of `kind` below the index of its profile.
    pub const PROFILE_SHIFT: u32 = 16;

    /// [`PunctualKind`].
    pub fn kind(&self) -> u32 {
        self.kind & (Self::VISIBLE - 1)
    }

    /// Index of its group; 0 where light is not split.
    pub fn group(&self) -> usize {
        (self.kind >> Self::GROUP_SHIFT & 0x7f) as usize
    }

    /// Index of its profile.
    pub fn profile(&self) -> Option<usize> {
        (self.kind >> Self::PROFILE_SHIFT).checked_sub(1).map(|index| index as usize)
    }

    /// Whether rays can meet it.
    pub fn has_extent(&self) -> bool {
        self.kind() >= PunctualKind::Sun as u32
    }

    /// Of a sphere, a disk or a rectangle.
    pub fn area(&self) -> f32 {
        match self.kind() {
            kind if kind == PunctualKind::Sphere as u32 => 4.0 * PI * self.inner * self.inner,
            kind if kind == PunctualKind::Disk as u32 => PI * self.inner * self.inner,
            kind if kind == PunctualKind::Rect as u32 => 4.0 * self.inner * self.outer,
            _ => 0.0,
        }
    }
}

/// As [`Lighting::profile_factor`].
pub(super) fn profile_factor(profiles: &[Profile], light: &PunctualLight, direction: DVec3) -> f64 {
    let Some(profile) = light.profile() else { return 1.0 };
    let [beam, zero] = [light.direction, light.axis].map(|axis| DVec3::from(axis.map(f64::from)));
    profiles.get(profile).map_or(0.0, |profile| profile.candela(beam, zero, direction))
}

/// Entry of the alias table over lights (Walker 1974; Vose 1991), with what a sampled light needs at hand.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LightPick {
    /// Probability of keeping this entry rather than taking `alias`.
    pub keep: f32,
    /// The other entry.
    pub alias: u32,
    /// Probability of this entry being picked from the table.
    pub probability: f32,
    /// World area of an emitting triangle; 0: one of `lights`.
    pub area: f32,
    /// Emitter: its instance. Else: index into `lights`.
    pub index: u32,
    /// Emitter: its triangle.
    pub triangle: u32,
    /// Emitter in a tree: the way to it ([`LightTree::trails`](super::LightTree::trails)).
    pub trail: u32,
    /// Unused.
    pub pad: u32,
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
    /// Of each column of tiles ([`TILES`](super::TILES)) the distribution functions over the rows of cells, `height + 1` numbers: probability,
    /// given the tile, of this row or one above it.
    #[serde(with = "crate::pod")]
    pub rows: Vec<f32>,
    /// Of each facing the shares of the tiles: see [`Hdri::facing`].
    #[serde(with = "crate::pod")]
    pub tiles: Vec<Share>,
    /// Integral of luminance over the sphere.
    pub power: f32,
}

/// A cell of an environment. Cells are found by inverting distribution functions rather than by an alias table, which
/// would tear apart the neighbourhoods that well-spread samples rely on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct EnvironmentCell {
    /// Distribution function within the row of its tile: probability, given both, of this cell or one before it.
    pub cumulative: f32,
    /// Density over solid angle within the cell (1/sr), given its tile; constant, cells being sampled uniformly in solid angle.
    pub pdf: f32,
}

/// A row of tiles of an environment, or a tile of a row.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Share {
    /// Distribution function among the rows, or in the row: probability of this one or one before it.
    pub cumulative: f32,
    /// Probability of this one among all rows, or all tiles.
    pub probability: f32,
}
