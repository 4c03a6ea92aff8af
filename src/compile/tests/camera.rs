//! Cameras: the scene's, given ones, and automatic framing.

use super::{mesh, scene, soup};
use crate::compile::{CompileError, CompiledScene, Lens, View, compile_scene, view};
use crate::params::{CameraParams, OrbitParams, RenderParams};
use crate::scene::{Camera, Node, Projection, Scene, SceneRoot};
use glam::{DAffine3, DVec3, Vec3};

fn with(camera: CameraParams) -> RenderParams {
    RenderParams { camera: Some(camera), ..RenderParams::default() }
}

fn seen(source: &Scene, params: &RenderParams) -> (CompiledScene, View) {
    let compiled = compile_scene(source, None).unwrap();
    let (view, _) = view(source, &compiled, params).unwrap();
    (compiled, view)
}

fn blob() -> Scene {
    let placed = DAffine3::from_scale_rotation_translation(
        DVec3::new(9.0, 1.0, 2.0),
        glam::DQuat::from_rotation_y(1.0),
        DVec3::new(1e6, 0.0, -1e6),
    );
    scene(vec![mesh(soup(200, 3))], &[(0, placed)])
}

/// A scene with a perspective camera named "eye" on a node named "mast", and an orthographic one.
fn with_cameras() -> Scene {
    let mut source = blob();
    let perspective = Projection::Perspective { yfov: 0.5 };
    source.cameras.push(Camera { name: Some("eye".into()), projection: perspective });
    source.cameras.push(Camera { name: None, projection: Projection::Orthographic { ymag: 3.0 } });
    let local = DAffine3::from_translation(DVec3::new(1e6, 0.0, -1e6 + 20.0)) * DAffine3::from_scale(DVec3::splat(3.0));
    source.nodes.push(Node { name: Some("mast".into()), camera: Some(0), local, ..Node::default() });
    source.nodes.push(Node { camera: Some(1), local, ..Node::default() });
    source.scenes[0].nodes.extend([1, 2]);
    source
}

/// Largest coordinate of the corners of the bounds in the picture, 1 being its edge; none: behind the camera.
fn extent(compiled: &CompiledScene, view: &View) -> Option<f64> {
    let Lens::Perspective { tan_half_yfov, .. } = view.lens else { return None };
    let tan = f64::from(tan_half_yfov);
    let aspect = f64::from(view.width) / f64::from(view.height);
    let inverse = view.to_world.inverse();
    let project = |corner: DVec3| {
        let p = inverse.transform_point3(corner.as_vec3()).as_dvec3();
        (p.z < 0.0).then(|| (p.x / -p.z / tan / aspect).abs().max((p.y / -p.z / tan).abs()))
    };
    compiled.bounds.corners().into_iter().map(project).try_fold(0.0, |most: f64, one| Some(most.max(one?)))
}

#[test]
fn framing_holds_all_corners_tightly() {
    for (azimuth_degrees, elevation_degrees) in [(30.0, 20.0), (0.0, 90.0), (123.0, -90.0), (200.0, -35.0)] {
        for (width, height) in [(1200, 500), (300, 900), (64, 64)] {
            let orbit = Some(OrbitParams { azimuth_degrees, elevation_degrees, distance: None });
            let camera = CameraParams { orbit, ..CameraParams::default() };
            let (compiled, view) = seen(&blob(), &RenderParams { width, height, ..with(camera) });
            let extent = extent(&compiled, &view).expect("all corners are in front");
            assert!((0.949..0.951).contains(&extent), "{extent}");
        }
    }
    let (compiled, view) = seen(&blob(), &RenderParams::default());
    assert!(extent(&compiled, &view).unwrap() <= 0.951);
}

#[test]
fn orbit_is_as_documented() {
    let orbit = Some(OrbitParams { azimuth_degrees: 40.0, elevation_degrees: 25.0, distance: Some(5.0) });
    let target = [1e6, 1.0, -1e6];
    let camera = CameraParams { orbit, target: Some(target), ..CameraParams::default() };
    let (compiled, view) = seen(&blob(), &with(camera));
    let (a, e) = (40.0_f64.to_radians(), 25.0_f64.to_radians());
    let eye = DVec3::from(target) + 5.0 * DVec3::new(a.sin() * e.cos(), e.sin(), a.cos() * e.cos());
    let found = Vec3::from(view.to_world.translation).as_dvec3() + compiled.origin;
    assert!(found.distance(eye) < 1e-5, "{found} {eye}");
    let forward = view.to_world.transform_vector3(Vec3::NEG_Z).as_dvec3();
    assert!(forward.distance((DVec3::from(target) - eye).normalize()) < 1e-6);
    assert!(view.to_world.transform_vector3(Vec3::Y).y > 0.0);
    assert!((view.to_world.matrix3.determinant() - 1.0).abs() < 1e-6);
}

#[test]
fn cameras_of_the_scene_are_found_and_keep_their_lens() {
    let source = with_cameras();
    let (compiled, first) = seen(&source, &RenderParams::default());
    assert!(
        matches!(first.lens, Lens::Perspective { tan_half_yfov, .. } if (tan_half_yfov - 0.25_f32.tan()).abs() < 1e-6)
    );
    let eye = Vec3::from(first.to_world.translation).as_dvec3() + compiled.origin;
    assert!(eye.distance(DVec3::new(1e6, 0.0, -1e6 + 20.0)) < 1e-5);
    for name in ["eye", "mast"] {
        let named = CameraParams { name: Some(name.into()), ..CameraParams::default() };
        assert_eq!(seen(&source, &with(named)).1.to_world, first.to_world);
    }
    let second = CameraParams { index: Some(1), ..CameraParams::default() };
    assert_eq!(seen(&source, &with(second)).1.lens, Lens::Orthographic { ymag: 3.0 });
}

#[test]
fn faults_have_pointers_and_say_what_there_is() {
    let source = with_cameras();
    let compiled = compile_scene(&source, None).unwrap();
    let fault = |camera: CameraParams| match view(&source, &compiled, &with(camera)) {
        Err(CompileError::Params(error)) => (error.pointer, error.detail),
        other => panic!("{other:?}"),
    };
    let base = CameraParams::default();
    let (pointer, detail) = fault(CameraParams { name: Some("nose".into()), ..base.clone() });
    assert!(pointer == "/params/camera/name" && detail.contains("eye"), "{detail}");
    assert_eq!(fault(CameraParams { index: Some(2), ..base.clone() }).0, "/params/camera/index");
    let both = CameraParams { index: Some(0), position: Some([0.0; 3]), ..base.clone() };
    assert_eq!(fault(both).0, "/params/camera");
    let same = CameraParams { position: Some([1.0; 3]), target: Some([1.0; 3]), ..base.clone() };
    assert_eq!(fault(same).0, "/params/camera/target");
    assert_eq!(fault(CameraParams { target: Some([1.0; 3]), ..base.clone() }).0, "/params/camera/target");
    let flat = CameraParams { index: Some(1), yfov_degrees: Some(40.0), ..base };
    assert_eq!(fault(flat).0, "/params/camera/yfov_degrees");
}

#[test]
fn up_along_the_view_is_replaced_and_stated() {
    let camera =
        CameraParams { position: Some([1e6, 9.0, -1e6]), target: Some([1e6, 0.0, -1e6]), ..Default::default() };
    let source = blob();
    let compiled = compile_scene(&source, None).unwrap();
    let (view, defaults) = view(&source, &compiled, &with(camera)).unwrap();
    assert_eq!(defaults[0].what, "camera.up");
    assert!(view.to_world.is_finite());
    assert!(view.to_world.transform_vector3(Vec3::Y).distance(Vec3::NEG_Z) < 1e-6);
}

#[test]
fn an_empty_scene_has_a_view() {
    let empty = Scene { scenes: vec![SceneRoot::default()], ..Scene::default() };
    let (_, view) = seen(&empty, &RenderParams::default());
    assert!(view.to_world.is_finite());
}
