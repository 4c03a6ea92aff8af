//! Tables for sampling an [`Hdri`]: by its light, and how squarely that falls on a surface.
//!
//! The picture is cut into tiles. A surface's normal falls into one of the bins of a coarse grid (its *facing*), and for each facing
//! there is a table of the tiles by their light times the cosine at which it arrives; within a tile, cells follow their light
//! alone. So hardly a sample is lost below the horizon, and for matt surfaces what a sample brings depends on little but whether
//! it is blocked. (The idea of Clarberg et al. 2005, "Wavelet importance sampling", with tables in place of wavelets.)

use super::{EnvironmentCell, Hdri, Share};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Columns and rows of tiles.
pub const TILES: [usize; 2] = [32, 16];
/// Facings along a side of the octahedral square.
pub const FACINGS: usize = 16;
/// The facing of what light reaches from both sides: its tiles are chosen by their light alone.
pub const ANY_FACING: usize = FACINGS * FACINGS;
/// Entries of one facing's table: the rows of tiles, then the tiles of each row.
pub const FACING_STRIDE: usize = TILES[1] + TILES[0] * TILES[1];

/// Cosine that a tile counts with at least: some of it can be above a surface's horizon though its middle is not.
const LEAST_COSINE: f64 = 0.03;

/// Cells of a picture, parted into tiles.
pub(super) struct Tiling {
    /// Cells across.
    pub width: usize,
    /// Cells down.
    pub rows: usize,
}

impl Tiling {
    fn columns_of(&self, across: usize) -> Range<usize> {
        across * self.width / TILES[0]..(across + 1) * self.width / TILES[0]
    }

    fn rows_of(&self, down: usize) -> Range<usize> {
        down * self.rows / TILES[1]..(down + 1) * self.rows / TILES[1]
    }

    /// Distribution functions inside of the tiles: of [`Hdri::rows`], and the cells.
    pub fn within(&self, weights: &[f64], solid_angles: &[f64]) -> (Vec<f32>, Vec<EnvironmentCell>) {
        let sum = |j: usize, across: usize| weights[j * self.width..][self.columns_of(across)].iter().sum::<f64>();
        let mut rows = vec![0.0; TILES[0] * self.rows];
        rows.par_chunks_mut(self.rows).enumerate().for_each(|(across, function)| {
            for down in 0..TILES[1] {
                let sums: Vec<f64> = self.rows_of(down).map(|j| sum(j, across)).collect();
                function[self.rows_of(down)].copy_from_slice(&distribution(&sums));
            }
        });
        let mut cells = vec![EnvironmentCell::default(); weights.len()];
        cells.par_chunks_mut(self.width).enumerate().for_each(|(j, line)| {
            let rows_before = self.rows_of(tile_of(j, self.rows, TILES[1])).start;
            for across in 0..TILES[0] {
                let span = self.columns_of(across);
                let columns = distribution(&weights[j * self.width..][span.clone()]);
                let row = step(&rows[across * self.rows..][rows_before..self.rows], j - rows_before);
                for (i, cell) in line[span].iter_mut().enumerate() {
                    // Of the rounded functions, so that a sampler that divides by it is unbiased.
                    let pdf = step(&columns, i) * row / solid_angles[j];
                    *cell = EnvironmentCell { cumulative: columns[i], pdf: pdf as f32 };
                }
            }
        });
        (rows, cells)
    }

    /// Tables of all facings.
    pub fn facing_tables(&self, weights: &[f64]) -> Vec<Share> {
        let light = self.light_of_tiles(weights);
        let by_facing = (0..ANY_FACING).into_par_iter().flat_map_iter(|facing| {
            let normals = normals_of(facing);
            let cosine =
                |middle: DVec3| normals.iter().map(|n| n.dot(middle).max(0.0)).sum::<f64>() / normals.len() as f64;
            facing_table(&light.map(|(power, middle)| power * cosine(middle).max(LEAST_COSINE)))
        });
        let mut tables: Vec<Share> = by_facing.collect();
        tables.extend(facing_table(&light.map(|(power, _)| power)));
        tables
    }

    /// Per tile its light, and the mean direction that it comes from, shorter than 1.
    fn light_of_tiles(&self, weights: &[f64]) -> [(f64, DVec3); TILES[0] * TILES[1]] {
        let azimuths: Vec<(f64, f64)> =
            (0..self.width).map(|i| (TAU * ((i as f64 + 1.0) / self.width as f64 - 0.5)).sin_cos()).collect();
        let mut light = [(0.0, DVec3::ZERO); TILES[0] * TILES[1]];
        for (j, line) in weights.chunks_exact(self.width).enumerate() {
            let (sin, cos) = (PI * j as f64 / (self.rows - 1) as f64).sin_cos();
            for across in 0..TILES[0] {
                let (power, sum) = &mut light[tile_of(j, self.rows, TILES[1]) * TILES[0] + across];
                for i in self.columns_of(across) {
                    *power += line[i];
                    *sum += line[i] * DVec3::new(sin * azimuths[i].1, cos, sin * azimuths[i].0);
                }
            }
        }
        light.map(|(power, sum)| (power, if power > 0.0 { sum / power } else { DVec3::ZERO }))
    }
}

impl Hdri {
    /// Table of one facing.
    pub fn facing(&self, facing: usize) -> &[Share] {
        &self.tiles[facing * FACING_STRIDE..][..FACING_STRIDE]
    }
}

/// The tile that holds a cell: of so many cells and tiles, in one direction.
pub fn tile_of(cell: usize, cells: usize, tiles: usize) -> usize {
    ((cell + 1) * tiles - 1) / cells
}

/// Some normals of a facing: four places of its square on the octahedron, y up.
fn normals_of(facing: usize) -> [DVec3; 4] {
    [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)].map(|(u, v)| {
        let place = |k: usize, within: f64| 2.0 * (k as f64 + within) / FACINGS as f64 - 1.0;
        let (x, z) = (place(facing % FACINGS, u), place(facing / FACINGS, v));
        let y = 1.0 - x.abs() - z.abs();
        let fold = (-y).max(0.0);
        DVec3::new(x - fold.copysign(x), y, z - fold.copysign(z)).normalize()
    })
}

/// Distribution functions over rows of tiles and the tiles of each.
fn facing_table(weights: &[f64]) -> Vec<Share> {
    let sums: Vec<f64> = weights.chunks_exact(TILES[0]).map(|row| row.iter().sum()).collect();
    let rows = distribution(&sums);
    let share = |function: &[f32], index: usize, outer: f64| Share {
        cumulative: function[index],
        probability: (step(function, index) * outer) as f32,
    };
    let mut table: Vec<Share> = (0..TILES[1]).map(|row| share(&rows, row, 1.0)).collect();
    for (row, weights) in weights.chunks_exact(TILES[0]).enumerate() {
        let function = distribution(weights);
        table.extend((0..TILES[0]).map(|tile| share(&function, tile, step(&rows, row))));
    }
    table
}

/// Distribution function of weights, none of them negative; of equal ones if all are zero. Ends at 1.
fn distribution(weights: &[f64]) -> Vec<f32> {
    let total: f64 = weights.iter().sum();
    let share = |weight: &f64| if total > 0.0 { weight / total } else { 1.0 / weights.len() as f64 };
    let mut sum = 0.0;
    let mut function: Vec<f32> = weights
        .iter()
        .map(|weight| {
            sum += share(weight);
            sum.min(1.0) as f32
        })
        .collect();
    // What rounding leaves goes to the last that has a share.
    let last = weights.iter().rposition(|weight| *weight > 0.0).unwrap_or(weights.len().saturating_sub(1));
    function.iter_mut().skip(last).for_each(|value| *value = 1.0);
    function
}

/// Probability of one entry of a distribution function.
fn step(function: &[f32], index: usize) -> f64 {
    let before = index.checked_sub(1).map_or(0.0, |before| function[before]);
    f64::from(function[index]) - f64::from(before)
}
