//! Where the models are the same, so are the pictures.

use super::{STEP, difference, drawn, merge, preview, request};
use crate::support::{grey, lambert, render, scene, sphere, square, work, work_with_hdri};
use candela::compile::Hdri;
use candela::film::Picture;
use candela::params::EngineChoice;
use candela::render::Work;
use candela::scene::{Material, Scene};
use glam::{DAffine3, DVec3, Vec4};
use serde_json::{Value, json};
use std::sync::Arc;

/// One light each: with more of them the tracer picks by chance.
fn lights() -> Vec<Value> {
    vec![
        json!({"type": "point", "position": [1.5, 2, 1], "color": [1, 0.5, 0.2], "intensity": 8}),
        json!({"type": "point", "position": [1.5, 2, 1], "intensity": 12, "range": 2.5}),
        json!({"type": "directional", "direction": [-1, -1, -0.5], "color": [0.3, 1, 0.6], "intensity": 2.5}),
        json!({"type": "spot", "position": [0.5, 3, 1], "direction": [-0.1, -1, -0.3], "intensity": 15,
               "inner_cone_degrees": 5, "outer_cone_degrees": 30}),
        json!({"type": "spot", "position": [0.5, 3, 1], "direction": [-0.1, -1, -0.3], "intensity": 15,
               "inner_cone_degrees": 5, "outer_cone_degrees": 30, "falloff": "linear"}),
    ]
}

const CAMERA: &str = r#"{"position": [0.4, 1.6, 3], "target": [0, 0, 0], "yfov_degrees": 40}"#;

fn camera() -> Value {
    serde_json::from_str(CAMERA).expect("JSON")
}

/// A convex body and a plane: neither casts a shadow on itself.
fn shadowless(material: fn() -> Material) -> [Scene; 2] {
    [
        scene(vec![(sphere(64), material(), DAffine3::IDENTITY)]),
        scene(vec![(square(1.0), material(), DAffine3::from_rotation_x(0.3))]),
    ]
}

/// Asserts equal radiance where both see the surface, and the same silhouette but for pixels on it.
#[track_caller]
pub(super) fn assert_same(got: &Picture, expected: &Picture, what: &str) {
    let pairs = || got.pixels.iter().zip(&expected.pixels);
    let outlines = pairs().filter(|(a, b)| a[3] != b[3]).count();
    assert!(outlines <= got.pixels.len() / 100, "{what}: {outlines} pixels of another outline");
    let inside = || pairs().filter(|(a, b)| a[3] == 1.0 && b[3] == 1.0);
    assert!(inside().count() > got.pixels.len() / 8, "{what}: too little is seen");
    let brightest = inside().flat_map(|(_, b)| b[..3].to_vec()).fold(0.0, f32::max);
    assert!(brightest > 0.1, "{what}: all is dark, {brightest}");
    let worst = inside().map(|(a, b)| difference(a, b)).fold(0.0, f32::max);
    assert!(worst <= STEP, "{what}: a pixel differs by {:.2} steps of 255", 255.0 * worst);
}

/// `change` is made to the work of both engines.
pub(super) fn assert_agrees(material: fn() -> Material, shading: &str, change: fn(Work) -> Work) {
    for (place, scene) in shadowless(material).iter().enumerate() {
        for light in lights() {
            let mut extra = json!({"lights": [light], "camera": camera(), "preview": {"shading": shading}});
            let got: Vec<_> = ["deferred", "forward"]
                .map(|path| {
                    merge(&mut extra, json!({"preview": {"path": path}}));
                    drawn(change(work(scene, &request(extra.clone()))))
                })
                .into();
            merge(&mut extra, json!({"mode": "direct", "max_samples": 1}));
            let expected = render(EngineChoice::Cpu, change(work(scene, &request(extra))));
            for got in &got {
                assert_same(got, &expected, &format!("{shading}, scene {place}, {light}"));
            }
        }
    }
}

#[test]
fn unshadowed_lambert_is_that_of_the_tracer() {
    assert_agrees(|| grey(0.7, 1.0, 0.0), "lambert", lambert);
}

#[test]
fn unshadowed_pbr_is_that_of_the_tracer() {
    fn same(work: Work) -> Work {
        work
    }
    assert_agrees(|| grey(0.6, 0.4, 0.0), "pbr", same);
    assert_agrees(|| grey(0.6, 0.6, 1.0), "pbr", same);
}

/// Light that is the same from everywhere is not blocked by a convex body: a constant sky, ambient light, and the tracer's direct
/// mode, which knows ambient light in closed form.
#[test]
fn even_light_is_the_same_by_all_ways() {
    let scene = scene(vec![(sphere(64), grey(0.6, 0.5, 0.3), DAffine3::IDENTITY)]);
    let ambient = json!({"camera": camera(), "lights": [{"type": "ambient", "intensity": 0.8}]});
    let sky = json!({"camera": camera(), "environment": {"constant": [0.8, 0.8, 0.8]}});
    let mut direct = ambient.clone();
    merge(&mut direct, json!({"mode": "direct", "max_samples": 1}));
    let expected = render(EngineChoice::Cpu, work(&scene, &request(direct)));
    for extra in [ambient, sky] {
        assert_same(&preview(&scene, extra), &expected, "even light");
    }
}

/// A sky with a bright window and a lamp in it.
fn picture_sky() -> Arc<Hdri> {
    let texel = |x: u32, y: u32| {
        let window = (150..175).contains(&x) && (30..60).contains(&y);
        let lamp = (x as f32 - 60.0).hypot(y as f32 - 50.0) < 4.0;
        let height = 1.0 - y as f32 / 128.0;
        let (window, lamp) = (f32::from(u8::from(window)), f32::from(u8::from(lamp)));
        [
            0.1 + 0.3 * height + 6.0 * window + 40.0 * lamp,
            0.1 + 0.4 * height + 6.0 * window,
            0.1 + 0.6 * height + 5.0 * window,
        ]
    };
    Arc::new(Hdri::new(
        256,
        128,
        (0..128).flat_map(|y| (0..256).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect(),
    ))
}

/// A convex body hides nothing of the sky from itself: what is left is the error of harmonics and of prefiltering, which sees each lobe
/// from straight above.
#[test]
fn skies_are_mirrored_as_wide_as_roughness_makes_them() {
    let sky = picture_sky();
    for (roughness, metallic, tolerance) in [
        (0.0, 1.0, 0.02),
        (0.1, 1.0, 0.05),
        (0.2, 1.0, 0.1),
        (0.35, 1.0, 0.12),
        (0.5, 1.0, 0.12),
        (0.7, 1.0, 0.12),
        (1.0, 1.0, 0.09),
        (0.3, 0.0, 0.06),
        (1.0, 0.0, 0.06),
    ] {
        let scene = scene(vec![(sphere(64), grey(0.9, roughness, metallic), DAffine3::IDENTITY)]);
        let look = |mode: &str| {
            let extra = json!({
                "mode": mode, "max_bounces": 1, "max_samples": 256, "adaptive": false, "filter": {"radius": 0.5},
                "camera": camera(), "environment": {"hdri": "sky", "rotation_degrees": 70}, "preview": {"samples": 16},
            });
            render(EngineChoice::Cpu, work_with_hdri(&scene, &request(extra), Some(Arc::clone(&sky))))
        };
        let (drawn, traced) = (look("preview"), look("path"));
        let (mut apart, mut light) = (0.0, 0.0);
        for (a, b) in drawn.pixels.iter().zip(&traced.pixels).filter(|(a, b)| a[3] > 0.99 && b[3] > 0.99) {
            apart += (0..3).map(|i| f64::from((a[i] - b[i]).abs())).sum::<f64>();
            light += (0..3).map(|i| f64::from(b[i])).sum::<f64>();
        }
        eprintln!("roughness {roughness}, metallic {metallic}: {:.2} % apart", 100.0 * apart / light);
        assert!(apart < tolerance * light, "roughness {roughness}, metallic {metallic}: {}", apart / light);
    }
}

/// Irradiance `E` at height 1 under a light: radiance is `E / pi (albedo N.L + specular (N.H)^shininess)`; straight from above
/// all cosines are 1.
#[test]
fn highlights_and_author_attenuation_have_their_closed_form() {
    let scene = scene(vec![(square(0.5), grey(0.5, 1.0, 0.0), DAffine3::IDENTITY)]);
    let centre = |shading: &str, attenuation: Value, light: Value| {
        let picture = preview(
            &scene,
            json!({"width": 65, "height": 65, "lights": [light],
                   "camera": {"position": [0, 1.5, 0], "target": [0, 0, 0], "up": [0, 0, -1], "yfov_degrees": 20},
                   "preview": {"shading": shading, "specular": 0.4, "shininess": 20, "attenuation": attenuation}}),
        );
        f64::from(picture.pixels[32 * 65 + 32][0])
    };
    let point = json!({"type": "point", "position": [0, 1, 0], "intensity": 3, "range": 4});
    let diffuse = |irradiance: f64| irradiance * 0.5 / std::f64::consts::PI;
    let shiny = |irradiance: f64| irradiance * 0.9 / std::f64::consts::PI;
    let window = 1.0 - (1.0f64 / 4.0).powi(4);
    let polynomial = json!({"kind": "polynomial", "constant": 1, "linear": 0.7, "quadratic": 1.8});
    for (got, expected) in [
        (centre("lambert", json!({"kind": "physical"}), point.clone()), diffuse(3.0 * window)),
        (centre("phong", json!({"kind": "physical"}), point.clone()), shiny(3.0 * window)),
        (centre("blinn_phong", json!({"kind": "physical"}), point.clone()), shiny(3.0 * window)),
        (centre("lambert", polynomial, point.clone()), diffuse(3.0 / 3.5)),
        (centre("lambert", json!({"kind": "range"}), point), diffuse(3.0 * 0.75)),
    ] {
        assert!((got - expected).abs() < 2e-4, "{got} for {expected}");
    }
}

#[test]
fn an_author_spot_edge_is_linear_in_the_cosine() {
    let scene = scene(vec![(square(2.0), grey(1.0, 1.0, 0.0), DAffine3::IDENTITY)]);
    let light = json!({"type": "spot", "position": [0, 1, 0], "direction": [0, -1, 0], "intensity": 1,
                       "inner_cone_degrees": 0, "outer_cone_degrees": 45});
    let at = |x: f64| {
        let picture = preview(
            &scene,
            json!({"width": 3, "height": 3, "lights": [light],
                   "camera": {"position": [x, 2, 0], "target": [x, 0, 0], "up": [0, 0, -1], "yfov_degrees": 0.1},
                   "preview": {"shading": "lambert", "spot_edge": "linear_cosine"}}),
        );
        f64::from(picture.pixels[4][0])
    };
    for x in [0.1, 0.3, 0.6, 0.9, 1.1] {
        let cosine = 1.0 / (1.0f64 + x * x).sqrt();
        let outer = std::f64::consts::FRAC_1_SQRT_2;
        let edge = ((cosine - outer) / (1.0 - outer)).clamp(0.0, 1.0);
        let expected = edge * cosine.powi(3) / std::f64::consts::PI;
        assert!((at(x) - expected).abs() < 5e-4, "{} for {expected} at {x}", at(x));
    }
}

/// A pane of half transparency over a white floor: half of each.
#[test]
fn transparent_surfaces_are_blended_and_leave_no_pass_where_there_are_none() {
    let pane = Material {
        base_color: Vec4::new(1.0, 0.0, 0.0, 0.5),
        alpha_mode: candela::scene::AlphaMode::Blend,
        unlit: true,
        ..Material::default()
    };
    let floor = Material { unlit: true, base_color: Vec4::ONE, ..Material::default() };
    let above = DAffine3::from_translation(DVec3::new(0.0, 0.5, 0.0));
    let scene = scene(vec![(square(1.0), floor, DAffine3::IDENTITY), (square(0.5), pane, above)]);
    for path in ["deferred", "forward"] {
        let picture = preview(
            &scene,
            json!({"camera": {"position": [0, 3, 0], "target": [0, 0, 0], "up": [0, 0, -1], "yfov_degrees": 30},
                   "lights": [{"type": "ambient"}], "preview": {"path": path}}),
        );
        let centre = picture.pixels[32 * 64 + 32];
        assert!(difference(&centre, &[1.0, 0.5, 0.5, 1.0]) < STEP, "{path}: {centre:?}");
    }
}
