//! Maps from the unit square that keep areas.

use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Unit disk, by concentric squares (Shirley and Chiu 1997).
pub fn concentric_disk(u: [f64; 2]) -> DVec2 {
    let (x, y) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    if x == 0.0 && y == 0.0 {
        return DVec2::ZERO;
    }
    let (radius, phi) = if x.abs() > y.abs() { (x, FRAC_PI_4 * (y / x)) } else { (y, FRAC_PI_2 - FRAC_PI_4 * (x / y)) };
    radius * DVec2::from_angle(phi)
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
    1.0 / (1.0 + (other / taken).powi(2))
}
