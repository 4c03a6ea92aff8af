//! Shading normals that lean so far from their triangle's that they cannot be shaded with, bent back.
//!
//! `normal` and `geometric` are unit vectors, the latter on the viewer's side; `direction` leads from the viewer.

use glam::DVec3;

/// A normal that faces away from the viewer, bent just far enough to be seen.
pub fn visible(normal: DVec3, geometric: DVec3, direction: DVec3) -> DVec3 {
    let cosine = -normal.dot(direction);
    if cosine > 0.0 {
        return normal;
    }
    let least = (-geometric.dot(direction)).min(0.01);
    (normal - (least - cosine) * direction).normalize()
}

/// A normal, bent just far enough that a mirror there is seen and shows what lies above the surface: at the most half-way between the
/// view and the lowest reflection, in the plane of both normals. What a mirror shows below the surface would be lost.
pub fn mirroring(normal: DVec3, geometric: DVec3, direction: DVec3) -> DVec3 {
    let view = -geometric.dot(direction);
    let lowest = view.min(0.01);
    if normal.dot(direction) < 0.0 && direction.reflect(normal).dot(geometric) >= lowest {
        return normal;
    }
    let Some(across) = normal.reject_from_normalized(geometric).try_normalize() else { return geometric };
    let aside = -across.dot(direction);
    let reflected_aside = (aside * aside + view * view - lowest * lowest).max(0.0).sqrt();
    ((aside + reflected_aside) * across + (view + lowest) * geometric).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever the normals and the view: a mirror is seen and shows what lies above the surface, and a normal that does so stays.
    #[test]
    fn shading_normals_face_view_and_reflection() {
        let turn = |azimuth: f64, height: f64| {
            let around = (1.0 - height * height).max(0.0).sqrt();
            DVec3::new(around * azimuth.cos(), around * azimuth.sin(), height)
        };
        let mut bent = 0;
        for i in 0..20_000 {
            let part = |step: f64| (f64::from(i) * step).fract();
            let direction = -turn(6.3 * part(0.754_877_666), part(0.569_840_291).max(1e-4));
            let normal = turn(6.3 * part(0.618_033_989), 2.0 * part(0.414_213_562) - 1.0);
            let found = mirroring(normal, DVec3::Z, direction);
            let (view, reflected) = (-found.dot(direction), direction.reflect(found).z);
            assert!((found.length() - 1.0).abs() < 1e-12 && view > 0.0, "{normal} {direction} {found}");
            assert!(reflected >= (-direction.z).min(0.01) - 1e-9, "{normal} {direction} {found} {reflected}");
            if found != normal {
                bent += 1;
                let kept = -normal.dot(direction) > 0.0 && direction.reflect(normal).z >= 0.01;
                assert!(!kept, "{normal} {direction}");
            }
        }
        assert!((10_000..19_000).contains(&bent), "{bent}");
    }
}
