//! Light scattered inside bodies, against closed form, numerical integrals and between the engines.

use crate::support::{assert_near, engines, grey, mean, params, render, scene, slab, sphere, square, work};
use candela::bench::agreement::{Size, Verdict, compare};
use candela::params::EngineChoice;
use candela::render::{Strategy, Work};
use candela::scene::{Extended, Material, Scatter, Scene, Volume};
use glam::{DAffine3, DVec3, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

on_both_engines! {
    bodies_that_scatter_all_light_vanish_in_a_white_sky,
    what_scatters_nothing_absorbs_by_beer_and_lambert,
    thick_bodies_reflect_as_chandrasekhar_says,
    a_lamp_in_fog_by_single_scattering,
    lamps_in_fog_are_found_once,
}

/// A body of these particles, of which white light is left by `color` after a unit of length.
fn filled(ior: f32, color: Vec3, scatter: Scatter) -> Extended {
    let volume = Volume { attenuation_color: color, attenuation_distance: 1.0 };
    Extended { transmission: 1.0, ior, volume: Some(volume), scatter: Some(scatter), ..Extended::default() }
}

fn of(extended: Extended, roughness: f32) -> Material {
    Material { extended: Some(Arc::new(extended)), ..grey(1.0, roughness, 0.0) }
}

fn white(anisotropy: f32) -> Scatter {
    Scatter { albedo: Vec3::ONE, anisotropy }
}

fn in_a_white_sky(material: Material, samples: u32) -> Work {
    let request = params(&format!(
        r#"{{"environment":{{"constant":[1,1,1]}},"max_samples":{samples},"width":16,"height":16,
            "camera":{{"position":[0,0,4],"target":[0,0,0],"yfov_degrees":20}}}}"#
    ));
    work(&scene(vec![(sphere(64), material, DAffine3::IDENTITY)]), &request)
}

/// No light is lost, whatever the colours' extinctions are and however it is scattered. Where these differ, a path ends up with
/// one colour, of three times the weight: that is noise, of which a ball of grey has none.
fn bodies_that_scatter_all_light_vanish_in_a_white_sky(engine: EngineChoice) {
    let (grey, colors) = (Vec3::splat(0.1), Vec3::new(0.5, 0.1, 0.01));
    let diffuse = Extended { transmission: 0.0, diffuse_transmission: 1.0, ..filled(1.5, grey, white(0.3)) };
    let mut cases = vec![
        ("smooth", filled(1.5, grey, white(0.0)), 0.0, 4e-3),
        ("coloured", filled(1.5, colors, white(0.0)), 0.0, 2e-2),
        ("behind a diffuse surface", diffuse, 0.5, 1e-2),
    ];
    for g in [-0.7, 0.0, 0.9] {
        cases.push(("index 1", filled(1.0, grey, white(g)), 0.0, 4e-3));
    }
    for (name, extended, roughness, tolerance) in cases {
        let work = in_a_white_sky(of(extended, roughness), 256);
        assert!(work.features.scatter);
        let picture = render(engine, work);
        for channel in 0..3 {
            let got = mean(&picture, channel);
            eprintln!("{engine:?}, {name}, channel {channel}: {got:.5}");
            assert!((got - 1.0).abs() <= tolerance, "{name}, channel {channel}: {got} for 1, tolerance {tolerance}");
        }
    }
}

/// Particles that scatter no light leave the colours of KHR_materials_volume alone.
fn what_scatters_nothing_absorbs_by_beer_and_lambert(engine: EngineChoice) {
    let lamp = Material { emissive: Vec3::ONE, ..grey(0.0, 1.0, 0.0) };
    let lamp = Material { extended: Some(Arc::new(Extended { specular: 0.0, ..Extended::default() })), ..lamp };
    let color = Vec3::new(0.0625, 0.25, 1.0);
    // All but one colour are absorbed, or all are: with and without the code for scattering.
    for albedo in [Vec3::ZERO, Vec3::new(0.0, 0.0, 0.5)] {
        let body = filled(1.0, color, Scatter { albedo, anisotropy: 0.0 });
        let scene = scene(vec![
            (slab(100.0, 0.0, 1.0), of(body, 0.0), DAffine3::IDENTITY),
            (square(200.0), lamp.clone(), DAffine3::from_translation(DVec3::Y * -2.0)),
        ]);
        let request = params(
            r#"{"max_samples":1024,"width":8,"height":8,"camera":{"position":[0,50,0],"target":[0,0,0],"up":[0,0,-1],
                "yfov_degrees":0.05}}"#,
        );
        let work = work(&scene, &request);
        assert_eq!(work.features.scatter, albedo != Vec3::ZERO);
        let picture = render(engine, work);
        for (channel, expected) in [(0, 0.0625), (1, 0.25), (2, 1.0)] {
            let got = mean(&picture, channel);
            eprintln!("{engine:?}, channel {channel}: {got:.5} for {expected}");
            assert_near(got, expected, 6e-3);
        }
    }
}

/// Chandrasekhar's H function of isotropic scattering (Radiative Transfer, 1960, chapter 5), by iteration.
fn h_function(albedo: f64) -> impl Fn(f64) -> f64 {
    const NODES: usize = 400;
    let node = |i: usize| (i as f64 + 0.5) / NODES as f64;
    let root = (1.0 - albedo).sqrt();
    let next = move |h: &[f64], mu: f64| {
        let sum: f64 = h.iter().enumerate().map(|(i, h)| node(i) * h / (mu + node(i))).sum();
        1.0 / (root + 0.5 * albedo * sum / NODES as f64)
    };
    let mut h = vec![1.0; NODES];
    for _ in 0..400 {
        h = (0..NODES).map(|i| next(&h, node(i))).collect();
    }
    move |mu| next(&h, mu)
}

/// Half a space of matched index under a white sky: `1 - H(mu) sqrt(1 - albedo)`, for three colours at once.
fn thick_bodies_reflect_as_chandrasekhar_says(engine: EngineChoice) {
    let albedo = Vec3::new(0.5, 0.8, 0.95);
    let volume = Volume { attenuation_color: Vec3::new(1e-8, 1e-6, 1e-4), attenuation_distance: 0.2 };
    let body = Extended { volume: Some(volume), ..filled(1.0, Vec3::ONE, Scatter { albedo, anisotropy: 0.0 }) };
    let scene = scene(vec![(slab(200.0, -2.0, 0.0), of(body, 0.0), DAffine3::IDENTITY)]);
    for degrees in [0.0f64, 60.0] {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let request = params(&format!(
            r#"{{"environment":{{"constant":[1,1,1]}},"max_samples":512,"width":16,"height":16,
                "camera":{{"position":[{},{},0],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":0.05}}}}"#,
            50.0 * sine,
            50.0 * cosine
        ));
        let picture = render(engine, work(&scene, &request));
        for (channel, albedo) in albedo.to_array().into_iter().enumerate() {
            let albedo = f64::from(albedo);
            let expected = 1.0 - h_function(albedo)(cosine) * (1.0 - albedo).sqrt();
            let got = mean(&picture, channel);
            eprintln!("{engine:?}, {degrees} degrees, albedo {albedo}: {got:.5} for {expected:.5}");
            assert_near(got, expected, 0.015);
        }
    }
}

/// The camera and a point light stand in fog: an integral along the view, each colour with its own extinction.
fn a_lamp_in_fog_by_single_scattering(engine: EngineChoice) {
    let color = Vec3::new(0.8, 0.5, 0.2);
    let scatter = Scatter { albedo: Vec3::new(0.9, 0.6, 0.3), anisotropy: 0.5 };
    let fog = of(filled(1.0, color, scatter), 0.0);
    let scene = scene(vec![(slab(40.0, -40.0, 40.0), fog, DAffine3::IDENTITY)]);
    let request = params(
        r#"{"max_samples":4096,"max_bounces":1,"width":8,"height":8,"camera":{"position":[0,0,0],"target":[0,0,-1],"yfov_degrees":0.05},
            "lights":[{"type":"point","position":[0.7,0,-1.5],"color":[1,1,1],"intensity":1}]}"#,
    );
    let picture = render(engine, work(&scene, &request));
    for channel in 0..3 {
        let sigma = -f64::from(color[channel]).ln();
        let (albedo, g) = (f64::from(scatter.albedo[channel]), f64::from(scatter.anisotropy));
        let steps = 200_000;
        let at = |i: usize| {
            let t = 40.0 * (i as f64 + 0.5) / f64::from(steps);
            let (to, view) = (DVec3::new(0.7, 0.0, -1.5 + t), DVec3::NEG_Z);
            let distance = to.length();
            // Light flies from the lamp, and on along the view towards the camera.
            let cosine = (to / distance).dot(view);
            let phase = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5));
            sigma * albedo * phase * (-sigma * (t + distance)).exp() / (distance * distance)
        };
        let expected = (0..steps as usize).map(at).sum::<f64>() * 40.0 / f64::from(steps);
        let got = mean(&picture, channel);
        eprintln!("{engine:?}, channel {channel}: {got:.6} for {expected:.6}");
        assert_near(got, expected, 0.02);
    }
}

/// A lamp, a floor and a ball within fog.
fn fogged() -> Scene {
    let scatter = Scatter { albedo: Vec3::new(0.95, 0.9, 0.6), anisotropy: 0.4 };
    let fog = of(filled(1.0, Vec3::new(0.7, 0.6, 0.5), scatter), 0.0);
    let lamp = Material { emissive: Vec3::splat(2.0), ..grey(0.0, 1.0, 0.0) };
    scene(vec![
        (slab(6.0, -0.5, 5.0), fog, DAffine3::IDENTITY),
        (square(3.0), grey(0.7, 0.5, 0.0), DAffine3::IDENTITY),
        (square(1.5), lamp, DAffine3::from_translation(DVec3::Y * 2.0) * DAffine3::from_rotation_x(PI)),
        (
            sphere(8),
            grey(0.8, 0.3, 1.0),
            DAffine3::from_scale_rotation_translation(
                DVec3::splat(0.5),
                glam::DQuat::IDENTITY,
                DVec3::new(0.6, 0.5, 0.3),
            ),
        ),
    ])
}

/// By light samples, by scattered rays and by both: all find the same.
fn lamps_in_fog_are_found_once(engine: EngineChoice) {
    let request = params(
        r#"{"max_samples":2048,"max_bounces":6,"width":8,"height":8,
            "camera":{"position":[0,1,9],"target":[0,1,0],"yfov_degrees":25}}"#,
    );
    let means = [[true, true], [true, false], [false, true]].map(|[light_samples, scattered_light]| {
        let mut work = work(&fogged(), &request);
        work.settings.strategy = Strategy { light_samples, scattered_light, ..Strategy::default() };
        mean(&render(engine, work), 1)
    });
    eprintln!("{engine:?}: {means:?}");
    // Samples of the lamp alone have no finite variance in the fog next to it.
    assert_near(means[1], means[0], 0.1);
    assert_near(means[2], means[0], 0.04);
}

/// A ball of milk over a floor, in fog, under a sky, a lamp and a light behind them all, by both engines: with the same anisotropy or
/// not.
fn compared(shaders: f32, f64_engine: f32) -> Verdict {
    let request = params(
        r#"{"max_samples":64,"max_bounces":24,"adaptive":false,"width":16,"height":16,
            "camera":{"position":[0,1,9],"target":[0.3,0.7,0],"yfov_degrees":20},
            "environment":{"constant":[0.5,0.7,1]},
            "lights":[{"type":"sphere","position":[-1,1,1],"radius":0.2,"intensity":2},
                {"type":"point","position":[0.3,1,-2],"intensity":2}]}"#,
    );
    let with = |engine, anisotropy| {
        let mut parts = fogged();
        let scatter = Scatter { albedo: Vec3::new(0.99, 0.97, 0.9), anisotropy };
        parts.materials[0] = of(filled(1.0, Vec3::new(0.7, 0.6, 0.5), scatter), 0.0);
        parts.materials[3] = of(filled(1.33, Vec3::new(0.01, 0.03, 0.1), scatter), 0.2);
        let mut work = work(&parts, &request);
        work.settings.engine = engine;
        work
    };
    let works = [with(EngineChoice::Gpu, shaders), with(EngineChoice::Cpu, f64_engine)];
    let verdict = compare(&mut engines(), works, Size { side: 16, samples: 64, batches: 12 }).expect("two engines");
    eprintln!("{shaders} and {f64_engine}: {verdict:?}");
    verdict
}

#[test]
fn both_engines_scatter_alike() {
    assert!(compared(0.7, 0.7).agrees());
}

/// What shows that the comparison would find a fault.
#[test]
fn particles_that_scatter_backwards_are_told_apart() {
    assert!(!compared(0.7, -0.7).agrees());
}
