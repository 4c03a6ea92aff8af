//! Texture look-up: sampler state of glTF 2.0 (3.8.4), bilinear between linear values.

use crate::compile::{NONE, TexturePages, TextureSlot};
use glam::{DVec2, DVec4};
use std::sync::LazyLock;

/// How the bytes of a page's colour channels are to be read. Alpha is always linear.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// sRGB (IEC 61966-2-1).
    Srgb,
    /// As they are.
    Linear,
}

/// sRGB byte -> linear (IEC 61966-2-1).
static FROM_SRGB: LazyLock<[f64; 256]> = LazyLock::new(|| {
    std::array::from_fn(|byte| {
        let x = byte as f64 / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    })
});

/// Value of a texture at texture coordinates; white if there is no texture.
pub fn sample(pages: &TexturePages, encoding: Encoding, slot: &TextureSlot, uvs: [DVec2; 2]) -> DVec4 {
    if slot.info == NONE {
        return DVec4::ONE;
    }
    sample_texels(pages, encoding, slot, texel_position(slot, uvs))
}

/// Texels across and down.
pub fn size(slot: &TextureSlot) -> DVec2 {
    DVec2::new(f64::from(slot.size & 0xffff) + 1.0, f64::from(slot.size >> 16) + 1.0)
}

/// Position in texels of texture coordinates.
pub fn texel_position(slot: &TextureSlot, uvs: [DVec2; 2]) -> DVec2 {
    let uv = uvs[(slot.info >> 16 & 1) as usize];
    let row = |row: [f32; 3]| f64::from(row[0]) * uv.x + f64::from(row[1]) * uv.y + f64::from(row[2]);
    DVec2::new(row(slot.row_u), row(slot.row_v)) * size(slot)
}

/// Value of a texture at a position in texels.
pub fn sample_texels(pages: &TexturePages, encoding: Encoding, slot: &TextureSlot, position: DVec2) -> DVec4 {
    let [width, height] = [slot.size & 0xffff, slot.size >> 16].map(|last| i64::from(last) + 1);
    let texel = |x: i64, y: i64| {
        let x = wrap(x, width, slot.info >> 17 & 3) + i64::from(slot.corner & 0xffff);
        let y = wrap(y, height, slot.info >> 19 & 3) + i64::from(slot.corner >> 16);
        let page = &pages.pages[(slot.info & 0xffff) as usize];
        let first = 4 * (y as usize * pages.page_size as usize + x as usize);
        decode(encoding, &page[first..first + 4])
    };
    let nearest = slot.info >> 21 & 1 == 1;
    if nearest {
        let cell = position.floor();
        return texel(cell.x as i64, cell.y as i64);
    }
    let cell = (position - 0.5).floor();
    let weight = position - 0.5 - cell;
    let (x, y) = (cell.x as i64, cell.y as i64);
    let top = texel(x, y).lerp(texel(x.saturating_add(1), y), weight.x);
    let bottom = texel(x, y.saturating_add(1)).lerp(texel(x.saturating_add(1), y.saturating_add(1)), weight.x);
    top.lerp(bottom, weight.y)
}

fn decode(encoding: Encoding, texel: &[u8]) -> DVec4 {
    let linear = |channel: usize| f64::from(texel[channel]) / 255.0;
    match encoding {
        Encoding::Linear => DVec4::new(linear(0), linear(1), linear(2), linear(3)),
        Encoding::Srgb => {
            let color = |channel: usize| FROM_SRGB[usize::from(texel[channel])];
            DVec4::new(color(0), color(1), color(2), linear(3))
        }
    }
}

/// Index of a texel after wrapping; mode 0 repeats, 1 clamps, 2 mirrors.
fn wrap(index: i64, size: i64, mode: u32) -> i64 {
    match mode {
        1 => index.clamp(0, size - 1),
        2 => {
            let within = index.rem_euclid(2 * size);
            within.min(2 * size - 1 - within)
        }
        _ => index.rem_euclid(size),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_follows_the_modes_of_gltf() {
        let wrapped = |mode| (-3..5).map(|i| wrap(i, 2, mode)).collect::<Vec<_>>();
        assert_eq!(wrapped(0), [1, 0, 1, 0, 1, 0, 1, 0]);
        assert_eq!(wrapped(1), [0, 0, 0, 0, 1, 1, 1, 1]);
        assert_eq!(wrapped(2), [1, 1, 0, 0, 1, 1, 0, 0]);
    }

    #[test]
    fn half_way_between_texels_lies_the_mean_of_linear_values() {
        let pages = TexturePages { page_size: 2, pages: vec![[[0u8; 4], [255; 4], [0; 4], [255; 4]].concat()] };
        let slot = TextureSlot { info: 1 << 17 | 1 << 19, size: 1 | 1 << 16, ..TextureSlot::default() };
        let at = |u: f64| sample(&pages, Encoding::Srgb, &slot, [DVec2::new(u, 0.5); 2]).x;
        assert_eq!([at(0.25), at(0.5), at(0.75), at(0.99)], [0.0, 0.5, 1.0, 1.0]);
    }
}
