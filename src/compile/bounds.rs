//! Box arithmetic.

use super::Bounds;
use glam::{DVec3, Vec3};

impl Bounds {
    /// The smallest box around both.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The smallest box around both.
    pub fn with(self, point: Vec3) -> Self {
        Self { min: self.min.min(point), max: self.max.max(point) }
    }

    /// Whether nothing is in it.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// Size along each axis; zero if empty.
    pub fn extent(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { self.max.as_dvec3() - self.min.as_dvec3() }
    }

    /// Centre; the origin if empty.
    pub fn centre(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { (self.min.as_dvec3() + self.max.as_dvec3()) * 0.5 }
    }

    /// Radius of the sphere around it.
    pub fn radius(&self) -> f64 {
        self.extent().length() * 0.5
    }

    /// Distance from a point to the nearest of the box; infinite if empty.
    pub fn distance(&self, point: DVec3) -> f64 {
        if self.is_empty() {
            return f64::INFINITY;
        }
        point.distance(point.clamp(self.min.as_dvec3(), self.max.as_dvec3()))
    }

    /// The eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        let (min, max) = (self.min.as_dvec3(), self.max.as_dvec3());
        std::array::from_fn(|i| {
            let pick = |bit: usize, low: f64, high: f64| if i & bit == 0 { low } else { high };
            DVec3::new(pick(1, min.x, max.x), pick(2, min.y, max.y), pick(4, min.z, max.z))
        })
    }

    /// The smallest f32 box around an f64 box.
    pub fn outwards(min: DVec3, max: DVec3) -> Self {
        let down = |v: f64| if f64::from(v as f32) > v { (v as f32).next_down() } else { v as f32 };
        let up = |v: f64| if f64::from(v as f32) < v { (v as f32).next_up() } else { v as f32 };
        Self { min: Vec3::from_array(min.to_array().map(down)), max: Vec3::from_array(max.to_array().map(up)) }
    }
}
