//! Which triangles need their alpha tested: only those whose alpha is neither surely one nor surely nothing.
//!
//! Bilinear filtering and barycentric interpolation stay within the range of what they mix, so ranges decide.

use super::texels::{TexelCounts, Texels};
use super::{Material, TexturePages};
use crate::scene::AlphaMode;
use glam::Vec2;

/// What alpha does to a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Presence {
    /// There, all of it.
    Full,
    /// To be tested at each hit.
    Partial,
    /// Not there at all.
    Absent,
}

/// Decides for the triangles of one material.
pub struct AlphaTest<'a> {
    mode: AlphaMode,
    factor: f32,
    texture: Option<Ranges<'a>>,
}

struct Ranges<'a> {
    uv_set: usize,
    /// Texels whose alpha is below what is full.
    not_full: TexelCounts<'a>,
    /// Texels whose alpha is above what is nothing.
    present: TexelCounts<'a>,
}

impl<'a> AlphaTest<'a> {
    /// Prepares the decision.
    pub fn new(material: &'a Material, mode: AlphaMode, pages: &'a TexturePages) -> Self {
        let texture = match mode {
            AlphaMode::Opaque => None,
            _ => Texels::new(pages, &material.base_color_texture),
        };
        let texture = texture.map(|texels| Ranges {
            uv_set: texels.uv_set(),
            not_full: TexelCounts::new(texels, |texel| texel[3] < 255),
            present: TexelCounts::new(texels, |texel| texel[3] > 0),
        });
        Self { mode, factor: material.base_color[3], texture }
    }

    /// Which uv set it wants to see.
    pub fn uv_set(&self) -> Option<usize> {
        self.texture.as_ref().map(|ranges| ranges.uv_set)
    }

    /// Decides on a triangle from its texture coordinates (zero if it has none) and alpha of vertex colours.
    pub fn presence(&self, uvs: [Vec2; 3], alphas: [f32; 3]) -> Presence {
        if self.mode == AlphaMode::Opaque {
            return Presence::Full;
        }
        let (mut low, mut high) = self.texture.as_ref().map_or((1.0, 1.0), |ranges| ranges.alpha(uvs));
        low *= self.factor * alphas.into_iter().fold(f32::INFINITY, f32::min);
        high *= self.factor * alphas.into_iter().fold(0.0, f32::max);
        let (full, nothing) = match self.mode {
            AlphaMode::Mask { cutoff } => (low >= cutoff, high < cutoff),
            _ => (low >= 1.0, high <= 0.0),
        };
        match (full, nothing) {
            (true, _) => Presence::Full,
            (false, true) => Presence::Absent,
            _ => Presence::Partial,
        }
    }
}

impl Ranges<'_> {
    /// Bounds of the texture's alpha over a triangle.
    fn alpha(&self, uvs: [Vec2; 3]) -> (f32, f32) {
        let low = if self.not_full.none() || self.not_full.around(uvs).0 == 0 { 1.0 } else { 0.0 };
        let high = if self.present.none() || self.present.around(uvs).0 == 0 { 0.0 } else { 1.0 };
        (low, high)
    }
}
