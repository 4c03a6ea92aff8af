//! Encoded equirectangular pictures -> [`Hdri`].

use super::Hdri;
use super::emitters::{linear, luminance};
use super::tiles::Tiling;
use glam::Vec3;
use image::{DynamicImage, ImageReader, Limits};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::io::Cursor;

/// Pixels that are read where nobody sets another limit: 8192 x 4096.
pub const ENVIRONMENT_PIXELS: u64 = 8192 * 4096;
/// Largest side.
const MAX_SIDE: u32 = 16384;
/// Most bytes that decoding may take.
const MAX_ALLOC: u64 = 1 << 30;

/// Why a picture cannot serve as an environment.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum HdriError {
    /// Not a picture in a known format, or cut off.
    #[error("the picture cannot be decoded: {0}; send Radiance .hdr, OpenEXR, PNG, JPEG or WebP")]
    Undecodable(String),
    /// Beyond the limits.
    #[error(
        "the picture is {width} x {height}; at most {limit} pixels are read (limit environment_pixels), and {MAX_SIDE} a \
         side: shrink it"
    )]
    TooLarge {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// Most pixels.
        limit: u64,
    },
    /// No texels.
    #[error("the picture has no texels")]
    Empty,
    /// A texel that no light has.
    #[error("texel ({x}, {y}) is {what}; radiance must be finite and not negative")]
    Texel {
        /// Column.
        x: u32,
        /// Row.
        y: u32,
        /// `negative`, `not a number` or `infinite`.
        what: &'static str,
    },
}

/// Decodes Radiance .hdr or OpenEXR (linear), or pictures of 8 or 16 bits (sRGB).
///
/// `limit`: most pixels, like [`ENVIRONMENT_PIXELS`].
pub fn decode_hdri(bytes: &[u8], limit: u64) -> Result<Hdri, HdriError> {
    let (width, height, texels) = decode_radiance(bytes, limit)?;
    Ok(Hdri::new(width, height, texels))
}

/// Width, height and linear radiance of the same, by rows from the top: without the tables that it is sampled by.
///
/// # Errors
/// As [`decode_hdri`].
pub fn decode_radiance(bytes: &[u8], limit: u64) -> Result<(u32, u32, Vec<[f32; 3]>), HdriError> {
    let undecodable = |error: &dyn std::fmt::Display| HdriError::Undecodable(error.to_string());
    let reader = || ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let (width, height) =
        reader().map_err(|e| undecodable(&e))?.into_dimensions().map_err(|error| undecodable(&error))?;
    if width == 0 || height == 0 {
        return Err(HdriError::Empty);
    }
    if width.max(height) > MAX_SIDE || u64::from(width) * u64::from(height) > limit {
        return Err(HdriError::TooLarge { width, height, limit });
    }
    let mut reader = reader().map_err(|error| undecodable(&error))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_ALLOC);
    reader.limits(limits);
    let texels = linear_texels(reader.decode().map_err(|error| undecodable(&error))?);
    check(&texels, width)?;
    Ok((width, height, texels))
}

fn linear_texels(picture: DynamicImage) -> Vec<[f32; 3]> {
    match picture {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            picture.into_rgb32f().pixels().map(|pixel| pixel.0).collect()
        }
        _ => picture.into_rgb8().pixels().map(|pixel| pixel.0.map(linear)).collect(),
    }
}

fn check(texels: &[[f32; 3]], width: u32) -> Result<(), HdriError> {
    let bad = |value: &f32| !(value.is_finite() && *value >= 0.0);
    let Some(index) = texels.iter().position(|texel| texel.iter().any(bad)) else { return Ok(()) };
    let value = texels[index].into_iter().find(bad).unwrap_or_default();
    let what = match value {
        _ if value.is_nan() => "not a number",
        _ if value < 0.0 => "negative",
        _ => "infinite",
    };
    let index = index as u32;
    Err(HdriError::Texel { x: index % width, y: index / width, what })
}

impl Hdri {
    /// A picture with its sampling table.
    ///
    /// # Panics
    /// If there are not `width * height` texels, or none.
    pub fn new(width: u32, height: u32, texels: Vec<[f32; 3]>) -> Self {
        assert!(texels.len() == width as usize * height as usize && !texels.is_empty(), "one texel per place");
        let luminances: Vec<f32> = texels.par_iter().map(|texel| luminance(Vec3::from_array(*texel))).collect();
        let solid_angles = cell_solid_angles(width, height);
        let mut weights = cell_weights(width, height, &luminances, &solid_angles);
        let power = weights.iter().sum::<f64>();
        if power == 0.0 {
            weights = (0..weights.len()).map(|cell| solid_angles[cell / width as usize]).collect();
        }
        let tiling = Tiling { width: width as usize, rows: height as usize + 1 };
        let (rows, cells) = tiling.within(&weights, &solid_angles);
        let tiles = tiling.facing_tables(&weights);
        Self { width, height, cells, rows, tiles, power: power as f32, texels }
    }
}

/// Solid angle of a cell of each row.
fn cell_solid_angles(width: u32, height: u32) -> Vec<f64> {
    let edge = |j: u32| ((f64::from(j) - 0.5).clamp(0.0, f64::from(height)) / f64::from(height) * PI).cos();
    (0..=height).map(|j| TAU / f64::from(width) * (edge(j) - edge(j + 1))).collect()
}

/// Mean luminance of the four texels that a cell interpolates between, times its solid angle.
fn cell_weights(width: u32, height: u32, luminances: &[f32], solid_angles: &[f64]) -> Vec<f64> {
    let (width, height) = (width as usize, height as usize);
    let row = |j: usize| &luminances[j * width..(j + 1) * width];
    let mut weights = vec![0.0; width * (height + 1)];
    weights.par_chunks_mut(width).enumerate().for_each(|(j, weights)| {
        let (above, below) = (row(j.saturating_sub(1)), row(j.min(height - 1)));
        for (i, weight) in weights.iter_mut().enumerate() {
            let next = if i + 1 == width { 0 } else { i + 1 };
            let sum = [above[i], above[next], below[i], below[next]].map(f64::from).iter().sum::<f64>();
            *weight = sum * 0.25 * solid_angles[j];
        }
    });
    weights
}
