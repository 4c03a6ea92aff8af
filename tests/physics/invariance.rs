//! What must not change a picture, and what must not lose it.

use crate::support::{assert_near, engines, grey, mean, params, render, scene, sphere, square, work};
use candela::film::Picture;
use candela::params::EngineChoice;
use candela::render::Engine;
use candela::scene::{Node, Scene};
use glam::{DAffine3, DQuat, DVec3};

on_both_engines! {
    same_request_same_bits,
    other_seed_other_noise,
    far_from_the_origin,
    two_levels_draw_what_one_does,
    a_million_samples_lose_nothing,
    goes_on_from_a_film,
}

/// Spheres on a floor under two lights.
fn still_life() -> Scene {
    let at = |x: f64, z: f64| {
        DAffine3::from_scale_rotation_translation(DVec3::splat(0.4), DQuat::IDENTITY, DVec3::new(x, 0.4, z))
    };
    scene(vec![
        (square(3.0), grey(0.7, 0.9, 0.0), DAffine3::IDENTITY),
        (sphere(24), grey(0.8, 0.2, 1.0), at(-0.5, 0.0)),
        (sphere(24), grey(0.3, 0.5, 0.0), at(0.5, 0.2)),
    ])
}

fn request(offset: DVec3) -> candela::params::RenderParams {
    let at = |v: DVec3| {
        let p = v + offset;
        format!("[{},{},{}]", p.x, p.y, p.z)
    };
    params(&format!(
        r#"{{"environment":{{"constant":[0.4,0.5,0.6]}},"max_samples":64,
            "lights":[{{"type":"point","position":{},"intensity":20}}],
            "camera":{{"position":{},"target":{},"yfov_degrees":40}}}}"#,
        at(DVec3::new(1.0, 3.0, 2.0)),
        at(DVec3::new(0.0, 1.5, 3.0)),
        at(DVec3::new(0.0, 0.3, 0.0))
    ))
}

fn differences(a: &Picture, b: &Picture) -> f64 {
    let differ = a.pixels.iter().zip(&b.pixels).map(|(a, b)| f64::from((a[1] - b[1]).abs()));
    differ.sum::<f64>() / a.pixels.len() as f64 / mean(a, 1)
}

fn same_request_same_bits(engine: EngineChoice) {
    let scene = still_life();
    let params = request(DVec3::ZERO);
    assert_eq!(render(engine, work(&scene, &params)).pixels, render(engine, work(&scene, &params)).pixels);
}

fn other_seed_other_noise(engine: EngineChoice) {
    let scene = still_life();
    let mut params = request(DVec3::ZERO);
    let first = render(engine, work(&scene, &params));
    params.seed = 2;
    let second = render(engine, work(&scene, &params));
    assert_ne!(first.pixels, second.pixels);
    assert_near(mean(&second, 1), mean(&first, 1), 0.01);
}

/// A scene 270 km from the origin gives the same picture, but for the last bits of its vertices.
fn far_from_the_origin(engine: EngineChoice) {
    let offset = DVec3::new(148_376.0, 1234.0, -223_423.0);
    let near = render(engine, work(&still_life(), &request(DVec3::ZERO)));
    let mut scene = still_life();
    for node in &mut scene.nodes {
        node.local = DAffine3::from_translation(offset) * node.local;
    }
    let far = render(engine, work(&scene, &request(offset)));
    let difference = differences(&near, &far);
    assert!(difference < 1e-3, "pictures differ by {difference}");
}

/// Meshes drawn once are merged; drawn again out of sight they become instances of a two-level tree.
fn two_levels_draw_what_one_does(engine: EngineChoice) {
    let one = work(&still_life(), &request(DVec3::ZERO));
    assert!(!one.scene.two_level);
    let mut scene = still_life();
    for index in 0..scene.nodes.len() {
        // Flat and far below: seen by nothing, for the floor hides it.
        let below =
            DAffine3::from_scale_rotation_translation(DVec3::splat(1e-3), DQuat::IDENTITY, DVec3::new(0.0, -0.1, 0.0));
        let copy = Node { mesh: scene.nodes[index].mesh, local: below, ..Node::default() };
        scene.scenes[0].nodes.push(scene.nodes.len());
        scene.nodes.push(copy);
    }
    let two = work(&scene, &request(DVec3::ZERO));
    assert!(two.scene.two_level);
    let difference = differences(&render(engine, one), &render(engine, two));
    assert!(difference < 0.01, "pictures differ by {difference}");
}

/// A million samples of a constant: sums in f32 alone would drift by a hundred times the tolerance.
fn a_million_samples_lose_nothing(engine: EngineChoice) {
    let scene = scene(vec![]);
    let params = params(
        r#"{"width":4,"height":4,"max_samples":1000000,"environment":{"constant":[0.7401,0.1,3.3]},
            "camera":{"position":[0,0,1],"target":[0,0,0]}}"#,
    );
    let picture = render(engine, work(&scene, &params));
    for (channel, expected) in [0.7401f32, 0.1, 3.3].into_iter().enumerate() {
        assert_near(mean(&picture, channel), f64::from(expected), 2e-6);
    }
}

/// A render goes on from the film of a lost device, to the same bits.
fn goes_on_from_a_film(engine: EngineChoice) {
    let scene = still_life();
    let params = request(DVec3::ZERO);
    let whole = render(engine, work(&scene, &params));
    let mut engines = engines();
    let mut work = work(&scene, &params);
    work.settings.engine = engine;
    let mut first = engines.begin(work.clone(), None).expect("a render");
    while first.film().samples() < 7 {
        first.step().expect("a slice");
    }
    let mut second = engines.begin(work, Some(first.into_film())).expect("a render");
    while second.step().expect("a slice").is_none() {}
    assert_eq!(second.film().picture().pixels, whole.pixels);
}
