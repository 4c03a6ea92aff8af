//! `mode: direct`: light straight from punctual lights, hard shadows, mirrors to a depth limit.

use crate::support::{grey, mean, params, render, scene, square, work};
use candela::params::EngineChoice;
use candela::scene::{Material, Scene};
use glam::{DAffine3, DQuat, DVec3, Vec3, Vec4};

on_both_engines! {
    shadows_are_hard_and_black,
    lamps_do_not_light,
    mirrors_end_at_the_depth_limit,
}

fn at(y: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(0.0, y, 0.0))
}

/// A lamp that is seen, but lights nothing in this mode.
fn lamp() -> Material {
    Material { base_color: Vec4::new(0.0, 0.0, 0.0, 1.0), emissive: Vec3::splat(0.5), ..Material::default() }
}

/// A floor seen from above, in the shadow of a smaller square or not.
fn shaded(with_blocker: bool) -> Scene {
    let mut parts = vec![(square(5.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY)];
    if with_blocker {
        parts.push((square(1.0), grey(0.8, 1.0, 0.0), at(3.0)));
    }
    scene(parts)
}

fn shadows_are_hard_and_black(engine: EngineChoice) {
    let request = params(
        r#"{"mode":"direct","max_samples":16,"lights":[{"type":"point","position":[0,6,0],"intensity":50}],
            "camera":{"position":[0,2,0.001],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":30}}"#,
    );
    assert_eq!(mean(&render(engine, work(&shaded(true), &request)), 0), 0.0);
    assert!(mean(&render(engine, work(&shaded(false), &request)), 0) > 0.1);
}

fn lamps_do_not_light(engine: EngineChoice) {
    let down = at(2.0) * DAffine3::from_quat(DQuat::from_rotation_x(std::f64::consts::PI));
    let scene = scene(vec![(square(5.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY), (square(1.0), lamp(), down)]);
    let request = params(
        r#"{"mode":"direct","max_samples":16,"lights":[{"type":"directional","direction":[0,1,0],"intensity":1}],
            "camera":{"position":[4,1,0],"target":[0,0,0],"yfov_degrees":5}}"#,
    );
    assert_eq!(mean(&render(engine, work(&scene, &request)), 0), 0.0);
}

/// Between two mirrors that face each other a lamp is seen only as deep as `max_bounces` allows.
fn mirrors_end_at_the_depth_limit(engine: EngineChoice) {
    let mirror = || grey(1.0, 0.0, 1.0);
    let facing = |z: f64, turn: f64| {
        DAffine3::from_translation(DVec3::new(0.0, 0.0, z)) * DAffine3::from_quat(DQuat::from_rotation_x(turn))
    };
    let half = std::f64::consts::FRAC_PI_2;
    // The camera looks at a mirror, which shows the lamp behind it.
    let scene = scene(vec![(square(1.0), mirror(), facing(-1.0, half)), (square(4.0), lamp(), facing(3.0, -half))]);
    let look = |max_bounces: u32| {
        let request = params(&format!(
            r#"{{"mode":"direct","max_samples":16,"max_bounces":{max_bounces},
                "lights":[{{"type":"point","position":[0,0,0],"intensity":1}}],
                "camera":{{"position":[0,0,1],"target":[0,0,-1],"yfov_degrees":10}}}}"#
        ));
        mean(&render(engine, work(&scene, &request)), 0)
    };
    assert_eq!(look(0), 0.0);
    let seen = look(1);
    assert!((seen - 0.5).abs() < 1e-3, "{seen}");
}
