//! Pictures side by side in one file, for people to look at.

use crate::film::Picture;
use crate::film::tone_mapping::srgb_encode;
use anyhow::{Context, Result};
use image::{Rgb, RgbImage};
use std::path::Path;

/// Writes rows of pictures of one size, clipped at white.
///
/// # Errors
/// The file cannot be written.
pub fn write_sheet(path: &Path, rows: &[Vec<Picture>]) -> Result<()> {
    let Some(first) = rows.first().and_then(|row| row.first()) else { return Ok(()) };
    let (width, height) = (first.width, first.height);
    let byte = |x: f32| (255.0 * srgb_encode(x.clamp(0.0, 1.0))).round() as u8;
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let sheet = RgbImage::from_fn(width * columns, height * rows.len() as u32, |x, y| {
        let picture = rows[(y / height) as usize].get((x / width) as usize);
        let pixel = picture.and_then(|picture| picture.pixels.get((y % height * width + x % width) as usize));
        Rgb(pixel.map_or([255; 3], |&[r, g, b, _]| [r, g, b].map(byte)))
    });
    sheet.save(path).with_context(|| path.display().to_string())
}
