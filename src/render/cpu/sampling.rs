//! Maps from the unit square that keep areas.

use glam::{DVec2, DVec3, Vec2Swizzles};
use std::f64::consts::FRAC_PI_4;

/// Unit disk, by concentric squares (Shirley and Chiu 1997).
pub fn concentric_disk(u: [f64; 2]) -> DVec2 {
    let (x, y) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    if x == 0.0 && y == 0.0 {
        return DVec2::ZERO;
    }
    // The angle from the nearer axis, at most an eighth of a turn.
    if x.abs() > y.abs() {
        x * within_an_eighth(FRAC_PI_4 * (y / x))
    } else {
        y * within_an_eighth(FRAC_PI_4 * (x / y)).yx()
    }
}

/// Cosine and sine of an angle of at most pi/4 either way, to the last digit but one: Taylor's series, whose next term is
/// below 1e-17. What reduces an angle to this range takes most of the time of a library's functions.
fn within_an_eighth(angle: f64) -> DVec2 {
    /// 1 / n!.
    const INVERSE_FACTORIALS: [f64; 18] = {
        let (mut values, mut factorial, mut n) = ([1.0; 18], 1.0, 1);
        while n < 18 {
            factorial *= n as f64;
            values[n] = 1.0 / factorial;
            n += 1;
        }
        values
    };
    let x2 = angle * angle;
    let series = |first: usize| (0..9).rev().fold(0.0, |sum, i| INVERSE_FACTORIALS[2 * i + first] - x2 * sum);
    DVec2::new(series(0), angle * series(1))
}

/// Hemisphere around +z, density cos / pi (Malley's method).
pub fn cosine_hemisphere(u: [f64; 2]) -> DVec3 {
    let disk = concentric_disk(u);
    disk.extend((1.0 - disk.length_squared()).max(0.0).sqrt())
}

/// Weights of the three corners of a triangle at a uniform place in it (Turk 1990, "Generating Random Points in
/// Triangles").
pub fn uniform_triangle(u: [f64; 2]) -> DVec3 {
    let root = u[0].sqrt();
    DVec3::new(1.0 - root, root * (1.0 - u[1]), root * u[1])
}

/// Power heuristic (Veach 1997, 9.2.4): weight of a sample of density `taken`, which another strategy would have found with
/// density `other`.
pub fn power_heuristic(taken: f64, other: f64) -> f64 {
    taken * taken / (taken * taken + other * other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_are_cosine_and_sine() {
        for i in -1000..=1000 {
            let angle = FRAC_PI_4 * f64::from(i) / 1000.0;
            let (found, expected) = (within_an_eighth(angle), DVec2::from_angle(angle));
            assert!((found - expected).abs().max_element() < 3e-16, "{angle}: {found} is not {expected}");
        }
    }
}
