//! Whether a camera can see the scene at all.

use super::{Bounds, Lens, View};
use glam::DVec3;

/// Why a picture shows nothing of the scene, if it is certain that it does: for a warning. Bounds are relative to the origin.
pub fn unseen(bounds: &Bounds, view: &View) -> Option<&'static str> {
    if bounds.is_empty() {
        return None;
    }
    let to_world = view.to_world.matrix3;
    let eye = view.to_world.translation.as_dvec3();
    let corners = bounds.corners().map(|corner| {
        let from_eye = corner - eye;
        let along = |axis: glam::Vec3A| from_eye.dot(axis.as_dvec3());
        DVec3::new(along(to_world.x_axis), along(to_world.y_axis), -along(to_world.z_axis))
    });
    if corners.iter().all(|corner| corner.z <= 0.0) {
        return Some("all of the scene lies behind the camera");
    }
    let aspect = f64::from(view.width) / f64::from(view.height.max(1));
    // Half sizes of the picture at a depth, a lens' blur included.
    let half_height = |depth: f64| match view.lens {
        Lens::Perspective { tan_half_yfov, aperture_radius, focus_distance, .. } => {
            let blur = f64::from(aperture_radius) * (1.0 + depth.abs() / f64::from(focus_distance));
            f64::from(tan_half_yfov) * depth.max(0.0) + blur
        }
        Lens::Orthographic { ymag } => f64::from(ymag),
    };
    // A pixel's filter reaches over the border.
    let border = 1.0 + 4.0 / f64::from(view.height.max(1));
    let beyond = |side: &dyn Fn(&DVec3) -> f64, size: f64| {
        corners.iter().all(|corner| side(corner) > half_height(corner.z) * size * border)
    };
    if beyond(&|c| c.x, aspect) || beyond(&|c| -c.x, aspect) || beyond(&|c| c.y, 1.0) || beyond(&|c| -c.y, 1.0) {
        return Some("all of the scene lies beside the picture");
    }
    let nearest = corners.iter().map(|corner| corner.z).fold(f64::INFINITY, f64::min);
    let pixel = 2.0 * half_height(nearest) / f64::from(view.height.max(1));
    (nearest > 0.0 && 2.0 * bounds.radius() < pixel)
        .then_some("the camera is so far away that all of the scene is smaller than a pixel")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compile::framing::Axes;
    use crate::params::Filter;
    use glam::{Affine3A, Mat3A, Vec3};

    fn at(eye: Vec3, target: Vec3) -> Option<&'static str> {
        let bounds = Bounds { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
        let Axes { right, up, forward } = Axes::looking((target - eye).as_dvec3(), DVec3::Y).unwrap();
        let matrix3 = Mat3A::from_cols(right.as_vec3a(), up.as_vec3a(), (-forward).as_vec3a());
        let to_world = Affine3A { matrix3, translation: eye.into() };
        let lens = Lens::Perspective {
            tan_half_yfov: 0.4,
            aperture_radius: 0.0,
            focus_distance: 1.0,
            blades: 0,
            blade_rotation: 0.0,
        };
        unseen(
            &bounds,
            &View {
                to_world,
                way: Vec::new(),
                lens,
                width: 300,
                height: 200,
                filter: Filter::default(),
                transparent: false,
            },
        )
    }

    #[test]
    fn what_is_not_seen_is_told() {
        assert_eq!(at(Vec3::Z * 5.0, Vec3::ZERO), None);
        assert_eq!(at(Vec3::Z * 0.5, Vec3::ZERO), None, "from within");
        assert_eq!(at(Vec3::Z * 400.0, Vec3::ZERO), None);
        assert!(at(Vec3::Z * 5.0, Vec3::Z * 9.0).unwrap().contains("behind"));
        assert!(at(Vec3::new(9.0, 0.0, 5.0), Vec3::new(9.0, 0.0, 0.0)).unwrap().contains("beside"));
        assert!(at(Vec3::new(0.0, -9.0, 5.0), Vec3::new(0.0, -9.0, 0.0)).unwrap().contains("beside"));
        assert!(at(Vec3::Z * 1e6, Vec3::ZERO).unwrap().contains("smaller"));
    }
}
