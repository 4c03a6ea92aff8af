//! Lights with measured profiles over a plane, against an evaluation of their own of the table by the definitions of LM-63.

use crate::support::{grey, lambert, params, render, scene, square, work, work_with_profile};
use candela::params::{EngineChoice, RenderParams};
use candela::render::Work;
use candela::scene::{Light, LightKind, Node, Profile, Scene};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::sync::Arc;

on_both_engines! {
    a_lopsided_profile_over_a_plane,
    each_type_of_photometry,
    a_profile_in_a_cone,
    a_light_of_the_file,
    a_light_that_turns,
    a_uniform_profile_is_a_point,
}

const VERTICAL: [f64; 8] = [0.0, 10.0, 25.0, 40.0, 45.0, 60.0, 80.0, 120.0];
const HORIZONTAL: [f64; 7] = [0.0, 30.0, 100.0, 170.0, 200.0, 310.0, 360.0];
const BOTH_WAYS: [f64; 7] = [-90.0, -50.0, -20.0, 5.0, 30.0, 55.0, 90.0];

/// Candela of a table, which closes its turn.
fn measured(column: usize, row: usize, columns: usize) -> f64 {
    let seed = (column % (columns - 1)) as f64 * 1.7 + row as f64 * 2.9;
    // All azimuths are one direction in the middle of type C.
    20.0 + 15.0 * if row == 0 { 0.4 } else { seed.sin() }
}

/// A file of type 1 (C), 2 (B) or 3 (A).
fn file(kind: u32) -> String {
    let (vertical, horizontal) = angles(kind);
    let list = |angles: &[f64]| angles.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let candela = |column: usize| {
        let value = |row: usize| (measured(column, row, horizontal.len()) / 0.8).to_string();
        (0..vertical.len()).map(value).collect::<Vec<_>>().join(" ")
    };
    let candela: Vec<String> = (0..horizontal.len()).map(candela).collect();
    format!(
        "IES:LM-63-2019\n[TEST] none\nTILT=NONE\n1 -1 2 {} {} {kind} 2 0 0 0\n0.4 1.00001 9\n{}\n{}\n{}\n",
        vertical.len(),
        horizontal.len(),
        list(vertical),
        list(horizontal),
        candela.join("\n")
    )
}

fn profile(kind: u32) -> Arc<Profile> {
    Arc::new(Profile::read(file(kind).as_bytes()).expect("a profile"))
}

fn angles(kind: u32) -> (&'static [f64], &'static [f64]) {
    if kind == 1 { (&VERTICAL, &HORIZONTAL) } else { (&BOTH_WAYS, &BOTH_WAYS) }
}

/// Candela towards a direction of unit length in the frame of a light as glTF has it: beam -Z, zero azimuth +X.
fn candela(kind: u32, direction: DVec3) -> f64 {
    let DVec3 { x, y, z } = direction;
    let (v, h) = match kind {
        1 => ((-z).clamp(-1.0, 1.0).acos(), y.atan2(x).rem_euclid(2.0 * PI)),
        2 => (x.atan2(-z), (-y).asin()),
        _ => (x.asin(), (-y).atan2(-z)),
    };
    let (vertical, horizontal) = angles(kind);
    let find = |angles: &[f64], angle: f64| {
        (1..angles.len())
            .find(|&i| angle >= angles[i - 1] && angle <= angles[i])
            .map(|i| (i - 1, (angle - angles[i - 1]) / (angles[i] - angles[i - 1])))
    };
    let (Some((row, down)), Some((column, across))) =
        (find(vertical, v.to_degrees()), find(horizontal, h.to_degrees()))
    else {
        return 0.0;
    };
    let at = |i: usize, j: usize| measured(column + i, row + j, horizontal.len());
    (at(0, 0) * (1.0 - down) + at(0, 1) * down) * (1.0 - across) + (at(1, 0) * (1.0 - down) + at(1, 1) * down) * across
}

/// A camera above the plane y = 0 that sees 4 x 4 of it, white.
fn request(extra: &Value) -> RenderParams {
    let mut all = json!({"max_bounces": 1, "max_samples": 256,
        "camera": {"position": [0, 200, 0], "target": [0, 0, 0], "up": [0, 0, -1], "yfov_degrees": 2.0 * (2.0f64 / 200.0).atan().to_degrees()}});
    for (name, value) in extra.as_object().into_iter().flatten() {
        all[name] = value.clone();
    }
    params(&all.to_string())
}

fn floor() -> Scene {
    scene(vec![(square(10.0), grey(1.0, 1.0, 0.0), DAffine3::IDENTITY)])
}

/// The same light as the formula has it: `of` gives candela in the frame whose columns are the zero azimuth, z x b and -b.
fn assert_lit(name: &str, engine: EngineChoice, work: Work, position: DVec3, frame: DMat3, of: impl Fn(DVec3) -> f64) {
    // Moments are drawn, too.
    let tolerance = if work.features.motion { 1e-2 } else { 2e-3 };
    const STEPS: usize = 12;
    let picture = render(engine, lambert(work));
    let side = f64::from(picture.width);
    let (mut worst, mut brightest) = (0.0f64, 0.0f64);
    for (index, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = ((index % 32) as f64, (index / 32) as f64);
        let radiance = |step: usize| {
            let at = |pixel: f64, step: usize| (pixel + (step as f64 + 0.5) / STEPS as f64) / side * 4.0 - 2.0;
            let way = DVec3::new(at(x, step % STEPS), 0.0, at(y, step / STEPS)) - position;
            let direction = way.normalize();
            of(frame.transpose() * direction) * -direction.y / way.length_squared() / PI
        };
        let expected = (0..STEPS * STEPS).map(radiance).sum::<f64>() / (STEPS * STEPS) as f64;
        worst = worst.max((f64::from(pixel[0]) - expected).abs());
        brightest = brightest.max(expected);
    }
    eprintln!("{name}, {engine:?}: off by {:.5} of the brightest {brightest:.3}", worst / brightest);
    assert!(worst < tolerance * brightest && brightest > 0.5, "{name}, {engine:?}: {worst} of {brightest}");
}

/// Columns: zero azimuth, z x b, and -b.
fn frame(beam: DVec3, zero: DVec3) -> DMat3 {
    let beam = beam.normalize();
    let zero = (zero - zero.dot(beam) * beam).normalize();
    DMat3::from_cols(zero, zero.cross(beam), -beam)
}

const POSITION: DVec3 = DVec3::new(0.3, 1.5, -0.2);
const BEAM: DVec3 = DVec3::new(0.2, -1.0, 0.1);
const ZERO: DVec3 = DVec3::new(0.3, 0.2, -1.0);

fn light(kind: &str, extra: &Value) -> Value {
    let mut light = json!({"type": kind, "position": POSITION.to_array(), "direction": BEAM.to_array(), "ies": "lamp.ies",
        "zero_azimuth": ZERO.to_array(), "intensity": 0.7});
    for (name, value) in extra.as_object().into_iter().flatten() {
        light[name] = value.clone();
    }
    light
}

fn lit(kind: u32, light: &Value, extra: &Value) -> Work {
    let mut all = json!({ "lights": [light] });
    for (name, value) in extra.as_object().into_iter().flatten() {
        all[name] = value.clone();
    }
    work_with_profile(&floor(), &request(&all), "lamp.ies", profile(kind))
}

fn a_lopsided_profile_over_a_plane(engine: EngineChoice) {
    for mode in ["path", "direct"] {
        let work = lit(1, &light("point", &json!({})), &json!({ "mode": mode }));
        assert!(work.features.profiles);
        assert_lit(mode, engine, work, POSITION, frame(BEAM, ZERO), |d| 0.7 * candela(1, d));
    }
    // Without directions: straight down, zero along +X.
    let plain = json!({"type": "point", "position": POSITION.to_array(), "ies": "lamp.ies"});
    let work = lit(1, &plain, &json!({}));
    assert_lit("plain", engine, work, POSITION, frame(DVec3::NEG_Y, DVec3::X), |d| candela(1, d));
}

fn each_type_of_photometry(engine: EngineChoice) {
    for kind in [2, 3] {
        let work = lit(kind, &light("point", &json!({})), &json!({}));
        let name = format!("type {kind}");
        assert_lit(&name, engine, work, POSITION, frame(BEAM, ZERO), |d| 0.7 * candela(kind, d));
    }
}

fn a_profile_in_a_cone(engine: EngineChoice) {
    let cone = json!({"inner_cone_degrees": 15, "outer_cone_degrees": 40});
    let work = lit(2, &light("spot", &cone), &json!({}));
    let (inner, outer) = (15f64.to_radians().cos(), 40f64.to_radians().cos());
    let edge = |d: DVec3| ((-d.z - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2);
    assert_lit("spot", engine, work, POSITION, frame(BEAM, ZERO), |d| 0.7 * candela(2, d) * edge(d));
}

/// A file with a light whose node is turned and scaled.
fn of_file(turn: DQuat) -> Scene {
    let mut scene = floor();
    scene.lights.push(Light {
        name: None,
        intensity: Vec3::splat(0.5),
        range: None,
        kind: LightKind::Point,
        profile: Some(profile(1)),
    });
    let local = DAffine3::from_scale_rotation_translation(DVec3::splat(3.0), turn, POSITION);
    scene.scenes[0].nodes.push(scene.nodes.len());
    scene.nodes.push(Node { light: Some(0), local, ..Node::default() });
    scene
}

fn a_light_of_the_file(engine: EngineChoice) {
    let turn = DQuat::from_euler(glam::EulerRot::YXZ, 0.4, -1.3, 0.9);
    let work = work(&of_file(turn), &request(&json!({})));
    assert_lit("glTF", engine, work, POSITION, DMat3::from_quat(turn), |d| 0.5 * candela(1, d));
}

/// About its own beam, while the shutter is open: in steps short enough that the chord is the arc.
fn a_light_that_turns(engine: EngineChoice) {
    use candela::scene::{Animation, Channel, Curve, Interpolation, Parts, Path};
    let down = DQuat::from_rotation_x(-PI / 2.0);
    let mut scene = of_file(down);
    let node = scene.nodes.len() - 1;
    let (begin, end) = (down, down * DQuat::from_rotation_z(0.8));
    let values = [begin, end].iter().flat_map(|q| q.to_array().map(|v| v as f32)).collect();
    let curve = Curve { times: vec![0.0, 1.0], values, interpolation: Interpolation::Linear, width: 4 };
    let channel = Channel { node, path: Path::Rotation, curve };
    scene.animations = Arc::new(vec![Animation { channels: vec![channel], span: [0.0, 1.0], ..Animation::default() }]);
    scene.moved.insert(node, Parts { scale: DVec3::splat(3.0), rotation: down, translation: POSITION });
    let work = work(&scene, &request(&json!({"shutter": {"open": 0, "close": 1, "steps": 16}, "max_samples": 1024})));
    assert!(work.features.motion);
    let at = |step: usize| DMat3::from_quat(DQuat::from_rotation_z(-0.8 * (step as f64 + 0.5) / 64.0));
    let mean = |d: DVec3| (0..64).map(|step| 0.5 * candela(1, at(step) * d)).sum::<f64>() / 64.0;
    assert_lit("turning", engine, work, POSITION, DMat3::from_quat(down), mean);
}

/// The same bits but for the factor.
fn a_uniform_profile_is_a_point(engine: EngineChoice) {
    let text = "IESNA91\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 9\n0 180\n0\n12 12\n";
    let uniform = Arc::new(Profile::read(text.as_bytes()).expect("a profile"));
    let point = |extra: Value| {
        let mut light = json!({"type": "point", "position": POSITION.to_array(), "intensity": 12});
        for (name, value) in extra.as_object().into_iter().flatten() {
            light[name] = value.clone();
        }
        let asked = request(&json!({"lights": [light], "max_bounces": null, "max_samples": 16}));
        let ball = crate::support::sphere(24);
        let scene = scene(vec![
            (square(10.0), grey(0.7, 0.6, 0.0), DAffine3::IDENTITY),
            (ball, grey(0.8, 0.3, 0.5), DAffine3::from_translation(DVec3::new(-0.4, 0.5, 0.5))),
        ]);
        render(engine, work_with_profile(&scene, &asked, "u.ies", Arc::clone(&uniform)))
    };
    let (with, without) = (point(json!({"ies": "u.ies", "intensity": 1})), point(json!({})));
    for (a, b) in with.pixels.iter().zip(&without.pixels) {
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() <= 2e-6 * b.abs().max(1e-3), "{a} for {b}");
        }
    }
}

/// Pixels' centres, without tracing.
#[test]
fn previews_draw_profiles_too() {
    for (kind, of_light, edge) in [(1, "point", 0.0), (3, "point", 0.0), (2, "spot", 40.0)] {
        let extra = if edge > 0.0 { json!({"inner_cone_degrees": 15, "outer_cone_degrees": 40}) } else { json!({}) };
        let settings = json!({"mode": "preview", "filter": {"kind": "box", "radius": 0.001},
            "preview": {"samples": 1, "shadows": {"algorithm": "none"}}});
        let work = lit(kind, &light(of_light, &extra), &settings);
        let picture = render(EngineChoice::Gpu, lambert(work));
        let frame = frame(BEAM, ZERO);
        let (inner, outer) = (15f64.to_radians().cos(), 40f64.to_radians().cos());
        let (mut worst, mut brightest) = (0.0f64, 0.0f64);
        for (index, pixel) in picture.pixels.iter().enumerate() {
            let at = |pixel: usize| (pixel as f64 + 0.5) / 8.0 - 2.0;
            let way = DVec3::new(at(index % 32), 0.0, at(index / 32)) - POSITION;
            let direction = way.normalize();
            let d = frame.transpose() * direction;
            let cone = if edge > 0.0 { ((-d.z - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2) } else { 1.0 };
            let expected = 0.7 * candela(kind, d) * cone * -direction.y / way.length_squared() / PI;
            worst = worst.max((f64::from(pixel[0]) - expected).abs());
            brightest = brightest.max(expected);
        }
        eprintln!("type {kind}, {of_light}: off by {:.6} of {brightest:.3}", worst / brightest);
        assert!(worst < 1e-3 * brightest && brightest > 0.5, "type {kind}: {worst} of {brightest}");
    }
}
