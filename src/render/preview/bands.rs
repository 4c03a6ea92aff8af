//! How many rows to light at a time, so that another job, a cancel or a watchdog need not wait for a heavy picture.

use super::lights::PreviewLights;
use crate::params::{ShadowAlgorithm, ShadowParams};
use std::time::Duration;

/// What a band should take: a usual picture is one.
const TARGET: Duration = Duration::from_millis(100);
/// Lights and shadow tests of the first band, at most, before anything has been measured.
const FIRST: f64 = (1 << 24) as f64;

/// Look-ups of a map that cost what a ray does.
const RAY: u32 = 32;

/// Rows of the next band.
#[derive(Debug, Clone, Copy)]
pub struct Bands {
    rows: f64,
    height: f64,
}

impl Bands {
    /// From the most that each pixel could cost.
    pub fn new((width, height): (u32, u32), shadows: &ShadowParams, lights: &PreviewLights) -> Self {
        let tests = match shadows.algorithm {
            ShadowAlgorithm::None => 0,
            ShadowAlgorithm::Basic => 1,
            ShadowAlgorithm::Pcf | ShadowAlgorithm::Noise => shadows.taps,
            ShadowAlgorithm::Ray => RAY * shadows.taps,
            ShadowAlgorithm::Pcss | ShadowAlgorithm::PcssNoise => 2 * shadows.taps,
        };
        let casting = lights.lights.iter().filter(|light| light.face_count > 0).count();
        let per_pixel = 1.0 + lights.lights.len() as f64 + casting as f64 * f64::from(tests);
        let rows = FIRST / (per_pixel * f64::from(width));
        let height = f64::from(height);
        Self { rows: rows.clamp(1.0, height), height }
    }

    /// At least one.
    pub fn rows(self) -> u32 {
        self.rows as u32
    }

    /// From a band that took so long: towards the target time, at most four times more or less at once.
    pub fn learn(&mut self, rows: u32, elapsed: Duration) {
        let ideal = f64::from(rows) * TARGET.as_secs_f64() / elapsed.as_secs_f64().max(1e-6);
        // A picture in one band stays in one: what all bands share was part of its time.
        let least = if f64::from(rows) >= self.height && elapsed < 4 * TARGET { self.height } else { 1.0 };
        self.rows = ideal.clamp(self.rows / 4.0, self.rows * 4.0).clamp(least, self.height);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::preview::layout::PreviewLight;
    use bytemuck::Zeroable;

    /// Rays are slow: a picture of many begins with few rows.
    #[test]
    fn rays_begin_with_fewer_rows_than_taps() {
        let light = PreviewLight { face_count: 1, ..PreviewLight::zeroed() };
        let lights = PreviewLights { lights: vec![light], ..PreviewLights::default() };
        let rows = |algorithm| {
            let shadows = ShadowParams { algorithm, taps: 256, ..ShadowParams::default() };
            Bands::new((1024, 1024), &shadows, &lights).rows()
        };
        let [rays, taps] = [ShadowAlgorithm::Ray, ShadowAlgorithm::Pcf].map(rows);
        assert!(rays >= 1 && 16 * rays <= taps, "{rays}, {taps}");
    }

    #[test]
    fn bands_grow_and_shrink_towards_the_target() {
        let mut bands = Bands { rows: 10.0, height: 1000.0 };
        bands.learn(10, TARGET / 2);
        assert_eq!(bands.rows(), 20);
        bands.learn(20, TARGET / 100);
        assert_eq!(bands.rows(), 80);
        bands.learn(80, 1000 * TARGET);
        assert_eq!(bands.rows(), 20);
        let mut tiny = Bands { rows: 1.0, height: 1000.0 };
        tiny.learn(1, 100 * TARGET);
        assert_eq!(tiny.rows(), 1);
        let mut whole = Bands { rows: 1000.0, height: 1000.0 };
        whole.learn(1000, 3 * TARGET);
        assert_eq!(whole.rows(), 1000);
    }
}
