//! Measured distributions of luminaires: luminous intensity by direction (IES LM-63, "photometric web").

use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// How far beyond the last angle of a table, in radians, is still at it: what rounding may do.
const EDGE: f64 = 1e-5;

/// Luminous intensity around a luminaire, bilinear in the two angles of its [`Web`]. A direction beyond the angles that were
/// measured gets no light.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Profile {
    /// What the angles mean.
    pub web: Web,
    /// Angles from the web's pole, ascending, 0 to pi; at least two.
    #[serde(with = "crate::pod")]
    pub polar: Vec<f32>,
    /// Angles around the pole, ascending, at least two; they span a whole turn at the most.
    #[serde(with = "crate::pod")]
    pub azimuth: Vec<f32>,
    /// Candela, `polar.len()` for each of `azimuth`.
    #[serde(with = "crate::pod")]
    pub candela: Vec<f32>,
    /// The largest of them.
    pub peak: f32,
}

/// Types of photometry, by the axes of a luminaire that their angles are measured from. In terms of its beam b, the direction z of
/// its zero azimuth at right angles to it, and `s = z x b`: where glTF's lights shine along -Z, z is +X and s is +Y.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u32)]
pub enum Web {
    /// Type C: polar from b, azimuth from z towards s.
    #[default]
    Beam = 0,
    /// Type B: the pole is s; the horizontal angle counts away from it (so the polar angle is 90 degrees and it), the vertical one
    /// turns from b towards z.
    Side = 1,
    /// Type A: the pole is z, from which the vertical angle counts down; the horizontal one turns from b towards -s.
    Top = 2,
}

impl Profile {
    /// The size of the table: angles around the pole, and from it.
    pub fn size(&self) -> (u32, u32) {
        (self.azimuth.len() as u32, self.polar.len() as u32)
    }

    /// Memory that it takes.
    pub fn bytes(&self) -> usize {
        4 * (self.polar.len() + self.azimuth.len() + self.candela.len())
    }

    /// Candela towards a direction from a luminaire that shines along `beam`, its zero azimuth along `zero`: unit vectors, the last two
    /// at right angles.
    pub fn candela(&self, beam: DVec3, zero: DVec3, direction: DVec3) -> f64 {
        let (along, ahead, aside) = (direction.dot(beam), direction.dot(zero), direction.dot(zero.cross(beam)));
        let (pole, x, y) = match self.web {
            Web::Beam => (along, ahead, aside),
            Web::Side => (aside, along, ahead),
            Web::Top => (ahead, along, -aside),
        };
        let first = self.azimuth.first().map_or(0.0, |angle| f64::from(*angle));
        let around = y.atan2(x);
        let around = if around < first { around + TAU } else { around };
        let (Some((row, down)), Some((column, across))) =
            (place(&self.polar, x.hypot(y).atan2(pole)), place(&self.azimuth, around))
        else {
            return 0.0;
        };
        let at = |column: usize, row: usize| {
            self.candela.get(column * self.polar.len() + row).map_or(0.0, |candela| f64::from(*candela))
        };
        let of = |column: usize| at(column, row) * (1.0 - down) + at(column, row + 1) * down;
        of(column) * (1.0 - across) + of(column + 1) * across
    }

    /// Its luminous flux: the integral over the sphere, by the middle of each cell.
    pub fn flux(&self) -> f64 {
        let sum = |column: &[f32]| -> f64 {
            let rings = self.polar.windows(2).zip(column.windows(2));
            rings
                .map(|(angles, candela)| {
                    let [from, to] = [angles[0], angles[1]].map(f64::from);
                    0.5 * f64::from(candela[0] + candela[1]) * (from.cos() - to.cos())
                })
                .sum()
        };
        let columns: Vec<f64> = self.candela.chunks(self.polar.len().max(1)).map(sum).collect();
        let wedges = self.azimuth.windows(2).zip(columns.windows(2));
        wedges.map(|(angles, sums)| 0.5 * (sums[0] + sums[1]) * f64::from(angles[1] - angles[0])).sum()
    }
}

/// The interval of ascending angles that holds one, and how much of it lies behind; none: it is beyond them.
fn place(angles: &[f32], angle: f64) -> Option<(usize, f64)> {
    let last = angles.len().checked_sub(2)?;
    let outside = angle < f64::from(angles[0]) - EDGE || angle > f64::from(angles[last + 1]) + EDGE;
    if outside {
        return None;
    }
    let index = angles.partition_point(|&known| f64::from(known) <= angle).saturating_sub(1).min(last);
    let [from, to] = [angles[index], angles[index + 1]].map(f64::from);
    Some((index, ((angle - from) / (to - from)).clamp(0.0, 1.0)))
}
