//! Suns, balls, disks and rectangles of the request: what they light in closed form, however they are found.

use crate::support::{assert_near, engines, grey, lambert, mean, params, render, scene, square, work};
use candela::bench::agreement::{Size, compare};
use candela::params::EngineChoice;
use candela::render::{Strategy, Work};
use candela::scene::{Extended, Material, Scene};
use glam::{DAffine3, DVec3, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

on_both_engines! {
    form_factors,
    all_ways_find_the_same,
    cameras_see_what_is_visible,
    mirrors_see_all,
    direct_mode_takes_points,
    blades_shape_what_is_out_of_focus,
}

/// Reflectance of the floor.
const ALBEDO: f64 = 0.6;
/// Radiance of the lights.
const RADIANCE: f64 = 7.0;

/// A floor of which the camera sees next to the origin alone, lit once.
fn floor_under(light: &str, rest: &str) -> Work {
    let floor = scene(vec![(square(10.0), grey(ALBEDO as f32, 1.0, 0.0), DAffine3::IDENTITY)]);
    let json = format!(
        r#"{{"max_bounces":1,"max_samples":1024,"width":16,"height":16,"lights":[{light}],
            "camera":{{"position":[6,1,0],"target":[0,0,0],"yfov_degrees":0.1}}{rest}}}"#
    );
    lambert(work(&floor, &params(&json)))
}

/// Part of the hemisphere, by the cosine, that a rectangle of corner (0, 0) and these sides at height 1 takes.
fn corner_factor(x: f64, y: f64) -> f64 {
    let (a, b) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    (x / a * (y / a).atan() + y / b * (x / b).atan()) / (2.0 * PI)
}

/// Light, and the radiance of the floor below it.
fn cases() -> Vec<(&'static str, f64)> {
    let radiance = |factor: f64| ALBEDO * RADIANCE * factor;
    let rect = 4.0 * corner_factor(1.0 / 1.5, 0.4 / 1.5);
    // Above the corner at (0, 0): what lies between the larger and the smaller rectangle.
    let aside = corner_factor(3.0, 1.0) - corner_factor(1.0, 1.0);
    vec![
        (
            r#"{"type":"rect","position":[0,1.5,0],"direction":[0,-1,0],"up":[0,0,1],"width":2,"height":0.8,"intensity":7}"#,
            radiance(rect),
        ),
        (
            r#"{"type":"rect","position":[2,1,0.5],"direction":[0,-2,0],"up":[3,0,0],"width":1,"height":2,"intensity":7}"#,
            radiance(aside),
        ),
        (
            r#"{"type":"disk","position":[0,2,0],"direction":[0,-1,0],"radius":1.5,"intensity":7}"#,
            radiance(1.5 * 1.5 / (2.0 * 2.0 + 1.5 * 1.5)),
        ),
        (
            r#"{"type":"sphere","position":[-1,1.5,0.5],"radius":0.8,"intensity":7}"#,
            radiance(0.64 / 3.5 * 1.5 / 3.5f64.sqrt()),
        ),
        (r#"{"type":"sphere","position":[0,1,0],"radius":0.9,"intensity":7}"#, radiance(0.81)),
        (
            r#"{"type":"directional","direction":[0.6,-0.8,0],"angular_diameter_degrees":60,"intensity":7}"#,
            radiance(0.8 / PI),
        ),
        (
            r#"{"type":"directional","direction":[-0.6,-0.8,0],"angular_diameter_degrees":0.53,"intensity":7}"#,
            radiance(0.8 / PI),
        ),
    ]
}

/// A floor point's share of each light's shape is known (Howell, "A Catalog of Radiation Heat Transfer Configuration Factors").
fn form_factors(engine: EngineChoice) {
    for (light, expected) in cases() {
        let got = mean(&render(engine, floor_under(light, "")), 0);
        eprintln!("{engine:?}: {got:.5} for {expected:.5}: {light}");
        assert_near(got, expected, 3e-3);
    }
}

/// Light samples alone, scattered rays alone, and both weighted.
fn all_ways_find_the_same(engine: EngineChoice) {
    for (light, expected) in cases() {
        // What is small is hardly ever met by chance.
        let is_small = light.contains("0.53");
        for (light_samples, scattered_light) in [(true, false), (false, true)] {
            if is_small && scattered_light {
                continue;
            }
            let mut work = floor_under(light, "");
            work.settings.strategy = Strategy { light_samples, scattered_light, ..Strategy::default() };
            let got = mean(&render(engine, work), 0);
            assert_near(got, expected, if light_samples { 5e-3 } else { 2e-2 });
        }
    }
}

/// Radiance and alpha of a picture that a light fills.
fn looked_at(engine: EngineChoice, light: &str, direction: [f64; 3]) -> [f64; 2] {
    let floor = scene(vec![(square(10.0), grey(0.5, 1.0, 0.0), DAffine3::IDENTITY)]);
    let [x, y, z] = direction.map(|d| 5.0 * d);
    let json = format!(
        r#"{{"max_bounces":0,"max_samples":4,"width":8,"height":8,"lights":[{light}],"output":{{"transparent":true}},
            "camera":{{"position":[0,1,0],"target":[{x},{},{z}],"yfov_degrees":0.1}}}}"#,
        1.0 + y
    );
    let picture = render(engine, work(&floor, &params(&json)));
    [mean(&picture, 0), mean(&picture, 3)]
}

/// The camera sees a light's radiance, from its bright side, unless it is told not to.
fn cameras_see_what_is_visible(engine: EngineChoice) {
    let away = [0.0, 0.6, -0.8];
    // Lux over pi sin^2 of half a degree.
    let sun = 3.0 / (PI * 0.5f64.to_radians().sin().powi(2));
    for (light, radiance) in [
        (r#""type":"rect","position":[0,4,-4],"direction":[0,-1,1]"#, 3.0),
        (r#""type":"disk","position":[0,4,-4],"direction":[0,-1,1]"#, 3.0),
        (r#""type":"sphere","position":[0,4,-4]"#, 3.0),
        (r#""type":"directional","direction":[0,-0.6,0.8],"angular_diameter_degrees":1"#, sun),
    ] {
        let [got, alpha] = looked_at(engine, &format!(r#"{{{light},"intensity":3}}"#), away);
        assert_near(got, radiance, 1e-4);
        assert_eq!(alpha, 1.0, "{light}");
        let hidden = looked_at(engine, &format!(r#"{{{light},"intensity":3,"visible":false}}"#), away);
        assert_eq!(hidden, [0.0; 2], "{light}");
    }
    let back = looked_at(engine, r#"{"type":"rect","position":[0,4,-4],"direction":[0,1,-1]}"#, away);
    assert_eq!(back, [0.0; 2], "from behind");
    let buried = looked_at(engine, r#"{"type":"sphere","position":[0,-3,0],"radius":1}"#, [0.01, -1.0, 0.0]);
    assert_eq!(buried, [0.0, 1.0], "below the floor");
}

/// A mirror shows a light that the camera does not see.
fn mirrors_see_all(engine: EngineChoice) {
    let mirror = scene(vec![(square(10.0), grey(0.8, 0.0, 1.0), DAffine3::IDENTITY)]);
    let json = r#"{"max_samples":4,"width":8,"height":8,"multiple_scattering":false,
        "lights":[{"type":"sphere","position":[0,4,-4],"radius":1,"intensity":3,"visible":false}],
        "camera":{"position":[0,4,4],"target":[0,0,0],"yfov_degrees":0.1}}"#;
    let fresnel = 0.8 + 0.2 * (1.0 - 0.5f64.sqrt()).powi(5);
    assert_near(mean(&render(engine, work(&mirror, &params(json))), 0), 3.0 * fresnel, 1e-4);
}

/// Points that stand in for lights send the same light afar; that of a ball is the same everywhere.
fn direct_mode_takes_points(engine: EngineChoice) {
    let far =
        r#"{"type":"rect","position":[3,30,4],"direction":[-0.1,-1,0.2],"width":1.2,"height":0.5,"intensity":700}"#;
    let disk = r#"{"type":"disk","position":[3,30,4],"direction":[-0.1,-1,0.2],"radius":0.7,"intensity":700}"#;
    for light in [cases()[3].0, cases()[5].0, far, disk] {
        let path = mean(&render(engine, floor_under(light, "")), 0);
        let direct = mean(&render(engine, floor_under(light, r#","mode":"direct""#)), 0);
        assert_near(direct, path, 5e-3);
    }
}

/// A sun out of focus has the shape of the lens: here half as high as the picture. Nothing lies outside, and all of its light inside.
fn blades_shape_what_is_out_of_focus(engine: EngineChoice) {
    let nothing = scene(vec![(square(0.1), grey(0.0, 1.0, 0.0), DAffine3::from_translation(DVec3::Y * -50.0))]);
    let side = 64;
    let yfov = 2.0 * 0.2f64.atan().to_degrees();
    let sun = 2.0f64;
    let blur = 10.0 * (0.5 * sun.to_radians()).tan();
    for (blades, rotation) in [(0, 0.0), (3, 0.0), (4, 45.0), (6, 10.0)] {
        let json = format!(
            r#"{{"max_bounces":0,"max_samples":256,"width":{side},"height":{side},
                "lights":[{{"type":"directional","direction":[0,0,1],"angular_diameter_degrees":{sun},"intensity":1}}],
                "camera":{{"position":[0,0,0],"target":[0,0,-1],"yfov_degrees":{yfov},"aperture_radius":1,"focus_distance":10,
                           "blades":{blades},"blade_rotation_degrees":{rotation}}}}}"#
        );
        let picture = render(engine, work(&nothing, &params(&json)));
        let step = 4.0 / f64::from(side);
        let (mut total, mut inside) = (0.0, Vec::new());
        for (index, pixel) in (0u32..).zip(&picture.pixels) {
            let x = (f64::from(index % side) + 0.5) * step - 2.0;
            let y = 2.0 - (f64::from(index / side) + 0.5) * step;
            // How far outside of the polygon, whose sides are at right angles to the directions between its corners.
            let apothem = if blades == 0 { 1.0 } else { (PI / f64::from(blades)).cos() };
            let outside = (0..blades)
                .map(|k| {
                    f64::from(rotation as f32).to_radians() + PI / 2.0 + PI * f64::from(2 * k + 1) / f64::from(blades)
                })
                .map(|angle: f64| x * angle.cos() + y * angle.sin() - apothem)
                .fold(if blades == 0 { x.hypot(y) - 1.0 } else { f64::NEG_INFINITY }, f64::max);
            total += f64::from(pixel[0]) * step * step;
            if outside > blur + step {
                assert_eq!(pixel[0], 0.0, "{blades} blades: light at ({x}, {y})");
            } else if outside < -blur - step {
                inside.push(f64::from(pixel[0]));
            }
        }
        let area = if blades == 0 { PI } else { 0.5 * f64::from(blades) * (2.0 * PI / f64::from(blades)).sin() };
        // Solid angles times radiance, of a sun of 1 lux: what a plane at distance 10 has of it, up to the cosines.
        let light = 100.0 * 1.0;
        assert_near(total, light, 2e-2);
        assert_near(inside.iter().sum::<f64>() / inside.len() as f64, light / area, 2e-2);
    }
}

/// All kinds over a glossy floor with a glass pane on it and a glowing plate: many bounces, everything mixed.
fn studio() -> Scene {
    let at = |x: f64, y: f64, z: f64| DAffine3::from_translation(DVec3::new(x, y, z));
    let glass = Extended { transmission: 1.0, ..Extended::default() };
    let pane = Material { extended: Some(Arc::new(glass)), double_sided: true, ..grey(0.9, 0.0, 0.0) };
    let plate = Material { emissive: Vec3::new(1.0, 2.0, 3.0), ..grey(0.2, 1.0, 0.0) };
    scene(vec![
        (square(3.0), grey(0.7, 0.3, 0.2), DAffine3::IDENTITY),
        (square(0.8), pane, at(0.5, 0.8, 0.3) * DAffine3::from_rotation_x(1.0)),
        (square(0.5), plate, at(-1.5, 0.4, 0.0) * DAffine3::from_rotation_z(-0.8)),
    ])
}

#[test]
fn engines_agree_on_all_kinds() {
    let params = params(
        r#"{"width":16,"height":16,"max_samples":64,"camera":{"position":[0.5,2.5,4],"target":[0,0.3,0],"yfov_degrees":40},
            "environment":{"constant":[0.1,0.12,0.15]},"lights":[
            {"type":"sphere","position":[0.3,0.5,-0.8],"radius":0.3,"intensity":4},
            {"type":"rect","position":[-1,2,0],"direction":[0.4,-1,0.1],"width":0.7,"height":1.4,"intensity":6},
            {"type":"disk","position":[1.5,1,-1],"direction":[-1,-0.5,0.6],"radius":0.5,"color":[1,0.5,0.2],"intensity":9},
            {"type":"directional","direction":[-0.4,-1,-0.5],"angular_diameter_degrees":12,"intensity":2},
            {"type":"point","position":[0.5,1.5,1],"intensity":1}]}"#,
    );
    let size = Size { side: 16, samples: 64, batches: 8 };
    let works = [EngineChoice::Gpu, EngineChoice::Cpu].map(|engine| {
        let mut work = work(&studio(), &params);
        work.settings.engine = engine;
        work
    });
    assert!(works[0].features.extended_lights && works[0].features.thin && works[0].features.emitters);
    let verdict = compare(&mut engines(), works, size).expect("two renders");
    eprintln!("{verdict:?}");
    assert!(verdict.agrees(), "{verdict:?}");
}
