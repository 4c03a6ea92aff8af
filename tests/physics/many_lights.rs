//! Hundreds of emitting triangles: the tree finds the light that a sum over all of them finds.

use crate::support::{
    assert_near, engines, grey, lambert, mean, params, render, scene, square, work, work_without_tree,
};
use candela::bench::agreement::{Size, compare};
use candela::params::EngineChoice;
use candela::render::Strategy;
use candela::scene::{Extended, Material, Scene};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

on_both_engines! {
    a_ceiling_of_lamps,
}

/// Numbers in [0, 1) that look random (Weyl's sequence).
fn unit(index: usize, salt: usize) -> f64 {
    (0.5 + (index as f64 + 1.0) * (2.0f64.sqrt() + salt as f64 * 3.0f64.sqrt())).fract()
}

/// Part of the hemisphere above the origin, by the cosine, that a polygon takes (Lambert 1760).
fn form_factor(corners: [DVec3; 4]) -> f64 {
    let sum: f64 = (0..4)
        .map(|i| {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            a.angle_between(b) * a.cross(b).normalize().y
        })
        .sum();
    sum.abs() / (2.0 * PI)
}

/// Lamps in a plane hide nothing from one another: the light below is a sum over Lambert's formula.
fn a_ceiling_of_lamps(engine: EngineChoice) {
    let (height, albedo) = (0.5, 0.6);
    let mut parts = vec![(square(6.0), grey(albedo as f32, 1.0, 0.0), DAffine3::IDENTITY)];
    let mut expected = 0.0;
    for i in 0..256 {
        let (half, radiance) = (0.02 + 0.1 * unit(i, 0), 10f64.powf(3.0 * unit(i, 1)));
        let place = DVec3::new((i % 16) as f64 * 0.3 - 2.2, height, (i / 16) as f64 * 0.3 - 2.3);
        let lamp = Material { emissive: Vec3::splat(radiance as f32), ..grey(0.0, 1.0, 0.0) };
        parts.push((square(half as f32), lamp, DAffine3::from_translation(place) * DAffine3::from_rotation_x(PI)));
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, z]| place + DVec3::new(x, 0.0, z) * f64::from(half as f32));
        expected += albedo * radiance * form_factor(corners);
    }
    let params = params(
        r#"{"max_bounces":1,"max_samples":1024,"width":16,"height":16,
            "camera":{"position":[5,0.2,0],"target":[0,0,0],"yfov_degrees":0.02}}"#,
    );
    let both = lambert(work(&scene(parts.clone()), &params));
    assert!(both.features.light_tree);
    let mut sampled = both.clone();
    sampled.settings.strategy = Strategy { scattered_light: false, ..Strategy::default() };
    for work in [both, sampled] {
        let got = mean(&render(engine, work), 0);
        eprintln!("{engine:?}: {got:.4} for {expected:.4}");
        assert_near(got, expected, 3e-3);
    }
}

/// Lamps that look everywhere around a glossy floor, a wall of matte glass and a lens of them drawn twice; under a sun.
fn hall() -> Scene {
    let mut parts = vec![(square(4.0), grey(0.6, 0.4, 0.1), DAffine3::IDENTITY)];
    for i in 0..120 {
        let place = DVec3::new(6.0 * unit(i, 2) - 3.0, 0.3 + 1.5 * unit(i, 3), 6.0 * unit(i, 4) - 3.0);
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 6.0 * unit(i, 5), 6.0 * unit(i, 6), 0.0);
        let emissive = Vec3::new(1.0, 0.7, 0.4) * 10f32.powf(2.0 * unit(i, 7) as f32);
        let lamp = Material { emissive, double_sided: i % 3 == 0, ..grey(0.3, 1.0, 0.0) };
        parts.push((square(0.05 + 0.1 * unit(i, 8) as f32), lamp, DAffine3::from_rotation_translation(turn, place)));
    }
    let frosted = Extended { transmission: 0.8, ..Extended::default() };
    let wall = Material { extended: Some(Arc::new(frosted)), double_sided: true, ..grey(0.9, 0.5, 0.0) };
    parts.push((square(1.0), wall, DAffine3::from_translation(DVec3::Y) * DAffine3::from_rotation_x(1.4)));
    let mut scene = scene(parts);
    let mut twin = scene.nodes[7].clone();
    twin.local = DAffine3::from_scale(DVec3::new(-2.0, 1.0, 1.0)) * twin.local;
    scene.scenes[0].nodes.push(scene.nodes.len());
    scene.nodes.push(twin);
    scene
}

/// The tree on either device against the table of the other.
#[test]
fn tree_and_table_agree() {
    let params = params(
        r#"{"width":16,"height":16,"max_samples":64,"max_bounces":4,
            "lights":[{"type":"directional","direction":[-1,-2,-1],"angular_diameter_degrees":5,"intensity":3}],
            "camera":{"position":[0.5,3,6],"target":[0,0.6,0],"yfov_degrees":40}}"#,
    );
    let scene = hall();
    let size = Size { side: 16, samples: 64, batches: 8 };
    for (tree, table) in [(EngineChoice::Gpu, EngineChoice::Cpu), (EngineChoice::Cpu, EngineChoice::Gpu)] {
        let [mut with, mut without] = [work(&scene, &params), work_without_tree(&scene, &params)];
        assert!(with.features.light_tree && !without.features.light_tree);
        (with.settings.engine, without.settings.engine) = (tree, table);
        let verdict = compare(&mut engines(), [with, without], size).expect("two renders");
        eprintln!("{tree:?} with the tree, {table:?} without: {verdict:?}");
        assert!(verdict.agrees(), "{verdict:?}");
    }
}
