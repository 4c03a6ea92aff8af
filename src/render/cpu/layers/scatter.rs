//! Light scattered inside filled bodies: free flights through a homogeneous medium and Henyey and Greenstein's phase function
//! (pbrt-v4, 11 and 14; KHR_materials_volume_scatter).

use crate::compile::Extended;
use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// What is left of the light after a way through a medium, and where it was scattered; none: it got to the end.
#[derive(Debug, Clone, Copy)]
pub struct Flight {
    /// Length of the way, if it ended early.
    pub scattered_at: Option<f64>,
    /// Factor on the throughput.
    pub weight: DVec3,
}

/// A way of at most `longest`. One colour decides its length, each with the probability of its part of `throughput`; the density
/// is that of all colours together, so that no weight exceeds the sum of the throughput over its part.
pub fn fly(medium: &Extended, throughput: DVec3, longest: f64, [choice, u]: [f64; 2]) -> Flight {
    let extinction = DVec3::from(medium.absorption.map(f64::from));
    let probabilities = throughput / throughput.element_sum();
    let colour = (0..2).find(|&i| choice < probabilities.to_array()[..=i].iter().sum()).unwrap_or(2);
    // Optical depth of the collision; without extinction there is none.
    let depth = -u.ln();
    let left = |way: f64| (extinction * -way).exp();
    if depth >= extinction[colour] * longest {
        let transmittance = left(longest);
        return Flight { scattered_at: None, weight: transmittance / probabilities.dot(transmittance) };
    }
    let way = depth / extinction[colour];
    let density = extinction * left(way);
    let albedo = DVec3::from(medium.scatter.map(f64::from));
    Flight { scattered_at: Some(way), weight: albedo * density / probabilities.dot(density) }
}

/// The phase function per steradian, at a cosine from the direction of flight.
pub fn phase(g: f64, cosine: f64) -> f64 {
    let square = (1.0 - g).powi(2) + 2.0 * g * (1.0 - cosine);
    (1.0 - g * g) / (4.0 * PI * square.powf(1.5))
}

/// A direction drawn from it.
pub fn sample_phase(g: f64, direction: DVec3, [u, turn]: [f64; 2]) -> DVec3 {
    let cosine = if g == 0.0 {
        2.0 * u - 1.0
    } else {
        // Inverse of the distribution function of the cosine.
        let ratio = (1.0 - g * g) / (1.0 + g * (2.0 * u - 1.0));
        let cosine = (1.0 + g * g - ratio * ratio) / (2.0 * g);
        if g.abs() < 1e-6 { 2.0 * u - 1.0 } else { cosine.clamp(-1.0, 1.0) }
    };
    let (sin, cos) = (TAU * turn).sin_cos();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (x, y) = direction.any_orthonormal_pair();
    (DMat3::from_cols(x, y, direction) * DVec3::new(sine * cos, sine * sin, cosine)).normalize()
}
