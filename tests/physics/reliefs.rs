//! Height, normal and parallax maps: against the derivatives of what they store, a march in f64, and one another.

use crate::support::{assert_near, grey, heights, lambert, mean, params, png, render, scene, work_with_maps};
use candela::compile::MapFiles;
use candela::film::Picture;
use candela::params::EngineChoice;
use candela::scene::{Material, Primitive, Scene};
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};

on_both_engines! {
    heights_tilt_by_their_derivative,
    normal_maps_tilt_as_they_say,
    heights_are_in_scene_units,
    reliefs_are_seen_where_a_fine_march_meets_them,
    reliefs_keep_light_off_themselves,
}

/// A square of half side `half` in the plane y = 0, u to the right (+x) and v towards +z as in a picture seen from above.
fn sheet(half: f32) -> Primitive {
    let positions =
        [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(|(x, z)| Vec3::new(x * half, 0.0, z * half));
    Primitive {
        positions: positions.to_vec(),
        uvs: vec![vec![Vec2::new(0.0, 1.0), Vec2::ONE, Vec2::new(1.0, 0.0), Vec2::ZERO]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Primitive::default()
    }
}

fn named(material: Material) -> Material {
    Material { name: Some("sheet".to_owned()), ..material }
}

fn ground(map: DAffine3) -> Scene {
    scene(vec![(sheet(1.0), named(grey(1.0, 1.0, 0.0)), map)])
}

/// Direct light of a sun on the sheet, seen from straight above so far away that the view is parallel; a pixel's centre alone.
fn look(engine: EngineChoice, mode: &str, scene: &Scene, relief: &Value, sun: DVec3, maps: &MapFiles) -> Picture {
    let mut changes = json!({"material": "sheet"});
    for (name, value) in relief.as_object().expect("an object") {
        changes[name] = value.clone();
    }
    let request = params(
        &json!({
            "mode": mode, "max_samples": 1, "width": 64, "height": 64, "filter": {"kind": "box", "radius": 0.001},
            "camera": {"position": [0, 1000, 0], "target": [0, 0, 0], "up": [0, 0, -1],
                       "yfov_degrees": 2.0 * (0.001f64).atan().to_degrees()},
            "lights": [{"type": "directional", "direction": (-sun).to_array(), "intensity": PI}],
            "preview": {"samples": 1, "shading": "lambert", "shadows": {"algorithm": "none"}},
            "overrides": [changes],
        })
        .to_string(),
    );
    render(engine, lambert(work_with_maps(scene, &request, maps)))
}

/// Height of the waves: along u and v, of 256 texels each.
fn waves(u: f64, v: f64) -> f64 {
    0.5 + 0.25 * (TAU * 2.0 * u).sin() + 0.25 * (TAU * 3.0 * v).cos()
}

/// (d/du, d/dv)
fn slopes(u: f64, v: f64) -> (f64, f64) {
    (0.25 * TAU * 2.0 * (TAU * 2.0 * u).cos(), -0.25 * TAU * 3.0 * (TAU * 3.0 * v).sin())
}

fn wave_map() -> MapFiles {
    let at = |x: u32| (f64::from(x) + 0.5) / 256.0;
    MapFiles::from([("waves.png".to_owned(), heights(256, 256, |x, y| waves(at(x), at(y))))])
}

/// Compares each pixel with the light on a normal that is a function of (u, v).
#[track_caller]
fn assert_lit_by(picture: &Picture, sun: DVec3, tolerance: f64, normal: impl Fn(f64, f64) -> DVec3) {
    for (index, pixel) in picture.pixels.iter().enumerate() {
        let (u, v) = (((index % 64) as f64 + 0.5) / 64.0, ((index / 64) as f64 + 0.5) / 64.0);
        let expected = normal(u, v).dot(sun).max(0.0);
        let got = f64::from(pixel[0]);
        assert!((got - expected).abs() < tolerance, "at ({u:.3}, {v:.3}): {got} for {expected}");
    }
}

const SUNS: [[f64; 3]; 2] = [[0.5, 1.0, 0.2], [-0.3, 1.0, 0.6]];

/// Normals of a raised sheet against the analytic derivative of the height, in x (along u) and z (along v), in tracer and preview.
fn heights_tilt_by_their_derivative(engine: EngineChoice) {
    let maps = wave_map();
    for sun in SUNS.map(|sun| DVec3::from(sun).normalize()) {
        for scale in [0.1, -0.05] {
            let relief = json!({"height": {"image": "waves.png", "scale": scale}});
            let mut pictures = vec![look(engine, "direct", &ground(DAffine3::IDENTITY), &relief, sun, &maps)];
            if engine == EngineChoice::Gpu {
                pictures.push(look(engine, "preview", &ground(DAffine3::IDENTITY), &relief, sun, &maps));
            }
            for picture in pictures {
                assert_lit_by(&picture, sun, 4e-3, |u, v| {
                    let (du, dv) = slopes(u, v);
                    // The sheet is two units wide.
                    DVec3::new(-scale * du / 2.0, 1.0, -scale * dv / 2.0).normalize()
                });
            }
        }
    }
}

/// Red is along u, green against v, blue is not read; the strength is a factor on both.
fn normal_maps_tilt_as_they_say(engine: EngineChoice) {
    let tilt = |u: f64, v: f64| (0.5 * (TAU * u).sin(), 0.4 * (TAU * 2.0 * v).cos());
    let byte = |x: f64| (127.5 + 127.5 * x).round() as u8;
    let picture = image::RgbImage::from_fn(256, 256, |x, y| {
        let (nx, ny) = tilt((f64::from(x) + 0.5) / 256.0, (f64::from(y) + 0.5) / 256.0);
        image::Rgb([byte(nx), byte(ny), 7])
    });
    let maps = MapFiles::from([("normals.png".to_owned(), png(&image::DynamicImage::ImageRgb8(picture)))]);
    for sun in SUNS.map(|sun| DVec3::from(sun).normalize()) {
        for scale in [1.0, 0.5] {
            let relief = json!({"normal": {"image": "normals.png", "scale": scale}});
            let picture = look(engine, "direct", &ground(DAffine3::IDENTITY), &relief, sun, &maps);
            assert_lit_by(&picture, sun, 1.2e-2, |u, v| {
                let (x, y) = tilt(u, v);
                let z = (1.0 - x * x - y * y).max(0.0).sqrt();
                DVec3::new(scale * x, z, -scale * y).normalize()
            });
        }
    }
}

/// A sheet stretched to three times its length has slopes of a third: heights do not grow with it. Instanced or not.
fn heights_are_in_scene_units(engine: EngineChoice) {
    let maps = wave_map();
    let sun = DVec3::from(SUNS[0]).normalize();
    let relief = json!({"height": {"image": "waves.png", "scale": 0.2}});
    let stretched = DAffine3::from_scale(DVec3::new(3.0, 1.0, 3.0));
    let mut twice = ground(stretched);
    twice.nodes.push(candela::scene::Node {
        mesh: Some(0),
        local: DAffine3::from_translation(DVec3::new(0.0, -5.0, 0.0)),
        ..candela::scene::Node::default()
    });
    twice.scenes[0].nodes.push(1);
    for scene in [ground(stretched), twice] {
        let picture = look(engine, "direct", &scene, &relief, sun, &maps);
        // The picture shows the middle third.
        assert_lit_by(&picture, sun, 4e-3, |u, v| {
            let (du, dv) = slopes((u + 1.0) / 3.0, (v + 1.0) / 3.0);
            DVec3::new(-0.2 * du / 6.0, 1.0, -0.2 * dv / 6.0).normalize()
        });
    }
}

/// A relief seen at 45 degrees: the colour that a texture has where a march of 20,000 steps meets the height.
fn reliefs_are_seen_where_a_fine_march_meets_them(engine: EngineChoice) {
    let mut maps = wave_map();
    // Red is u, green v: 16 bits are not needed to tell the place.
    let ramp = image::RgbImage::from_fn(256, 256, |x, y| image::Rgb([x as u8, y as u8, 0]));
    maps.insert("ramp.png".to_owned(), png(&image::DynamicImage::ImageRgb8(ramp)));
    let depth = 0.15;
    let view = DVec3::new(0.6, -1.0, 0.3).normalize();
    let eye = -view * 1000.0;
    let scene =
        scene(vec![(sheet(1.0), named(Material { base_color: Vec4::ONE, ..grey(1.0, 1.0, 0.0) }), DAffine3::IDENTITY)]);
    let request = params(
        &json!({
            "mode": "direct", "max_samples": 1, "width": 32, "height": 32, "filter": {"kind": "box", "radius": 0.001},
            "camera": {"position": eye.to_array(), "target": [0, 0, 0], "up": [0, 0, -1],
                       "yfov_degrees": 2.0 * (0.0004f64).atan().to_degrees()},
            "lights": [{"type": "ambient", "intensity": 1}],
            "overrides": [{"material": "sheet", "texture": {"image": "ramp.png"},
                           "parallax": {"image": "waves.png", "scale": depth, "method": "relief", "steps": 64}}],
        })
        .to_string(),
    );
    let picture = render(engine, lambert(work_with_maps(&scene, &request, &maps)));
    let right = view.cross(DVec3::NEG_Z).normalize();
    let up = right.cross(view);
    let linear = |texel: f64| {
        let x = texel / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    };
    let mut worst: f64 = 0.0;
    for (index, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = (((index % 32) as f64 + 0.5) / 16.0 - 1.0, 1.0 - ((index / 32) as f64 + 0.5) / 16.0);
        let direction = (view + (right * x + up * y) * 0.0004).normalize();
        let top = eye + direction * (-eye.y / direction.y);
        let way = direction * (depth / -direction.y);
        let at = |part: f64| {
            let p = top + way * part;
            ((p.x + 1.0) / 2.0, (p.z + 1.0) / 2.0)
        };
        let met = (0..=20_000).map(|i| f64::from(i) / 20_000.0).find(|&part| {
            let (u, v) = at(part);
            part >= 1.0 - waves(u, v)
        });
        let (u, v) = at(met.unwrap_or(1.0));
        for (channel, place) in [u, v].into_iter().enumerate() {
            let expected = linear((256.0 * place - 0.5).clamp(0.0, 255.0));
            worst = worst.max((f64::from(pixel[channel]) - expected).abs());
        }
    }
    assert!(worst < 6e-3, "{worst}");
}

/// Seen from straight above under a low sun: dark where a march of 20,000 steps towards the sun meets the relief, else lit by its normal.
fn reliefs_keep_light_off_themselves(engine: EngineChoice) {
    let maps = wave_map();
    let depth = 0.3;
    for sun in [[1.0, 0.25, 0.0], [-0.4, 0.3, 0.9]].map(|sun| DVec3::from(sun).normalize()) {
        let parallax = json!({"image": "waves.png", "scale": depth, "steps": 256, "self_shadow": true});
        let relief = json!({ "parallax": parallax });
        let picture = look(engine, "direct", &ground(DAffine3::IDENTITY), &relief, sun, &maps);
        let (mut dark, mut wrong) = (0, 0);
        for (index, pixel) in picture.pixels.iter().enumerate() {
            let (u, v) = (((index % 64) as f64 + 0.5) / 64.0, ((index / 64) as f64 + 0.5) / 64.0);
            let (du, dv) = slopes(u, v);
            let facing = DVec3::new(-depth * du / 2.0, 1.0, -depth * dv / 2.0).normalize().dot(sun).max(0.0);
            let start = depth * (waves(u, v) - 1.0);
            let is_blocked = (1..20_000).any(|i| {
                let rise = -start * f64::from(i) / 20_000.0;
                let aside = rise / sun.y / 2.0;
                depth * (waves(u + sun.x * aside, v + sun.z * aside) - 1.0) > start + rise + 1e-6
            });
            dark += usize::from(is_blocked && facing > 0.1);
            let expected = if is_blocked { 0.0 } else { facing };
            wrong += usize::from((f64::from(pixel[0]) - expected).abs() > 1e-2);
        }
        assert!(dark > 200, "only {dark} pixels that face the sun are in shadow");
        assert!(wrong < 60, "{wrong} of 4096 pixels are wrong");
    }
}

/// At a grazing view too, all methods give both engines and the preview the same picture.
#[test]
fn engines_agree_on_every_method() {
    let mut maps = wave_map();
    let checks =
        image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([if (x / 8 + y / 8) % 2 == 0 { 230 } else { 40 }; 3]));
    maps.insert("checks.png".to_owned(), png(&image::DynamicImage::ImageRgb8(checks)));
    let scene = ground(DAffine3::IDENTITY);
    for method in ["offset", "offset_limited", "steep", "relief"] {
        let look = |engine, mode: &str| {
            let request = params(
                &json!({
                    "mode": mode, "max_samples": 1, "width": 64, "height": 64, "filter": {"kind": "box", "radius": 0.001},
                    "camera": {"position": [0.5, 0.6, 1.6], "target": [0, 0, 0], "yfov_degrees": 45},
                    "lights": [{"type": "directional", "direction": [-0.4, -1, -0.2], "intensity": 2}],
                    "preview": {"samples": 1, "shading": "lambert", "shadows": {"algorithm": "none"}},
                    "overrides": [{"material": "sheet", "color": [0.9, 0.5, 0.3], "texture": {"image": "checks.png", "tiling": [2, 2]},
                                   "parallax": {"image": "waves.png", "scale": 0.1, "method": method}}],
                })
                .to_string(),
            );
            render(engine, lambert(work_with_maps(&scene, &request, &maps)))
        };
        let exact = look(EngineChoice::Cpu, "direct");
        assert!(mean(&exact, 0) > 0.05);
        for (engine, mode) in [(EngineChoice::Gpu, "direct"), (EngineChoice::Gpu, "preview")] {
            let other = look(engine, mode);
            let differ = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).any(|i| (a[i] - b[i]).abs() > 2.0 / 255.0);
            let differing = exact.pixels.iter().zip(&other.pixels).filter(|pair| differ(*pair)).count();
            assert!(differing <= 41, "{method}, {mode}: {differing} of 4096 pixels differ");
        }
    }
}

/// Values of an override take the place of the file's, by the material's name.
#[test]
fn overrides_change_the_material_of_that_name_alone() {
    let other = Material { name: Some("other".to_owned()), ..grey(0.25, 1.0, 0.0) };
    let apart = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
    let two = scene(vec![(sheet(1.0), named(grey(0.25, 1.0, 0.0)), apart(-1.0)), (sheet(1.0), other, apart(1.0))]);
    let relief = json!({"color": [0.75, 0.5, 0.5]});
    let picture = look(EngineChoice::Cpu, "direct", &two, &relief, DVec3::Y, &MapFiles::new());
    assert_near(f64::from(picture.pixels[0][0]), 0.75, 1e-3);
    assert_near(f64::from(picture.pixels[63][0]), 0.25, 1e-3);
}
