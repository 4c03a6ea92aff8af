//! Lights with an extent: the sun's disk, balls, disks and rectangles. Rays meet them and go on behind them: they emit, and block
//! nothing. [`PunctualLight`] says what their records hold.

use super::sampling::concentric_disk;
use crate::compile::{PunctualKind, PunctualLight};
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Solid angle of a rectangle from which on it is sampled by solid angle rather than area; as the rectangle shrinks, the
/// two become the same, and the first loses its digits.
const WIDE: f64 = 1e-4;

/// What a sample has found.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// Of unit length.
    pub direction: DVec3,
    /// To the light; infinite for a sun.
    pub distance: f64,
    /// Over solid angle.
    pub pdf: f64,
}

/// A light of one of the kinds.
#[derive(Debug, Clone, Copy)]
pub enum Shape {
    /// A disk at infinity.
    Sun {
        /// Its middle.
        towards: DVec3,
        /// 1 - cos of its half angle.
        versine: f64,
    },
    /// Shines outwards.
    Sphere {
        /// Its middle.
        center: DVec3,
        /// Its size.
        radius: f64,
    },
    /// Shines along the normal.
    Disk {
        /// Its middle.
        center: DVec3,
        /// Of unit length.
        normal: DVec3,
        /// Its size.
        radius: f64,
    },
    /// Shines along the normal.
    Rect(Rect),
}

/// A rectangle by its centre and unit vectors.
#[derive(Debug, Clone, Copy)]
pub struct Rect {
    center: DVec3,
    normal: DVec3,
    /// Along its sides, half of their lengths.
    sides: [DVec3; 2],
}

impl Shape {
    /// Of a record with an extent.
    pub fn new(light: &PunctualLight) -> Self {
        let [center, direction, axis] =
            [light.position, light.direction, light.axis].map(|v| DVec3::from(v.map(f64::from)));
        let (inner, outer) = (f64::from(light.inner), f64::from(light.outer));
        match light.kind() {
            kind if kind == PunctualKind::Sun as u32 => Self::Sun { towards: -direction, versine: inner },
            kind if kind == PunctualKind::Sphere as u32 => Self::Sphere { center, radius: inner },
            kind if kind == PunctualKind::Disk as u32 => Self::Disk { center, normal: direction, radius: inner },
            _ => {
                let sides = [axis * inner, axis.cross(direction) * outer];
                Self::Rect(Rect { center, normal: direction, sides })
            }
        }
    }

    /// A direction from a point; none: the light does not shine there.
    pub fn sample(&self, eye: DVec3, u: [f64; 2]) -> Option<Found> {
        match *self {
            Self::Sun { towards, versine } => Some(Found {
                direction: in_cone(towards, versine, u),
                distance: f64::INFINITY,
                pdf: (TAU * versine).recip(),
            }),
            Self::Sphere { center, radius } => {
                let way = center - eye;
                let versine = cone_of_sphere(way, radius)?;
                let direction = in_cone(way.normalize(), versine, u);
                let along = way.dot(direction);
                let distance = along - (radius * radius - (way - along * direction).length_squared()).max(0.0).sqrt();
                Some(Found { direction, distance, pdf: (TAU * versine).recip() })
            }
            Self::Disk { center, normal, radius } => {
                let (x, y) = normal.any_orthonormal_pair();
                let place = concentric_disk(u) * radius;
                self.towards(eye, center + place.x * x + place.y * y)
            }
            Self::Rect(rect) => self.towards(eye, rect.place(eye, u)),
        }
    }

    fn towards(&self, eye: DVec3, point: DVec3) -> Option<Found> {
        let way = point - eye;
        let distance = way.length();
        let direction = way / distance;
        let pdf = self.pdf(eye, direction, distance);
        (pdf > 0.0 && pdf.is_finite()).then_some(Found { direction, distance, pdf })
    }

    /// Density over solid angle of sampling a direction in which the light is met at a distance.
    pub fn pdf(&self, eye: DVec3, direction: DVec3, distance: f64) -> f64 {
        let by_area = |normal: DVec3, area: f64| {
            let cosine = -direction.dot(normal);
            if cosine > 0.0 { distance * distance / (area * cosine) } else { 0.0 }
        };
        match *self {
            Self::Sun { versine, .. } => (TAU * versine).recip(),
            Self::Sphere { center, radius } => {
                cone_of_sphere(center - eye, radius).map_or(0.0, |versine| (TAU * versine).recip())
            }
            Self::Disk { normal, radius, .. } => by_area(normal, PI * radius * radius),
            Self::Rect(rect) => match rect.seen_from(eye) {
                Some(view) if view.solid_angle >= WIDE => view.solid_angle.recip(),
                _ => by_area(rect.normal, 4.0 * rect.sides[0].length() * rect.sides[1].length()),
            },
        }
    }

    /// Distance at which a ray of unit direction meets its bright side.
    pub fn meet(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        match *self {
            Self::Sun { towards, versine } => {
                (direction.distance_squared(towards) < 2.0 * versine).then_some(f64::INFINITY)
            }
            Self::Sphere { center, radius } => {
                let way = center - origin;
                let along = way.dot(direction);
                let below = radius * radius - (way - along * direction).length_squared();
                let outside = way.length_squared() > radius * radius;
                (outside && along > 0.0 && below > 0.0).then(|| along - below.sqrt())
            }
            Self::Disk { center, normal, radius } => {
                let (t, aside) = meet_plane(origin, direction, center, normal)?;
                (aside.length_squared() < radius * radius).then_some(t)
            }
            Self::Rect(Rect { center, normal, sides }) => {
                let (t, aside) = meet_plane(origin, direction, center, normal)?;
                sides.iter().all(|side| aside.dot(*side).abs() < side.length_squared()).then_some(t)
            }
        }
    }
}

/// A rectangle as a point sees it, in axes along its sides and away from it (Ureña, Fajardo and King 2013, "An Area-Preserving
/// Parametrization for Spherical Rectangles", whose names these are).
struct View {
    low: DVec2,
    high: DVec2,
    /// Of its plane, negative.
    z: f64,
    /// Of the planes through the lower and the upper side, z of their normals.
    b: [f64; 2],
    /// 2 pi less the angles at the corners of low x.
    k: f64,
    solid_angle: f64,
}

impl Rect {
    /// None: from behind.
    fn seen_from(&self, eye: DVec3) -> Option<View> {
        let way = self.center - eye;
        let z = way.dot(self.normal);
        if z >= 0.0 {
            return None;
        }
        let half = DVec2::new(self.sides[0].length(), self.sides[1].length());
        let middle = DVec2::new(way.dot(self.sides[0]), way.dot(self.sides[1])) / half;
        let (low, high) = (middle - half, middle + half);
        let corners = [[low.x, low.y], [high.x, low.y], [high.x, high.y], [low.x, high.y]];
        let corners = corners.map(|[x, y]| DVec3::new(x, y, z));
        let normals: [DVec3; 4] = std::array::from_fn(|i| corners[i].cross(corners[(i + 1) % 4]).normalize());
        let angles: [f64; 4] = std::array::from_fn(|i| (-normals[i].dot(normals[(i + 1) % 4])).clamp(-1.0, 1.0).acos());
        let k = TAU - angles[2] - angles[3];
        Some(View { low, high, z, b: [normals[0].z, normals[2].z], k, solid_angle: angles[0] + angles[1] - k })
    }

    /// A point of it, uniform in solid angle, or in area where it is small.
    fn place(&self, eye: DVec3, u: [f64; 2]) -> DVec3 {
        let at =
            |part: DVec2| self.center + (2.0 * part.x - 1.0) * self.sides[0] + (2.0 * part.y - 1.0) * self.sides[1];
        match self.seen_from(eye) {
            Some(view) if view.solid_angle >= WIDE => at((view.place(u) - view.low) / (view.high - view.low)),
            _ => at(DVec2::from(u)),
        }
    }
}

impl View {
    fn place(&self, u: [f64; 2]) -> DVec2 {
        let au = u[0] * self.solid_angle + self.k;
        let fu = (au.cos() * self.b[0] - self.b[1]) / au.sin();
        let cu = (fu.signum() / fu.hypot(self.b[0])).clamp(-1.0, 1.0);
        let x = (-cu * self.z / (1.0 - cu * cu).max(f64::MIN_POSITIVE).sqrt()).clamp(self.low.x, self.high.x);
        let d = x.hypot(self.z);
        let [h0, h1] = [self.low.y, self.high.y].map(|y| y / d.hypot(y));
        let h = h0 + u[1] * (h1 - h0);
        let y = h * d / (1.0 - h * h).max(f64::MIN_POSITIVE).sqrt();
        DVec2::new(x, y.clamp(self.low.y, self.high.y))
    }
}

/// Distance to a plane's bright side, and the way from `center` to the place met.
fn meet_plane(origin: DVec3, direction: DVec3, center: DVec3, normal: DVec3) -> Option<(f64, DVec3)> {
    let (way, cosine) = (center - origin, direction.dot(normal));
    let t = way.dot(normal) / cosine;
    (cosine < 0.0 && t > 0.0).then(|| (t, t * direction - way))
}

/// Uniform in solid angle around an axis.
fn in_cone(axis: DVec3, versine: f64, u: [f64; 2]) -> DVec3 {
    let (x, y) = axis.any_orthonormal_pair();
    // Concentric, so that well-spread numbers stay so: the height goes with the square of the radius.
    let disk = concentric_disk(u);
    let depth = versine * disk.length_squared();
    let place = disk * (versine * (2.0 - depth)).sqrt();
    place.x * x + place.y * y + (1.0 - depth) * axis
}

/// 1 - cos of the half angle under which a sphere is seen; none: from within.
fn cone_of_sphere(way: DVec3, radius: f64) -> Option<f64> {
    let sine2 = radius * radius / way.length_squared();
    (sine2 < 1.0).then(|| sine2 / (1.0 + (1.0 - sine2).sqrt()))
}
