//! Rays against spheres, in f64, without differences of like numbers.

use crate::compile::Triangle;
use glam::DVec3;

/// A sphere of the scene.
#[derive(Debug, Clone, Copy)]
pub struct Sphere {
    center: DVec3,
    radius: f64,
    /// Its place among the scene's triangles.
    pub id: u32,
}

/// Where a ray meets a sphere.
#[derive(Debug, Clone, Copy)]
pub struct SphereHit {
    /// Multiple of the direction.
    pub t: f64,
    /// Outward normal, by its place on an unfolded octahedron: see [`normal`].
    pub place: [f64; 2],
}

impl Sphere {
    /// The sphere that stands at this place among the triangles.
    pub fn new(triangles: &[Triangle], id: u32) -> Self {
        let record = &triangles[id as usize];
        Self { center: DVec3::from(record.v0.map(f64::from)), radius: f64::from(record.v1[0]), id }
    }

    /// The nearest hit at a positive t.
    ///
    /// The discriminant is that of the point of the ray that is nearest to the centre, and the roots come from that one of their
    /// sums that has no cancellation (Hearn and Baker; pbrt-v4 6.8.1).
    pub fn intersect(&self, origin: DVec3, direction: DVec3) -> Option<SphereHit> {
        let from_center = origin - self.center;
        let a = direction.length_squared();
        let b = -from_center.dot(direction);
        let nearest = (from_center + direction * (b / a)).length();
        let below = (self.radius - nearest) * (self.radius + nearest);
        if below < 0.0 {
            return None;
        }
        let q = b + (a * below).sqrt().copysign(b);
        let distance = from_center.length();
        let roots = [(distance - self.radius) * (distance + self.radius) / q, q / a];
        let (first, second) = (roots[0].min(roots[1]), roots[0].max(roots[1]));
        let t = if first > 0.0 { first } else { second };
        let normal = (from_center + direction * t).try_normalize()?;
        (t > 0.0).then(|| SphereHit { t, place: place(normal) })
    }
}

/// Place of a unit vector on an unfolded octahedron (Cigolle et al. 2014).
fn place(n: DVec3) -> [f64; 2] {
    let sum = n.x.abs() + n.y.abs() + n.z.abs();
    let (x, y) = (n.x / sum, n.y / sum);
    if n.z < 0.0 { [(1.0 - y.abs()) * 1f64.copysign(x), (1.0 - x.abs()) * 1f64.copysign(y)] } else { [x, y] }
}

/// The unit vector at a place.
pub fn normal([x, y]: [f64; 2]) -> DVec3 {
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    DVec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sphere(center: [f32; 3], radius: f32) -> Sphere {
        let record = Triangle { v0: center, v1: [radius, 1.0, 0.0], material: Triangle::SPHERE, ..Triangle::default() };
        Sphere::new(&[record], 0)
    }

    #[test]
    fn normals_come_back_from_their_places() {
        for i in 0..1000 {
            let f = f64::from(i);
            let n = DVec3::new((f * 0.7).sin(), (f * 1.3).cos(), (f * 2.1).sin()).normalize();
            assert!(normal(place(n)).distance(n) < 1e-15, "{n}");
        }
        for n in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z] {
            assert_eq!(normal(place(n)), n);
        }
    }

    #[test]
    fn roots_are_exact_afar_and_on_the_surface() {
        // Where the textbook's formula loses all digits: a unit sphere seen from a hundred million radii.
        let far = sphere([0.0, 0.0, -1e8], 1.0).intersect(DVec3::ZERO, DVec3::NEG_Z).unwrap();
        assert!((far.t - (1e8 - 1.0)).abs() < 1e-7, "{}", far.t);
        // And of a huge one just below.
        let near = sphere([0.0, -1e6, 0.0], 1e6).intersect(DVec3::new(0.0, 1e-6, 0.0), DVec3::NEG_Y).unwrap();
        assert!((near.t - 1e-6).abs() < 1e-9, "{}", near.t);
        let tiny = sphere([3.0, 0.0, 0.0], 1e-9).intersect(DVec3::ZERO, DVec3::X).unwrap();
        assert!((tiny.t - (3.0 - f64::from(1e-9f32))).abs() < 1e-15);
    }

    #[test]
    fn from_within_the_far_side_is_met_and_from_behind_none() {
        let unit = sphere([0.0; 3], 1.0);
        assert_eq!(unit.intersect(DVec3::ZERO, DVec3::X * 2.0).map(|hit| hit.t), Some(0.5));
        assert!(unit.intersect(DVec3::X * 2.0, DVec3::X).is_none());
        assert!(unit.intersect(DVec3::new(-2.0, 1.0 + 1e-12, 0.0), DVec3::X).is_none());
    }
}
