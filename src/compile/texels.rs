//! Reading textures on the CPU, as kernels read them, and bounding what a triangle can read.

use super::{NONE, TexturePages, TextureSlot};
use glam::{DVec2, Vec2};

/// A texture in its page.
#[derive(Clone, Copy)]
pub struct Texels<'a> {
    page: &'a [u8],
    page_size: usize,
    corner: [usize; 2],
    size: [usize; 2],
    slot: &'a TextureSlot,
}

impl<'a> Texels<'a> {
    /// The texture of a slot; none if the slot is empty.
    pub fn new(pages: &'a TexturePages, slot: &'a TextureSlot) -> Option<Self> {
        if slot.info == NONE {
            return None;
        }
        let halves = |word: u32| [(word & 0xffff) as usize, (word >> 16) as usize];
        let page = pages.pages.get((slot.info & 0xffff) as usize)?;
        let size = halves(slot.size).map(|side| side + 1);
        Some(Self { page, page_size: pages.page_size as usize, corner: halves(slot.corner), size, slot })
    }

    /// Which uv set it reads.
    pub fn uv_set(&self) -> usize {
        (self.slot.info >> 16 & 1) as usize
    }

    /// All texels.
    pub fn iter(&self) -> impl Iterator<Item = [u8; 4]> {
        (0..self.size[1]).flat_map(move |y| (0..self.size[0]).map(move |x| self.at(x, y)))
    }

    fn at(&self, x: usize, y: usize) -> [u8; 4] {
        let start = ((self.corner[1] + y) * self.page_size + self.corner[0] + x) * 4;
        self.page.get(start..start + 4).and_then(|texel| texel.try_into().ok()).unwrap_or_default()
    }

    /// Position in texels (corners at whole numbers) of a texture coordinate, before wrapping.
    fn position(&self, uv: Vec2) -> DVec2 {
        let uv1 = uv.as_dvec2().extend(1.0);
        let row = |row: [f32; 3]| glam::Vec3::from_array(row).as_dvec3().dot(uv1);
        DVec2::new(row(self.slot.row_u), row(self.slot.row_v)) * DVec2::new(self.size[0] as f64, self.size[1] as f64)
    }

    /// The texel under a texture coordinate.
    pub fn nearest(&self, uv: Vec2) -> [u8; 4] {
        let position = self.position(uv);
        let pick = |axis: usize| wrap(position[axis].floor(), self.size[axis], self.wrap_code(axis));
        self.at(pick(0), pick(1))
    }

    fn wrap_code(&self, axis: usize) -> u32 {
        self.slot.info >> (17 + 2 * axis) & 3
    }

    /// Ranges of texels along an axis that filtering can read between two positions.
    fn ranges(&self, axis: usize, low: f64, high: f64) -> Vec<[usize; 2]> {
        let size = self.size[axis];
        let slack = 1e-2 + 1e-6 * low.abs().max(high.abs());
        let (low, high) = ((low - 0.5 - slack).floor(), (high - 0.5 + slack).floor() + 1.0);
        let all = [0, size - 1];
        let span = high - low;
        if span.is_nan() || span >= size as f64 {
            return vec![all];
        }
        let code = self.wrap_code(axis);
        let (first, last) = (wrap(low, size, code), wrap(high, size, code));
        match code {
            0 if first > last => vec![[first, size - 1], [0, last]],
            2 => vec![all],
            _ => vec![[first, last]],
        }
    }
}

/// The texel that a whole number stands for under a wrap mode (0 repeat, 1 clamp, 2 mirror).
fn wrap(texel: f64, size: usize, code: u32) -> usize {
    if !texel.is_finite() {
        return 0;
    }
    let size = size as f64;
    let wrapped = match code {
        0 => texel.rem_euclid(size),
        1 => texel,
        _ => {
            let period = texel.rem_euclid(2.0 * size);
            if period < size { period } else { 2.0 * size - 1.0 - period }
        }
    };
    wrapped.clamp(0.0, size - 1.0) as usize
}

/// Counts texels with some property in any rectangle (summed-area table: Crow 1984).
pub struct TexelCounts<'a> {
    texels: Texels<'a>,
    sums: Vec<u32>,
}

impl<'a> TexelCounts<'a> {
    /// Counts the texels that satisfy the predicate.
    pub fn new(texels: Texels<'a>, counts: impl Fn([u8; 4]) -> bool) -> Self {
        let stride = texels.size[0] + 1;
        let mut sums = vec![0; stride * (texels.size[1] + 1)];
        for y in 0..texels.size[1] {
            let mut row = 0;
            for x in 0..texels.size[0] {
                row += u32::from(counts(texels.at(x, y)));
                sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
            }
        }
        Self { texels, sums }
    }

    /// Whether no texel has the property.
    pub fn none(&self) -> bool {
        self.sums.last() == Some(&0)
    }

    /// Texels with the property, and texels in all, in the box around a triangle in texture space: everything that
    /// filtering can read inside of the triangle, and more.
    pub fn around(&self, uvs: [Vec2; 3]) -> (u64, u64) {
        let corners = uvs.map(|uv| self.texels.position(uv));
        let (low, high) = (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
        let mut found = (0, 0);
        for x in self.texels.ranges(0, low.x, high.x) {
            for y in self.texels.ranges(1, low.y, high.y) {
                found.0 += u64::from(self.rectangle(x, y));
                found.1 += ((x[1] - x[0] + 1) * (y[1] - y[0] + 1)) as u64;
            }
        }
        found
    }

    fn rectangle(&self, x: [usize; 2], y: [usize; 2]) -> u32 {
        let sum = |x: usize, y: usize| self.sums[y * (self.texels.size[0] + 1) + x];
        sum(x[1] + 1, y[1] + 1) + sum(x[0], y[0]) - sum(x[0], y[1] + 1) - sum(x[1] + 1, y[0])
    }
}
