//! Host memory that renders may hold together.

use crate::film::{TILE_PIXELS, Tiles};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes per lane of the film: four replicates of four f64.
const BYTES_PER_LANE: u64 = 128;

/// Bytes per pixel of the ending of a render: the picture (four f32), its standard error (three) and a file of 16 bits per
/// channel.
const BYTES_PER_PIXEL: u64 = 16 + 12 + 8;

/// Bytes per pixel of denoising: guides (twice three f32), the picture before and the one on its way to the process and back.
pub const DENOISE_BYTES_PER_PIXEL: u64 = 24 + 28 + 24;

/// Bytes per lane and per pixel of a light group: sums of three f64, and the picture of it (three f32), twice when it is encoded.
const BYTES_PER_GROUP: [u64; 2] = [24, 24];

/// Memory of a render of so many pixels and light groups, without its scene.
pub fn film_bytes(width: u32, height: u32, groups: usize) -> u64 {
    let lanes = u64::from(Tiles::new(width, height).count()) * TILE_PIXELS as u64;
    let [per_lane, per_pixel] = BYTES_PER_GROUP.map(|bytes| bytes * groups as u64);
    lanes * (BYTES_PER_LANE + per_lane) + u64::from(width) * u64::from(height) * (BYTES_PER_PIXEL + per_pixel)
}

/// A bounded amount of memory.
#[derive(Debug, Clone)]
pub struct Budget {
    limit: u64,
    used: Arc<AtomicU64>,
}

/// A part of a [`Budget`], given back when dropped.
#[derive(Debug)]
pub struct Claim {
    bytes: u64,
    used: Arc<AtomicU64>,
}

impl Budget {
    /// `limit` bytes, all free.
    pub fn new(limit: u64) -> Self {
        Self { limit, used: Arc::default() }
    }

    /// Bytes that are taken.
    pub fn used(&self) -> u64 {
        self.used.load(Ordering::Acquire)
    }

    /// Takes a part if there is room. What alone is over the limit has to wait until nothing else is held.
    pub fn claim(&self, bytes: u64) -> Option<Claim> {
        let fits =
            |used: u64| (used == 0 || used.saturating_add(bytes) <= self.limit).then_some(used.saturating_add(bytes));
        self.used.fetch_update(Ordering::AcqRel, Ordering::Acquire, fits).ok()?;
        Some(Claim { bytes, used: Arc::clone(&self.used) })
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        self.used.fetch_sub(self.bytes, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_are_bounded_and_given_back() {
        let budget = Budget::new(10);
        let first = budget.claim(6);
        assert!(first.is_some());
        assert!(budget.claim(6).is_none());
        drop(first);
        assert!(budget.claim(60).is_some());
    }
}
