//! Pictures that take time: what moves is blurred as closed form, or as the mean of pictures of many moments.

use crate::support::{assert_near, engines, grey, lambert, mean, params, render, scene, sphere, square, work};
use candela::bench::agreement::{Size, Verdict, compare};
use candela::film::Picture;
use candela::params::{EngineChoice, RenderParams};
use candela::render::Strategy;
use candela::scene::{
    Animation, Camera, Channel, Curve, Light, LightKind, Material, Moment, Node, Parts, Path, Projection, Scene,
};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

on_both_engines! {
    a_sliding_square_covers_as_long_as_it_is_there,
    what_turns_with_the_camera_stands_still,
    a_shutter_of_no_time_changes_nothing,
    lamps_that_move_and_grow,
    a_point_light_that_flies_by,
}

/// The transform in parts.
fn parts(map: &DAffine3) -> Parts {
    let (scale, rotation, translation) = map.to_scale_rotation_translation();
    Parts { translation, rotation, scale }
}

/// Lets a node follow a curve through keys at times, as the scene's one animation.
fn animate(scene: &mut Scene, node: usize, path: Path, times: &[f32], values: &[f32]) {
    let width = values.len() / times.len();
    let curve = Curve { times: times.to_vec(), values: values.to_vec(), width, ..Curve::default() };
    let mut animations: Vec<Animation> = scene.animations.to_vec();
    if animations.is_empty() {
        animations.push(Animation { moves_meshes: true, span: [0.0, 2.0], ..Animation::default() });
    }
    animations[0].channels.push(Channel { node, path, curve });
    scene.animations = Arc::new(animations);
    let local = parts(&scene.nodes[node].local);
    scene.moved.entry(node).or_insert(local);
}

/// A camera that looks down from afar, by parallel rays, at a square of two units.
fn look_down(scene: &mut Scene) -> usize {
    scene.cameras.push(Camera { name: None, projection: Projection::Orthographic { ymag: 1.0 } });
    let local = DAffine3::from_translation(DVec3::Y * 5.0) * DAffine3::from_rotation_x(-FRAC_PI_2);
    scene.scenes[0].nodes.push(scene.nodes.len());
    scene.nodes.push(Node { camera: Some(scene.cameras.len() - 1), local, ..Node::default() });
    scene.nodes.len() - 1
}

fn glowing(radiance: f32) -> Material {
    Material { emissive: Vec3::splat(radiance), ..grey(0.0, 1.0, 0.0) }
}

/// Its centre goes from -1/2 to 1/2 while the shutter is open, so that `x` is covered for `1 - |x|` of the time.
fn a_sliding_square_covers_as_long_as_it_is_there(engine: EngineChoice) {
    let mut scene = scene(vec![(square(0.5), glowing(1.0), DAffine3::IDENTITY)]);
    look_down(&mut scene);
    animate(&mut scene, 0, Path::Translation, &[0.0, 2.0], &[-1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    for steps in [1, 8] {
        let shutter = format!(r#"{{"open":-0.5,"close":0.5,"steps":{steps}}}"#);
        let params = params(&format!(r#"{{"time":1,"adaptive":false,"max_samples":1024,"shutter":{shutter}}}"#));
        let work = work(&scene.at(Some(Moment { animation: 0, time: 1.0 })), &params);
        assert!(work.features.motion);
        let picture = render(engine, work);
        let (mut worst, mut squares) = (0f64, 0.0);
        for (index, pixel) in picture.pixels.iter().enumerate() {
            let at = |place: usize| (place as f64 + 0.5) / 16.0 - 1.0;
            let (x, y) = (at(index % 32), at(index / 32));
            let expected = if y.abs() < 0.5 { 1.0 - x.abs() } else { 0.0 };
            let difference = f64::from(pixel[0]) - expected;
            worst = worst.max(difference.abs());
            squares += difference * difference;
        }
        let rms = (squares / picture.pixels.len() as f64).sqrt();
        eprintln!("{engine:?}, {steps} steps: largest difference {worst:.2e}, rms {rms:.2e}");
        assert!(worst < 0.02 && rms < 4e-3, "{worst}, rms {rms}");
    }
}

/// A turntable with the camera on it: vertices and camera are both linear between the steps, and so one within the other.
fn what_turns_with_the_camera_stands_still(engine: EngineChoice) {
    let mut scene = scene(vec![(square(0.5), glowing(1.0), DAffine3::from_translation(DVec3::new(0.3, 0.0, 0.1)))]);
    let camera = look_down(&mut scene);
    scene.nodes.push(Node { children: vec![0, camera], ..Node::default() });
    scene.scenes[0].nodes = vec![scene.nodes.len() - 1];
    let turn = |angle: f64| DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), angle).as_quat().to_array();
    animate(&mut scene, 2, Path::Rotation, &[0.0, 1.0], &[turn(0.0), turn(2.0)].concat());
    let still = render(engine, work(&scene.at(Some(Moment { animation: 0, time: 0.0 })), &params(r#"{"time":0}"#)));
    let shutter = params(r#"{"time":0,"shutter":{"open":0,"close":1,"steps":2}}"#);
    let work = work(&scene.at(Some(Moment { animation: 0, time: 0.0 })), &shutter);
    assert!(work.view.way.len() == 3 && work.scene.motion.pieces == 2);
    let moved = render(engine, work);
    let differs = still.pixels.iter().zip(&moved.pixels).filter(|(a, b)| (a[0] - b[0]).abs() > 0.02).count();
    assert!(differs <= 4, "{differs} pixels");
    assert!(mean(&still, 0) > 0.2);
}

fn a_shutter_of_no_time_changes_nothing(engine: EngineChoice) {
    let mut scene = scene(vec![(square(0.5), glowing(1.0), DAffine3::IDENTITY)]);
    look_down(&mut scene);
    animate(&mut scene, 0, Path::Translation, &[0.0, 2.0], &[-1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    let posed = scene.at(Some(Moment { animation: 0, time: 0.8 }));
    let draw = |json: &str| render(engine, work(&posed, &params(json)));
    let none = draw(r#"{"time":0.8}"#);
    assert_eq!(none, draw(r#"{"time":0.8,"shutter":{"open":0.25,"close":0.25}}"#));
    assert_ne!(none, draw(r#"{"time":0.8,"shutter":{"open":0,"close":0.25}}"#));
}

/// The mean of pictures of single moments, at the middles of equal parts of the time that the shutter is open.
fn over_moments(engine: EngineChoice, scene: &Scene, [open, close]: [f64; 2], at: impl Fn(f64) -> RenderParams) -> f64 {
    const MOMENTS: u32 = 64;
    let time = |i: u32| open + (close - open) * (f64::from(i) + 0.5) / f64::from(MOMENTS);
    let one = |i| {
        let moment = Moment { animation: 0, time: time(i) };
        mean(&render(engine, lambert(work(&scene.at(Some(moment)), &at(time(i))))), 0)
    };
    (0..MOMENTS).map(one).sum::<f64>() / f64::from(MOMENTS)
}

/// Light of a lamp that slides, turns and grows, by either way of finding it and by both.
fn lamps_that_move_and_grow(engine: EngineChoice) {
    let lamp = DAffine3::from_translation(DVec3::Y) * DAffine3::from_rotation_x(PI);
    let mut scene =
        scene(vec![(square(4.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY), (square(0.2), glowing(10.0), lamp)]);
    animate(&mut scene, 1, Path::Translation, &[0.0, 1.0], &[-1.0, 0.6, 0.0, 1.0, 1.2, 0.0]);
    animate(&mut scene, 1, Path::Scale, &[0.0, 1.0], &[0.5, 0.5, 0.5, 2.0, 2.0, 2.0]);
    let json = |time: f64, samples: u32, more: &str| {
        let camera = r#""camera":{"position":[5,0.2,0],"target":[0.2,0,0],"yfov_degrees":0.02}"#;
        params(&format!(
            r#"{{"time":{time},"max_bounces":1,"max_samples":{samples},"width":16,"height":16,{camera}{more}}}"#
        ))
    };
    let expected = over_moments(engine, &scene, [0.0, 1.0], |time| json(time, 64, ""));
    let shutter = json(0.0, 2048, r#","shutter":{"open":0,"close":1,"steps":32}"#);
    for [light_samples, scattered_light] in [[true, true], [true, false], [false, true]] {
        let mut work = lambert(work(&scene.at(Some(Moment { animation: 0, time: 0.0 })), &shutter));
        work.settings.strategy = Strategy { light_samples, scattered_light, ..Strategy::default() };
        let got = mean(&render(engine, work), 0);
        eprintln!("{engine:?}, {light_samples} {scattered_light}: {got:.5} for {expected:.5}");
        assert_near(got, expected, if light_samples { 5e-3 } else { 0.03 });
    }
}

/// Irradiance by the inverse square, integrated over the way.
fn a_point_light_that_flies_by(engine: EngineChoice) {
    let mut scene = scene(vec![(square(4.0), grey(0.5, 1.0, 0.0), DAffine3::IDENTITY)]);
    scene.lights.push(Light { name: None, intensity: Vec3::ONE, range: None, kind: LightKind::Point, profile: None });
    scene.scenes[0].nodes.push(1);
    scene.nodes.push(Node { light: Some(0), ..Node::default() });
    animate(&mut scene, 1, Path::Translation, &[0.0, 1.0], &[-1.0, 1.0, 0.0, 2.0, 1.0, 0.0]);
    let params = params(
        r#"{"time":0,"max_samples":1024,"max_bounces":1,"width":16,"height":16,"shutter":{"open":0,"close":1,"steps":3},
            "camera":{"position":[0,3,3],"target":[0,0,0],"yfov_degrees":0.02}}"#,
    );
    let work = lambert(work(&scene.at(Some(Moment { animation: 0, time: 0.0 })), &params));
    assert!(work.lighting.moves());
    // Integral of (1 + x^2)^(-3/2) is x / sqrt(1 + x^2), over a way of three.
    let integral = |x: f64| x / (1.0 + x * x).sqrt();
    assert_near(mean(&render(engine, work), 0), 0.5 / PI * (integral(2.0) - integral(-1.0)) / 3.0, 2e-3);
}

/// Everything that moves in one scene: a turning ball with normals, a lamp, a point light and the camera.
fn turmoil() -> Scene {
    let lamp = DAffine3::from_translation(DVec3::new(0.0, 2.0, 0.0)) * DAffine3::from_rotation_x(PI);
    let mut scene = scene(vec![
        (square(3.0), grey(0.7, 0.3, 0.0), DAffine3::IDENTITY),
        (sphere(6), grey(0.9, 0.2, 1.0), DAffine3::from_scale(DVec3::splat(0.5))),
        (square(0.5), glowing(6.0), lamp),
        (square(0.4), Material { double_sided: true, ..grey(0.3, 0.8, 0.0) }, DAffine3::from_translation(DVec3::Y)),
    ]);
    scene.lights.push(Light {
        name: None,
        intensity: Vec3::new(2.0, 1.0, 0.5),
        range: None,
        kind: LightKind::Point,
        profile: None,
    });
    scene.nodes.push(Node { light: Some(0), ..Node::default() });
    scene.cameras.push(Camera { name: None, projection: Projection::Perspective { yfov: 0.9 } });
    scene.nodes.push(Node { camera: Some(0), ..Node::default() });
    scene.scenes[0].nodes.extend([4, 5]);
    let turn = |axis: DVec3, angle: f64| DQuat::from_axis_angle(axis.normalize(), angle).as_quat().to_array();
    let ball = DVec3::new(1.0, 2.0, 0.5);
    animate(&mut scene, 1, Path::Rotation, &[0.0, 1.0], &[turn(ball, 0.0), turn(ball, 2.5)].concat());
    animate(&mut scene, 1, Path::Translation, &[0.0, 1.0], &[-0.8, 0.6, 0.0, 0.8, 0.6, 0.3]);
    animate(&mut scene, 2, Path::Translation, &[0.0, 1.0], &[-1.0, 1.5, 0.0, 1.0, 2.5, 0.0]);
    animate(&mut scene, 3, Path::Rotation, &[0.0, 1.0], &[turn(DVec3::Z, 0.0), turn(DVec3::Z, 3.0)].concat());
    animate(&mut scene, 4, Path::Translation, &[0.0, 1.0], &[1.5, 1.0, 1.0, -1.5, 1.0, 1.0]);
    animate(&mut scene, 5, Path::Translation, &[0.0, 1.0], &[0.0, 0.9, 4.0, 0.2, 1.0, 3.5]);
    scene
}

/// The work of the shaders while the shutter is open for a part of the second, and of the f64 engine for another.
fn compared(shaders: [f64; 2], f64_engine: [f64; 2]) -> Verdict {
    let of = |engine, [open, close]: [f64; 2]| {
        let params = params(&format!(
            r#"{{"time":0,"shutter":{{"open":{open},"close":{close},"steps":6}},"camera":{{"index":0}},
                "width":24,"height":24,"adaptive":false}}"#
        ));
        let mut work = work(&turmoil().at(Some(Moment { animation: 0, time: 0.0 })), &params);
        assert!(work.features.motion && work.lighting.moves() && !work.view.way.is_empty());
        work.settings.engine = engine;
        work
    };
    let works = [of(EngineChoice::Gpu, shaders), of(EngineChoice::Cpu, f64_engine)];
    let verdict = compare(&mut engines(), works, Size { side: 24, samples: 64, batches: 12 }).expect("two engines");
    eprintln!("{shaders:?} and {f64_engine:?}: {verdict:?}");
    verdict
}

#[test]
fn both_engines_blur_alike() {
    assert!(compared([0.1, 0.9], [0.1, 0.9]).agrees());
}

/// What shows that the comparison would find a fault.
#[test]
fn a_shutter_that_closes_late_is_told_apart() {
    assert!(!compared([0.1, 0.9], [0.1, 0.94]).agrees());
}

/// A picture of one moment in the middle is no picture of the whole.
#[test]
fn blurred_pictures_differ_from_sharp_ones() {
    let draw = |json: &str| -> Picture {
        let params = params(json);
        render(EngineChoice::Cpu, work(&turmoil().at(Some(Moment { animation: 0, time: 0.5 })), &params))
    };
    let sharp = draw(r#"{"time":0.5,"camera":{"index":0}}"#);
    let blurred = draw(r#"{"time":0.5,"shutter":{"open":-0.5,"close":0.5},"camera":{"index":0}}"#);
    let differs = sharp.pixels.iter().zip(&blurred.pixels).filter(|(a, b)| (a[0] - b[0]).abs() > 0.1).count();
    assert!(differs > 50, "{differs}");
}
