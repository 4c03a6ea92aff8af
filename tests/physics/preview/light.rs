//! Many lights: ways of drawing that must give the same picture.

use super::{STEP, demo, imported, part_differing, preview, request};
use crate::support::{grey, scene, square, work};
use candela::demo::many_instances;
use candela::scene::Scene;
use glam::DAffine3;
use serde_json::{Value, json};

/// Lights strewn over a box by a Weyl sequence, each with an end.
fn strewn(count: usize, centre: [f64; 3], extent: [f64; 3], range: f64) -> Value {
    let place = |index: usize, axis: usize| {
        let step = [0.754_877_666, 0.569_840_296, 0.430_159_7][axis];
        centre[axis] + extent[axis] * ((index as f64 * step).fract() - 0.5)
    };
    let light = |i: usize| {
        let color = [0.2 + 0.8 * (i % 3) as f64 / 2.0, 0.5, 1.0 - 0.8 * (i % 5) as f64 / 4.0];
        let position = [place(i, 0), place(i, 1), place(i, 2)];
        if i.is_multiple_of(4) {
            json!({"type": "spot", "position": position, "direction": [0.3, -1, 0.1], "color": color, "intensity": 0.4,
                   "outer_cone_degrees": 60, "range": range})
        } else {
            json!({"type": "point", "position": position, "color": color, "intensity": 0.2, "range": range})
        }
    };
    (0..count).map(light).collect()
}

/// Textures and transparency, many spheres, and instances; each with its lights.
fn scenes() -> Vec<(&'static str, Scene, Value)> {
    vec![
        ("detail", demo("detail"), strewn(300, [0.0, 0.5, 0.0], [4.0, 1.0, 3.0], 0.6)),
        ("grid", demo("grid"), strewn(500, [0.0, 0.0, 0.5], [8.0, 8.0, 2.0], 0.8)),
        ("instances", imported(many_instances(5)), strewn(200, [0.0, 0.5, 0.0], [6.0, 1.0, 6.0], 1.0)),
    ]
}

#[test]
fn deferred_and_forward_give_the_same_picture() {
    for (name, scene, lights) in scenes() {
        let by = |path: &str| preview(&scene, json!({"lights": lights, "preview": {"path": path, "gizmos": true}}));
        let (deferred, forward) = (by("deferred"), by("forward"));
        let differing = part_differing(&deferred, &forward, STEP);
        assert!(differing <= 1e-3, "{name}: {:.3} % of the pixels differ", 100.0 * differing);
        assert!(deferred.pixels.iter().any(|pixel| pixel[0] > 0.1), "{name}: all is dark");
    }
}

#[test]
fn culling_changes_no_bit() {
    for (name, scene, lights) in scenes() {
        for path in ["deferred", "forward"] {
            let by = |culling: bool| {
                preview(&scene, json!({"lights": lights, "preview": {"path": path, "culling": culling}}))
            };
            assert_eq!(by(true).pixels, by(false).pixels, "{name}, {path}");
        }
    }
}

#[test]
fn the_same_request_gives_the_same_bits() {
    let (_, scene, lights) = scenes().swap_remove(0);
    for algorithm in ["pcss_noise", "ray"] {
        let shadows = json!({"algorithm": algorithm, "light_size": 0.1, "taps": 8, "max_lights": 3});
        let draw = || preview(&scene, json!({"lights": lights, "preview": {"samples": 3, "shadows": shadows}}));
        assert_eq!(draw().pixels, draw().pixels, "{algorithm}");
    }
}

/// Ten thousand lights of which one reaches the floor are that one light.
#[test]
fn lights_that_reach_nothing_change_nothing() {
    let scene = scene(vec![(square(1.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY)]);
    let draw = |count: usize| {
        let far =
            (1..count).map(|i| json!({"type": "point", "position": [0, 3.0 + 0.001 * i as f64, 0], "range": 2.5}));
        let near = json!({"type": "point", "position": [0, 0.5, 0], "range": 2});
        let lights: Vec<Value> = std::iter::once(near).chain(far).collect();
        preview(&scene, json!({"lights": lights, "camera": {"position": [0, 2, 2], "target": [0, 0, 0]}}))
    };
    assert_eq!(draw(10_000).pixels, draw(1).pixels);
}

/// The mean of many frames approaches the pixel's area; one frame shows its centre.
#[test]
fn frames_smooth_edges() {
    let white = candela::scene::Material { unlit: true, ..Default::default() };
    let scene = scene(vec![(square(1.0), white, DAffine3::from_rotation_y(0.3))]);
    let coverage = |samples: u32| {
        let mut params = request(json!({
            "camera": {"position": [0, 5, 0], "target": [0, 0, 0], "up": [0, 0, -1], "yfov_degrees": 40},
            "filter": {"kind": "box", "radius": 0.5}, "lights": [{"type": "ambient"}], "preview": {"samples": samples}}));
        params.filter.radius = Some(0.5);
        let picture = super::drawn(work(&scene, &params));
        let partial = picture.pixels.iter().filter(|p| p[3] > 0.01 && p[3] < 0.99).count();
        (partial, picture.pixels.iter().map(|p| f64::from(p[3])).sum::<f64>() / 4096.0)
    };
    let (hard, _) = coverage(1);
    let (soft, area) = coverage(64);
    let height = 2.0 * 5.0 * 20.0f64.to_radians().tan();
    let expected = 4.0 / (height * height);
    assert_eq!(hard, 0);
    assert!(soft > 80, "{soft} pixels at the edge");
    assert!((area - expected).abs() < 2e-3, "{area} for {expected}");
}

#[test]
fn gizmos_show_where_lights_are_and_hide_behind_things() {
    let scene = scene(vec![(square(1.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY)]);
    for (kind, path) in [("point", "deferred"), ("point", "forward"), ("spot", "deferred")] {
        let centre = |height: f64| {
            let light = json!({"type": kind, "position": [0, height, 0], "color": [0, 1, 0], "intensity": 0.5,
                               "outer_cone_degrees": 90});
            let mut light = light;
            if kind == "spot" {
                light["direction"] = json!([0, 1, 0]);
            } else if let Some(fields) = light.as_object_mut() {
                fields.remove("outer_cone_degrees");
            }
            let picture = preview(
                &scene,
                json!({"lights": [light], "preview": {"gizmos": true, "path": path},
                       "camera": {"position": [0, 3, 0], "target": [0, 0, 0], "up": [0, 0, -1], "yfov_degrees": 30}}),
            );
            picture.pixels[32 * 64 + 32]
        };
        assert_eq!(centre(1.0), [0.0, 1.0, 0.0, 1.0], "{kind}, {path}");
        assert_ne!(centre(-1.0), [0.0, 1.0, 0.0, 1.0], "{kind}, {path}: seen through the floor");
    }
}
