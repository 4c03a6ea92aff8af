//! Spheres by their equation: closed forms, extremes, and one picture from three engines.

use crate::support::{
    assert_near, grey, heights, lambert, mean, params, png, render, scene, square, work, work_with_maps,
};
use candela::compile::MapFiles;
use candela::film::Picture;
use candela::params::EngineChoice;
use candela::scene::{Scene, SceneRoot};
use glam::DAffine3;
use serde_json::{Value, json};
use std::f64::consts::PI;

on_both_engines! {
    a_diffuse_sphere_in_a_constant_sky_has_its_albedo_everywhere,
    a_sphere_covers_what_geometry_says,
    a_sphere_throws_a_round_shadow,
    phong_head_on_is_its_formula,
    phong_mirrors_as_deep_as_asked,
}

/// A file with nothing in it.
fn empty() -> Scene {
    Scene { scenes: vec![SceneRoot::default()], ..Scene::default() }
}

fn with(base: &str, over: &Value) -> candela::params::RenderParams {
    let mut value: Value = serde_json::from_str(base).expect("JSON");
    let (Some(value_map), Value::Object(over)) = (value.as_object_mut(), over.clone()) else { panic!("objects") };
    value_map.extend(over);
    params(&value.to_string())
}

/// Every path leaves a convex body for the sky at once: each sample is the albedo, unless a ray meets the sphere that it left.
/// From a micrometre to a planet, from nearby and from so far that a naive discriminant has no digit left.
fn a_diffuse_sphere_in_a_constant_sky_has_its_albedo_everywhere(engine: EngineChoice) {
    for (radius, distance, center) in [
        (1.0f64, 4.0f64, [0.0; 3]),
        (1e-5, 4e-5, [0.0; 3]),
        (1e6, 4e6, [0.0; 3]),
        (1.0, 1e5, [0.0; 3]),
        (1.0, 4.0, [1e6, -3e5, 7e5]),
        (1.0, 1.001, [0.0; 3]),
    ] {
        let yfov = 2.0 * (0.8 * radius / distance).atan().to_degrees();
        let [x, y, z] = center;
        let request = with(
            r#"{"max_samples": 16, "environment": {"constant": [1, 1, 1], "visible": false}}"#,
            &json!({
                "spheres": [{"center": center, "radius": radius, "color": [0.5, 0.25, 0.75], "roughness": 1}],
                "camera": {"position": [x + 0.6 * distance, y, z + 0.8 * distance], "target": center, "yfov_degrees": yfov},
                "output": {"transparent": true},
            }),
        );
        let picture = render(engine, lambert(work(&empty(), &request)));
        let seen: Vec<_> = picture.pixels.iter().filter(|pixel| pixel[3] == 1.0).collect();
        assert!(seen.len() > 300, "radius {radius}, distance {distance}: {} pixels", seen.len());
        for pixel in seen {
            for (got, albedo) in pixel.iter().zip([0.5, 0.25, 0.75]) {
                assert_near(f64::from(*got), albedo, 1e-5);
            }
        }
    }
}

/// A cone around the sphere, cut by the picture: `pi tan^2` over the picture's area. Significance 1e-4.
fn a_sphere_covers_what_geometry_says(engine: EngineChoice) {
    for (radius, distance) in [(1.0f64, 4.0f64), (1e-3, 30.0), (1e4, 1.5e4)] {
        let tangent = (radius / distance).asin().tan();
        let yfov = 2.0 * (2.0 * tangent).atan().to_degrees();
        let request = with(
            r#"{"max_samples": 64, "environment": {"constant": [1, 1, 1]}}"#,
            &json!({
                "spheres": [{"center": [5, 6, 7], "radius": radius}],
                "camera": {"position": [5.0, 6.0, 7.0 + distance], "target": [5, 6, 7], "yfov_degrees": yfov},
                "output": {"transparent": true},
            }),
        );
        let picture = render(engine, work(&empty(), &request));
        // About 100 pixels are on the outline, each of 64 samples of deviation below 1/2.
        let tolerance = 4.0 * (100.0 * 0.25 / 64.0f64).sqrt() / 1024.0;
        let (got, expected) = (mean(&picture, 3), PI / 16.0);
        assert!((got - expected).abs() < tolerance, "{got} for {expected}, radius {radius}");
    }
}

/// Straight from above: a disk as large as the sphere. The camera looks past it from below the light.
fn a_sphere_throws_a_round_shadow(engine: EngineChoice) {
    let floor = scene(vec![(square(2.0), grey(1.0, 1.0, 0.0), DAffine3::IDENTITY)]);
    let request = |spheres: Value| {
        with(
            r#"{"mode": "direct", "max_samples": 64, "lights": [{"type": "directional", "direction": [0, -1, 0]}],
                "camera": {"position": [0, 2, 0], "target": [0, 0, 0], "up": [0, 0, -1], "yfov_degrees": 60}}"#,
            &json!({ "spheres": spheres }),
        )
    };
    let lit = mean(&render(engine, lambert(work(&floor, &request(json!([]))))), 0);
    let sphere = json!([{"center": [0.1, 5, -0.2], "radius": 0.7}]);
    let shaded = mean(&render(engine, lambert(work(&floor, &request(sphere)))), 0);
    let side = 2.0 * 2.0 * 30f64.to_radians().tan();
    assert_near(1.0 - shaded / lit, PI * 0.49 / (side * side), 0.01);
}

/// Where the view, the normal and the light are one: `(1 - k) (color + k_s) / pi * I / d^2`.
fn phong_head_on_is_its_formula(engine: EngineChoice) {
    for (reflectivity, shininess) in [(0.0, 10.0), (0.3, 80.0), (0.9, 1.0)] {
        let request = with(
            r#"{"mode": "direct", "direct": {"shading": "phong", "specular": 0.4}, "max_samples": 4,
                "lights": [{"type": "point", "position": [0, 0, 3], "intensity": 8}],
                "camera": {"position": [0, 0, 3], "target": [0, 0, 0], "yfov_degrees": 0.01}}"#,
            &json!({"spheres": [{"center": [0, 0, 0], "radius": 1, "color": [0.6, 0.5, 0.4],
                                 "shininess": shininess, "reflectivity": reflectivity}]}),
        );
        let picture = render(engine, work(&empty(), &request));
        for (channel, color) in [0.6, 0.5, 0.4].into_iter().enumerate() {
            assert_near(mean(&picture, channel), (1.0 - reflectivity) * (color + 0.4) / PI * 2.0, 1e-3);
        }
    }
}

/// A sphere of reflectivity 0.5 shows a lit wall behind the camera at that strength, if one bounce is allowed.
fn phong_mirrors_as_deep_as_asked(engine: EngineChoice) {
    let wall = json!({"center": [0, 0, 1003], "radius": 1000, "color": [1, 1, 1], "roughness": 1});
    let mirror = json!({"center": [0, 0, 0], "radius": 1, "color": [0, 0, 0], "reflectivity": 0.5});
    let look = |bounces: u32| {
        let request = with(
            r#"{"mode": "direct", "direct": {"shading": "phong", "specular": 0}, "max_samples": 4,
                "lights": [{"type": "directional", "direction": [1, 0, 1], "intensity": 2}],
                "camera": {"position": [0, 0, 2], "target": [0, 0, 0], "yfov_degrees": 0.01}}"#,
            &json!({"spheres": [wall, mirror], "max_bounces": bounces}),
        );
        mean(&render(engine, work(&empty(), &request)), 0)
    };
    // One scattering event is the mirror's; the wall's is the second.
    assert_eq!([look(0), look(1)], [0.0; 2]);
    assert_near(look(2), 0.5 * 2f64.sqrt() / PI, 1e-3);
}

/// Spheres of all kinds over a floor.
fn mixed() -> (Scene, Value, MapFiles) {
    let floor = scene(vec![(square(3.0), grey(0.6, 0.8, 0.0), DAffine3::IDENTITY)]);
    let checks = image::RgbImage::from_fn(16, 8, |x, y| {
        if (x + y) % 2 == 0 { image::Rgb([220, 60, 30]) } else { image::Rgb([30, 90, 220]) }
    });
    let maps = MapFiles::from([
        ("checks.png".to_owned(), png(&image::DynamicImage::ImageRgb8(checks))),
        (
            "bumps.png".to_owned(),
            heights(64, 32, |x, y| 0.5 + 0.5 * (f64::from(x) * PI / 4.0).sin() * (f64::from(y) * PI / 4.0).sin()),
        ),
    ]);
    let spheres = json!([
        {"center": [-1.2, 0.6, 0], "radius": 0.6, "color": [0.9, 0.4, 0.2], "roughness": 0.4, "reflectivity": 0.3},
        {"center": [0, 0.5, 0.4], "radius": 0.5, "roughness": 0.7, "texture": {"image": "checks.png"}},
        {"center": [1.1, 0.4, 0.1], "radius": 0.4, "metallic": 1, "roughness": 0.3, "color": [0.9, 0.8, 0.5], "axis": "z"},
        {"center": [0.2, 0.3, 1.3], "radius": 0.3, "roughness": 0.6, "height": {"image": "bumps.png", "scale": 0.05}},
    ]);
    (floor, spheres, maps)
}

const CAMERA: &str = r#"{"position": [0.3, 1.5, 4.5], "target": [0, 0.4, 0], "yfov_degrees": 35}"#;

/// Root of the mean square difference, and the larger mean.
fn compare(a: &Picture, b: &Picture) -> (f64, f64) {
    let square = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|i| f64::from(a[i] - b[i]).powi(2)).sum::<f64>() / 3.0;
    let sum: f64 = a.pixels.iter().zip(&b.pixels).map(square).sum();
    ((sum / a.pixels.len() as f64).sqrt(), mean(a, 1).max(mean(b, 1)))
}

/// Engines that share no transport code agree in all paths of light, up to noise.
#[test]
fn both_engines_agree_on_spheres() {
    let (floor, spheres, maps) = mixed();
    let request = |seed: u32| {
        with(
            r#"{"max_samples": 256, "adaptive": false, "environment": {"gradient":
                {"top": [0.8, 0.9, 1], "horizon": [1, 1, 1], "bottom": [0.2, 0.1, 0.1]}}}"#,
            &json!({"spheres": spheres, "seed": seed, "camera": serde_json::from_str::<Value>(CAMERA).expect("JSON"),
                    "lights": [{"type": "point", "position": [2, 3, 2], "intensity": 20}]}),
        )
    };
    let gpu = render(EngineChoice::Gpu, work_with_maps(&floor, &request(1), &maps));
    let cpu = [1, 2].map(|seed| render(EngineChoice::Cpu, work_with_maps(&floor, &request(seed), &maps)));
    let (noise, level) = compare(&cpu[0], &cpu[1]);
    let (rmse, _) = compare(&gpu, &cpu[0]);
    assert!(rmse < 2.0 * noise + 1e-3 * level, "RMSE {rmse}, noise {noise}, level {level}");
    assert_near(mean(&gpu, 1), mean(&cpu[0], 1), 5e-3);
}

/// A preview and the tracer's direct light show the same spheres, textures and bumps: within a step of 8 bits but for outlines.
#[test]
fn previews_show_the_same_spheres() {
    let (floor, mut spheres, maps) = mixed();
    // Lambert's shading knows no metals.
    spheres[2]["metallic"] = json!(0);
    let look = |mode: &str, path: &str, shadows: &str| {
        let request = with(
            r#"{"max_samples": 1, "width": 96, "height": 96, "filter": {"kind": "box", "radius": 0.001}}"#,
            &json!({"mode": mode, "spheres": spheres, "camera": serde_json::from_str::<Value>(CAMERA).expect("JSON"),
                    "preview": {"samples": 1, "shading": "lambert", "path": path, "shadows": {"algorithm": shadows}},
                    "lights": [{"type": "directional", "direction": [-0.4, -1, -0.3], "intensity": 2}]}),
        );
        let engine = if mode == "preview" { EngineChoice::Gpu } else { EngineChoice::Cpu };
        render(engine, lambert(work_with_maps(&floor, &request, &maps)))
    };
    let traced = look("direct", "deferred", "ray");
    for (path, shadows, most) in [("deferred", "ray", 0.01), ("forward", "ray", 0.01), ("deferred", "basic", 0.05)] {
        let drawn = look("preview", path, shadows);
        let differ = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).any(|i| (a[i] - b[i]).abs() > 1.5 / 255.0);
        let differing = traced.pixels.iter().zip(&drawn.pixels).filter(|pair| differ(*pair)).count();
        let part = differing as f64 / traced.pixels.len() as f64;
        assert!(part <= most, "{path}, {shadows}: {part:.4} of the pixels differ");
    }
}
