//! Light from infinity.

use crate::compile::{Environment, EnvironmentKind, FACINGS, Hdri, TILES, tile_of};
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// A direction, and the density of having drawn it (1/sr).
#[derive(Debug, Clone, Copy)]
pub struct DirectionSample {
    /// Towards the light.
    pub direction: DVec3,
    /// Over solid angle.
    pub pdf: f64,
}

/// Radiance from a direction, ambient light left out.
pub fn radiance(environment: &Environment, direction: DVec3) -> DVec3 {
    let shown = match &environment.kind {
        EnvironmentKind::None => DVec3::ZERO,
        EnvironmentKind::Constant(radiance) => radiance.as_dvec3(),
        EnvironmentKind::Gradient { top, horizon, bottom } => {
            let end = if direction.y > 0.0 { top } else { bottom };
            horizon.as_dvec3().lerp(end.as_dvec3(), direction.y.abs())
        }
        EnvironmentKind::Hdri(hdri) => bilinear(hdri, coordinates(turned(direction, -environment.rotation))),
    };
    shown * f64::from(environment.intensity)
}

/// The facing of a surface with a normal, whose tables tell which tiles of a picture light it: see [`TILES`].
pub fn facing(rotation: f32, normal: DVec3) -> usize {
    let n = turned(normal, -rotation);
    let [x, z] = [n.x, n.z].map(|axis| axis / (n.x.abs() + n.y.abs() + n.z.abs()));
    // The lower half of the octahedron is folded outwards.
    let fold = (x.abs() + z.abs() - 1.0).abs() * f64::from(u8::from(n.y < 0.0));
    let bin = |axis: f64| {
        let place = (axis + fold.copysign(axis)) * 0.5 + 0.5;
        ((place * FACINGS as f64) as usize).min(FACINGS - 1)
    };
    bin(z) * FACINGS + bin(x)
}

/// Draws a direction of a picture for a surface of some facing: a tile, a cell in it, a place in that.
pub fn sample(hdri: &Hdri, rotation: f32, facing: usize, u: [f64; 2]) -> DirectionSample {
    let [width, rows] = [hdri.width as usize, hdri.height as usize + 1];
    let (bands, tiles) = hdri.facing(facing).split_at(TILES[1]);
    let (band, down) = invert(bands, |share| share.cumulative, u[1]);
    let tiles = &tiles[band * TILES[0]..][..TILES[0]];
    let (tile, across) = invert(tiles, |share| share.cumulative, u[0]);
    let first = band * rows / TILES[1];
    let (row, down) = invert(&hdri.rows[tile * rows..][first..(band + 1) * rows / TILES[1]], |x| *x, down);
    let row = first + row;
    let first = tile * width / TILES[0];
    let cells = &hdri.cells[row * width..][first..(tile + 1) * width / TILES[0]];
    let (cell, across) = invert(cells, |cell| cell.cumulative, across);
    let column = first + cell;
    let phi = TAU * ((column as f64 + 0.5 + across) / width as f64 - 0.5);
    let [top, bottom] = row_angles(hdri, row);
    // Uniform in solid angle: in the cosine. Its difference from 1 (or -1) is what keeps its digits at a pole.
    let (rise, pole) = if bottom <= PI / 2.0 { (versine(top), 1.0) } else { (versine(PI - top), -1.0) };
    let fall = if pole > 0.0 { versine(bottom) } else { versine(PI - bottom) };
    let depth = rise + (fall - rise) * down;
    let radius = (depth * (2.0 - depth)).max(0.0).sqrt();
    let direction = DVec3::new(radius * phi.cos(), pole * (1.0 - depth), radius * phi.sin());
    DirectionSample {
        direction: turned(direction, rotation),
        pdf: f64::from(tiles[tile].probability) * f64::from(cells[cell].pdf),
    }
}

/// Density of [`sample`] at a direction.
pub fn pdf(hdri: &Hdri, rotation: f32, facing: usize, direction: DVec3) -> f64 {
    let uv = coordinates(turned(direction, -rotation));
    let (width, height) = (i64::from(hdri.width), i64::from(hdri.height));
    let column = ((uv.x * width as f64 - 0.5).floor() as i64).rem_euclid(width);
    let row = ((uv.y * height as f64 + 0.5).floor() as i64).clamp(0, height);
    let tile = tile_of(row as usize, height as usize + 1, TILES[1]) * TILES[0]
        + tile_of(column as usize, width as usize, TILES[0]);
    let share = hdri.facing(facing)[TILES[1] + tile].probability;
    f64::from(share) * f64::from(hdri.cells[(row * width + column) as usize].pdf)
}

/// Angles from the pole at which a row of cells begins and ends: see [`Hdri::cells`].
fn row_angles(hdri: &Hdri, row: usize) -> [f64; 2] {
    let height = f64::from(hdri.height);
    [row as f64 - 0.5, row as f64 + 0.5].map(|v| PI * v.clamp(0.0, height) / height)
}

/// Entry of a distribution function that `u` falls into, and how far into it, from 0 to less than 1.
fn invert<T>(entries: &[T], cumulative: impl Fn(&T) -> f32, u: f64) -> (usize, f64) {
    let cumulative = |entry: &T| f64::from(cumulative(entry));
    let index = entries.partition_point(|entry| cumulative(entry) <= u).min(entries.len() - 1);
    let before = index.checked_sub(1).map_or(0.0, |before| cumulative(&entries[before]));
    let within = (u - before) / (cumulative(&entries[index]) - before);
    (index, within.clamp(0.0, 1.0 - f64::EPSILON))
}

/// Turned about +y by an angle in radians, from +z towards +x.
fn turned(direction: DVec3, angle: f32) -> DVec3 {
    let (sin, cos) = f64::from(angle).sin_cos();
    DVec3::new(cos * direction.x + sin * direction.z, direction.y, cos * direction.z - sin * direction.x)
}

/// u = 0.5 + atan2(z, x) / 2 pi; v from the top, by the angle from the pole.
fn coordinates(direction: DVec3) -> DVec2 {
    let angle = direction.x.hypot(direction.z).atan2(direction.y);
    DVec2::new(0.5 + direction.z.atan2(direction.x) / TAU, angle / PI)
}

/// Between texel centres; u repeats, v ends at the poles.
fn bilinear(hdri: &Hdri, uv: DVec2) -> DVec3 {
    let (width, height) = (i64::from(hdri.width), i64::from(hdri.height));
    let place = uv * DVec2::new(width as f64, height as f64) - 0.5;
    let cell = place.floor();
    let texel = |x: i64, y: i64| {
        let index = y.clamp(0, height - 1) * width + x.rem_euclid(width);
        DVec3::from(hdri.texels[index as usize].map(f64::from))
    };
    let (x, y, weight) = (cell.x as i64, cell.y as i64, place - cell);
    let top = texel(x, y).lerp(texel(x + 1, y), weight.x);
    top.lerp(texel(x, y + 1).lerp(texel(x + 1, y + 1), weight.x), weight.y)
}

/// 1 - cos, without cancellation.
fn versine(angle: f64) -> f64 {
    2.0 * (0.5 * angle).sin().powi(2)
}
