//! Extensions of materials in scenes whose radiance is known.

use crate::support::{assert_near, grey, mean, params, render, scene, slab, sphere, square, work};
use candela::params::{EngineChoice, RenderParams};
use candela::render::Work;
use candela::scene::{Extended, Material, Primitive, Scene, Volume};
use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;

on_both_engines! {
    lossless_materials_vanish_in_a_white_sky,
    lossy_materials_stay_below_one,
    without_its_reflection_a_dielectric_is_lamberts,
    index_of_one_is_invisible,
    slabs_transmit_by_fresnels_series,
    slabs_absorb_by_beer_and_lambert,
    liquids_in_glass_follow_the_same_series,
    light_falls_straight_through_thin_walls,
    lamps_behind_thin_walls_are_found_once,
    light_samples_reach_through_rough_glass,
    a_coat_darkens_what_is_below,
}

fn with(extended: Extended, roughness: f32, color: f32) -> Material {
    Material { extended: Some(Arc::new(extended)), ..grey(color, roughness, 0.0) }
}

fn clear() -> Option<Volume> {
    Some(Volume { attenuation_color: Vec3::ONE, attenuation_distance: f32::INFINITY })
}

fn glass(roughness: f32) -> Material {
    with(Extended { transmission: 1.0, volume: clear(), ..Extended::default() }, roughness, 1.0)
}

fn thin(roughness: f32) -> Material {
    with(Extended { transmission: 1.0, ..Extended::default() }, roughness, 1.0)
}

fn ball(material: Material) -> Scene {
    scene(vec![(sphere(64), material, DAffine3::IDENTITY)])
}

/// A ball alone in a white sky, which covers the picture.
fn in_a_white_sky(material: Material) -> Work {
    let request = params(
        r#"{"environment":{"constant":[1,1,1]},"max_samples":256,"width":16,"height":16,
            "camera":{"position":[0,0,4],"target":[0,0,0],"yfov_degrees":20}}"#,
    );
    work(&ball(material), &request)
}

/// Mean of the middle channel of a ball in a white sky.
fn furnace(engine: EngineChoice, material: Material) -> f64 {
    mean(&render(engine, in_a_white_sky(material)), 1)
}

/// What neither absorbs nor is left unfinished by its formulas returns all light.
fn lossless_materials_vanish_in_a_white_sky(engine: EngineChoice) {
    let base = Extended::default;
    let mut cases = vec![
        ("smooth glass", glass(0.0), 1e-3),
        ("smooth wall", thin(0.0), 1e-3),
        ("rough wall", thin(0.5), 4e-3),
        ("index 2.4", with(Extended { ior: 2.4, ..base() }, 0.3, 1.0), 2e-3),
        ("no reflection", with(Extended { specular: 0.0, ..base() }, 0.3, 1.0), 2e-3),
        ("infinite index", with(Extended { ior: 0.0, ..base() }, 0.3, 1.0), 4e-3),
        ("coat", with(Extended { clearcoat: 1.0, clearcoat_roughness: 0.3, ..base() }, 0.6, 1.0), 4e-3),
        ("smooth coat", with(Extended { clearcoat: 0.7, ..base() }, 0.6, 1.0), 2e-3),
        ("sheen", with(Extended { sheen_color: Vec3::ONE, sheen_roughness: 0.5, ..base() }, 0.6, 1.0), 1e-2),
        ("passing diffusely", with(Extended { diffuse_transmission: 0.6, ..base() }, 0.4, 1.0), 4e-3),
        ("half a wall", with(Extended { transmission: 0.5, ..base() }, 0.0, 1.0), 2e-3),
        (
            "dispersion",
            with(Extended { transmission: 1.0, volume: clear(), dispersion: 5.0, ..base() }, 0.0, 1.0),
            5e-2,
        ),
    ];
    for roughness in [0.2, 0.5, 0.9] {
        cases.push(("rough glass", glass(roughness), 1.5e-2));
    }
    for (name, material, tolerance) in cases {
        let roughness = material.roughness;
        let got = furnace(engine, material);
        eprintln!("{name}, roughness {roughness}: {got:.5}");
        assert!((got - 1.0).abs() <= tolerance, "{name}, roughness {roughness}: {got} for 1, tolerance {tolerance}");
    }
}

/// What absorbs, or is only about energy conserving, must not make light.
fn lossy_materials_stay_below_one(engine: EngineChoice) {
    let base = Extended::default;
    let cases = [
        ("grain", with(Extended { anisotropy: 0.8, ..base() }, 0.3, 1.0), 0.93),
        (
            "grain of a metal",
            Material { metallic: 1.0, ..with(Extended { anisotropy: 0.8, ..base() }, 0.3, 1.0) },
            0.93,
        ),
        ("film", with(Extended { iridescence: 1.0, ..base() }, 0.3, 1.0), 0.7),
        ("coloured reflection", with(Extended { specular_color: Vec3::new(1.0, 0.2, 2.0), ..base() }, 0.3, 1.0), 0.9),
    ];
    for (name, material, least) in cases {
        let got = furnace(engine, material);
        eprintln!("{name}: {got:.5}");
        assert!((least..1.01).contains(&got), "{name}: {got}");
    }
}

/// Such a scene is traced without any interface, and looks as if it were traced with all that there is.
fn without_its_reflection_a_dielectric_is_lamberts(engine: EngineChoice) {
    let work = in_a_white_sky(with(Extended { specular: 0.0, ..Extended::default() }, 0.3, 0.5));
    assert!(!work.features.specular);
    let mut whole = work.clone();
    whole.features.specular = true;
    for work in [work, whole] {
        assert_near(mean(&render(engine, work), 1), 0.5, 2e-3);
    }
}

/// A body of index 1 does nothing, and hides nothing.
fn index_of_one_is_invisible(engine: EngineChoice) {
    let request = params(
        r#"{"environment":{"gradient":{"top":[1,0.2,0],"horizon":[0.5,0.5,0.5],"bottom":[0,0.1,1]}},"max_samples":16,
            "adaptive":false,"camera":{"position":[0,0,4],"target":[0,0,0],"yfov_degrees":40}}"#,
    );
    for (roughness, transmission) in [(0.0, 1.0), (0.5, 1.0)] {
        let extended = Extended { ior: 1.0, transmission, volume: clear(), ..Extended::default() };
        let there = render(engine, work(&ball(with(extended, roughness, 1.0)), &request));
        let tiny = scene(vec![(square(1e-3), grey(0.0, 1.0, 0.0), DAffine3::from_translation(DVec3::Y * -50.0))]);
        let gone = render(engine, work(&tiny, &request));
        for (a, b) in there.pixels.iter().zip(&gone.pixels) {
            for channel in 0..3 {
                // Both look at the same sky, with other framing of the scene's origin alone.
                assert!((a[channel] - b[channel]).abs() < 2e-3, "{a:?} for {b:?}, roughness {roughness}");
            }
        }
    }
}

/// A lamp that fills what is seen through a slab, with nothing but black above.
fn over_a_lamp(layers: Vec<(Primitive, Material, DAffine3)>) -> Scene {
    let lamp = Material { emissive: Vec3::ONE, ..grey(0.0, 1.0, 0.0) };
    let lamp = Material { extended: Some(Arc::new(Extended { specular: 0.0, ..Extended::default() })), ..lamp };
    let mut parts = layers;
    parts.push((square(200.0), lamp, DAffine3::from_translation(DVec3::Y * -2.0)));
    scene(parts)
}

/// Parallel rays that come down at an angle from the vertical.
fn down(degrees: f64, samples: u32) -> RenderParams {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    params(&format!(
        r#"{{"max_samples":{samples},"width":8,"height":8,"camera":{{"position":[{},{},0],"target":[0,0,0],
            "up":[0,0,-1],"yfov_degrees":0.05}}}}"#,
        50.0 * sine,
        50.0 * cosine
    ))
}

/// Of unpolarised light, as its two parts.
fn fresnel(degrees: f64, from: f64, to: f64) -> [f64; 2] {
    let cosine = degrees.to_radians().cos();
    let sine = degrees.to_radians().sin() * from / to;
    let beyond = (1.0 - sine * sine).sqrt();
    let across = ((from * cosine - to * beyond) / (from * cosine + to * beyond)).powi(2);
    let along = ((to * cosine - from * beyond) / (to * cosine + from * beyond)).powi(2);
    [across, along]
}

/// T^2 / (1 - R^2), the sum over all reflections within, with reflectance averaged over polarisations at each surface, as
/// renderers do.
fn slabs_transmit_by_fresnels_series(engine: EngineChoice) {
    for degrees in [0.0, 40.0, 60.0] {
        let [across, along] = fresnel(degrees, 1.0, 1.5);
        let r = 0.5 * (across + along);
        let expected = (1.0 - r) * (1.0 - r) / (1.0 - r * r);
        let scene = over_a_lamp(vec![(slab(100.0, 0.0, 0.1), glass(0.0), DAffine3::IDENTITY)]);
        let got = mean(&render(engine, work(&scene, &down(degrees, 2048))), 1);
        eprintln!("{degrees} degrees: {got:.5} for {expected:.5}");
        assert_near(got, expected, 4e-3);
    }
}

fn slabs_absorb_by_beer_and_lambert(engine: EngineChoice) {
    let volume = Volume { attenuation_color: Vec3::new(0.25, 0.5, 1.0), attenuation_distance: 0.5 };
    let extended = Extended { transmission: 1.0, volume: Some(volume), ..Extended::default() };
    let scene = over_a_lamp(vec![(slab(100.0, 0.0, 1.0), with(extended, 0.0, 1.0), DAffine3::IDENTITY)]);
    let picture = render(engine, work(&scene, &down(0.0, 2048)));
    let r: f64 = 0.04;
    for (channel, part) in [(0, 0.0625), (1, 0.25), (2, 1.0)] {
        let expected = (1.0 - r).powi(2) * part / (1.0 - (r * part).powi(2));
        assert_near(mean(&picture, channel), expected, 4e-3);
    }
}

/// Water that reaches into its glass: three surfaces, air to glass, glass to water, water to air.
fn liquids_in_glass_follow_the_same_series(engine: EngineChoice) {
    let water = with(Extended { ior: 1.33, transmission: 1.0, volume: clear(), ..Extended::default() }, 0.0, 1.0);
    let scene = over_a_lamp(vec![
        (slab(100.0, 0.5, 1.0), glass(0.0), DAffine3::IDENTITY),
        (slab(99.0, 0.0, 0.75), water, DAffine3::IDENTITY),
    ]);
    let got = mean(&render(engine, work(&scene, &down(0.0, 4096))), 1);
    let reflectance = |a: f64, b: f64| ((a - b) / (a + b)).powi(2);
    // Two layers together: R = R1 + T1^2 R2 / (1 - R1 R2), T = T1 T2 / (1 - R1 R2).
    let stack = |a: [f64; 2], b: f64| {
        let [r, t] = a;
        let bounce = 1.0 - r * b;
        [b + (1.0 - b).powi(2) * r / bounce, t * (1.0 - b) / bounce]
    };
    let first = reflectance(1.0, 1.33);
    let expected = stack(stack([first, 1.0 - first], reflectance(1.33, 1.5)), reflectance(1.5, 1.0))[1];
    assert_near(got, expected, 4e-3);
}

/// A point light above a thin wall above a floor: the floor is as bright as without, times what the wall lets pass.
fn light_falls_straight_through_thin_walls(engine: EngineChoice) {
    let request = params(
        r#"{"max_samples":64,"max_bounces":1,"width":8,"height":8,"lights":[{"type":"point","position":[0,4,0],"intensity":50}],
            "camera":{"position":[0,1,0.0001],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":2}}"#,
    );
    let floor = || (square(5.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY);
    let wall = |material| (square(3.0), material, DAffine3::from_translation(DVec3::Y * 2.0));
    let bare = mean(&render(engine, work(&scene(vec![floor()]), &request)), 1);
    let colored =
        Material { double_sided: true, ..with(Extended { transmission: 1.0, ..Extended::default() }, 0.0, 0.5) };
    let got = mean(&render(engine, work(&scene(vec![floor(), wall(colored)]), &request)), 1);
    assert_near(got, bare * 0.96 * 0.5, 2e-3);
    let rough = mean(&render(engine, work(&scene(vec![floor(), wall(thin(0.3))]), &request)), 1);
    assert_eq!(rough, 0.0, "a rough wall scatters: no straight light");
}

/// A lamp behind a wall is found by light samples and by scattered rays, and together they count it once.
fn lamps_behind_thin_walls_are_found_once(engine: EngineChoice) {
    let request = |strategy: &str| {
        let mut request = work(
            &scene(vec![
                (square(5.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY),
                (
                    square(20.0),
                    Material { double_sided: true, ..thin(0.0) },
                    DAffine3::from_translation(DVec3::Y * 2.0),
                ),
                (
                    square(1.0),
                    Material { emissive: Vec3::splat(5.0), double_sided: true, ..grey(0.0, 1.0, 0.0) },
                    DAffine3::from_translation(DVec3::Y * 3.0),
                ),
            ]),
            &params(
                r#"{"max_samples":4096,"width":8,"height":8,"adaptive":false,
                    "camera":{"position":[0,1,0.0001],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":2}}"#,
            ),
        );
        request.settings.strategy.light_samples = strategy != "scattered";
        request.settings.strategy.scattered_light = strategy != "sampled";
        request
    };
    let both = mean(&render(engine, request("both")), 1);
    for strategy in ["scattered", "sampled"] {
        // Light samples alone leave out what comes back from below the wall by its mirror image, a few per cent of the whole.
        let alone = mean(&render(engine, request(strategy)), 1);
        eprintln!("{strategy}: {alone:.5}, both {both:.5}");
        assert_near(alone, both, 1e-2);
    }
}

/// A lamp behind a slab of rough glass: by light samples at the rough exit and by scattered rays alone.
fn light_samples_reach_through_rough_glass(engine: EngineChoice) {
    let lamp = Material { emissive: Vec3::splat(5.0), double_sided: true, ..grey(0.0, 1.0, 0.0) };
    let scene = scene(vec![
        (slab(5.0, 0.0, 0.5), glass(0.5), DAffine3::IDENTITY),
        (square(1.0), lamp, DAffine3::from_translation(DVec3::Y * -1.0)),
    ]);
    let request = params(
        r#"{"max_samples":4096,"width":8,"height":8,"adaptive":false,
            "camera":{"position":[0,3,0.0001],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":4}}"#,
    );
    let mut both = work(&scene, &request);
    both.settings.seed = 3;
    let mut scattered = work(&scene, &request);
    scattered.settings.strategy.light_samples = false;
    let (both, scattered) = (mean(&render(engine, both), 1), mean(&render(engine, scattered), 1));
    eprintln!("both {both:.5}, scattered {scattered:.5}");
    assert_near(both, scattered, 1e-2);
}

/// A black floor under a coat shows the coat's reflection alone, and its lamp through the coat.
fn a_coat_darkens_what_is_below(engine: EngineChoice) {
    let black = |coat| with(Extended { specular: 0.0, clearcoat: coat, ..Extended::default() }, 1.0, 0.0);
    let request = params(
        r#"{"environment":{"constant":[1,1,1]},"max_samples":64,"width":8,"height":8,
            "camera":{"position":[0,3,0.0001],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":2}}"#,
    );
    let floor = |material| scene(vec![(square(5.0), material, DAffine3::IDENTITY)]);
    assert_near(mean(&render(engine, work(&floor(black(1.0)), &request)), 1), 0.04, 1e-2);
    assert_near(mean(&render(engine, work(&floor(black(0.5)), &request)), 1), 0.02, 1e-2);
    let shining = Material { emissive: Vec3::ONE, ..black(1.0) };
    let shining = mean(&render(engine, work(&floor(shining), &request)), 1);
    assert_near(shining, 0.04 + 0.96, 1e-2);
}
