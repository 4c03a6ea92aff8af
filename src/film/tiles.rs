//! How a picture is cut into the pieces that samples are counted by.

use super::TileSamples;
use serde::{Deserialize, Serialize};

/// Pixels of a tile, one per lane of a workgroup.
pub const TILE_PIXELS: usize = 64;

/// Side in pixels of a lane square: a tile has 8 x 8 lanes, as the workgroups of `shaders/pathtrace/pathtrace.wesl`.
const SIDE: u32 = 8;

/// A picture cut into tiles: the squares of one colour in each 16 x 8 pixels of a chessboard.
///
/// Tile `2 n` has the pixels of region `n` whose `x + y` is even, tile `2 n + 1` the odd ones; regions go row by row from
/// the top. Both colours see the same part of the picture with random numbers of their own: what one has found
/// may decide how many samples the other gets, and biases neither (docs/accuracy.md).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tiles {
    width: u32,
    height: u32,
}

impl Tiles {
    /// The tiles of a picture of so many pixels.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Picture width in pixels.
    pub fn width(self) -> u32 {
        self.width
    }

    /// Picture height in pixels.
    pub fn height(self) -> u32 {
        self.height
    }

    /// Regions in a row of the picture; each is two tiles.
    pub fn regions_across(self) -> u32 {
        self.width.div_ceil(2 * SIDE)
    }

    /// Rows of regions.
    pub fn regions_down(self) -> u32 {
        self.height.div_ceil(SIDE)
    }

    /// Number of tiles, those without a pixel included (a picture one pixel wide may have some).
    pub fn count(self) -> u32 {
        2 * self.regions_across() * self.regions_down()
    }

    /// Pixel (x, y) of a lane (0 to 63) of a tile; none: it lies outside of the picture.
    pub fn pixel(self, tile: u32, lane: u32) -> Option<(u32, u32)> {
        let (region, color) = (tile / 2, tile % 2);
        let (column, row) = (lane % SIDE, lane / SIDE);
        let x = region % self.regions_across() * 2 * SIDE + 2 * column + (row + color) % 2;
        let y = region / self.regions_across() * SIDE + row;
        (x < self.width && y < self.height).then_some((x, y))
    }

    /// Tile and lane of a pixel.
    pub fn place(self, x: u32, y: u32) -> (u32, u32) {
        let region = y / SIDE * self.regions_across() + x / (2 * SIDE);
        (2 * region + (x + y) % 2, y % SIDE * SIDE + x % (2 * SIDE) / 2)
    }

    /// Number of pixels of a tile: 64, or fewer at the right and lower edge.
    pub fn pixels(self, tile: u32) -> u32 {
        let (region, color) = (tile / 2, tile % 2);
        let width = (self.width - region % self.regions_across() * 2 * SIDE).min(2 * SIDE);
        let height = (self.height - region / self.regions_across() * SIDE).min(SIDE);
        (width * height + 1 - color) / 2
    }

    /// What [`Film::add`](super::Film::add) takes for `work`: one sum per lane, from `sum` of each entry and pixel.
    pub fn lanes(
        self,
        work: &[TileSamples],
        mut sum: impl FnMut(&TileSamples, (u32, u32)) -> [f32; 4],
    ) -> Vec<[f32; 4]> {
        let lanes = work.iter().flat_map(|entry| (0..TILE_PIXELS as u32).map(move |lane| (entry, lane)));
        lanes.map(|(entry, lane)| self.pixel(entry.tile, lane).map_or([0.0; 4], |pixel| sum(entry, pixel))).collect()
    }

    /// All tiles that have pixels, neighbours far apart: work in this order is spread evenly over the picture.
    pub fn spread(self) -> impl Iterator<Item = u32> {
        let count = u64::from(self.count());
        // About the golden section.
        let step = (((count as f64 * 0.618) as u64).max(1)..).find(|&step| coprime(step, count)).unwrap_or(1);
        (0..count).map(move |index| (index * step % count) as u32).filter(move |&tile| self.pixels(tile) > 0)
    }
}

fn coprime(mut a: u64, mut b: u64) -> bool {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_pixel_has_one_place() {
        for (width, height) in [(1, 1), (1, 9), (16, 8), (17, 3), (37, 21), (64, 64)] {
            let tiles = Tiles::new(width, height);
            let mut seen = vec![0; (width * height) as usize];
            for tile in 0..tiles.count() {
                let pixels: Vec<_> = (0..TILE_PIXELS as u32).filter_map(|lane| tiles.pixel(tile, lane)).collect();
                assert_eq!(pixels.len() as u32, tiles.pixels(tile), "tile {tile} of {width} x {height}");
                for (x, y) in pixels {
                    seen[(y * width + x) as usize] += 1;
                    let (found, lane) = tiles.place(x, y);
                    assert_eq!((found, tiles.pixel(found, lane)), (tile, Some((x, y))));
                }
            }
            assert!(seen.iter().all(|&times| times == 1), "{width} x {height}");
        }
    }

    #[test]
    fn spread_visits_each_tile_once() {
        for (width, height) in [(1, 1), (8, 8), (1200, 500), (640, 8), (8, 640), (4096, 2160)] {
            let tiles = Tiles::new(width, height);
            let mut order: Vec<u32> = tiles.spread().collect();
            let near = order.windows(2).filter(|pair| pair[0].abs_diff(pair[1]) < 4).count();
            assert!(order.len() < 16 || near == 0, "{near} neighbours follow each other");
            order.sort_unstable();
            let expected: Vec<u32> = (0..tiles.count()).filter(|&tile| tiles.pixels(tile) > 0).collect();
            assert_eq!(order, expected);
        }
    }
}
