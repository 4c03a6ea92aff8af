//! Shadow algorithms against closed form: a disk light over a half-plane's edge; and maps against rays.

use super::{demo, merge, part_differing, preview};
use crate::support::{grey, scene, sphere, square};
use candela::film::Picture;
use candela::scene::Scene;
use glam::{DAffine3, DQuat, DVec3};
use serde_json::{Value, json};
use std::f64::consts::PI;

/// Height of the light, and of the half-plane, over the floor.
const LIGHT: f64 = 2.0;
const EDGE: f64 = 1.0;
/// Half of the floor that the picture shows, and its pixels across.
const HALF: f64 = 0.5;
const PIXELS: usize = 200;

/// A floor, and over its left half a plane that is one-sided: the camera above sees through its back, light does not.
fn half_plane() -> Scene {
    let turned = DQuat::from_rotation_x(PI);
    let over = DAffine3::from_rotation_translation(turned, DVec3::new(-2.0, EDGE, 0.0));
    scene(vec![(square(3.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY), (square(2.0), grey(0.8, 1.0, 0.0), over)])
}

/// Light that comes through, from left to right along the middle of the picture.
fn profile(kind: &str, shadows: Value) -> Vec<f64> {
    let scene = half_plane();
    let mut light = json!({"type": kind, "intensity": 10});
    merge(
        &mut light,
        match kind {
            "spot" => json!({"position": [0, LIGHT, 0], "direction": [0, -1, 0], "outer_cone_degrees": 40}),
            "directional" => json!({"direction": [0, -1, 0]}),
            _ => json!({"position": [0, LIGHT, 0]}),
        },
    );
    let draw = |shadows: Value| {
        let yfov = 2.0 * (HALF * 20.0 / PIXELS as f64 / 4.0).atan().to_degrees();
        preview(
            &scene,
            json!({"width": PIXELS, "height": 20, "lights": [light], "preview": {"shading": "lambert", "shadows": shadows},
                   "camera": {"position": [0, 4, 0], "target": [0, 0, 0], "up": [0, 0, -1], "yfov_degrees": yfov}}),
        )
    };
    let columns = |picture: &Picture| -> Vec<f64> {
        (0..PIXELS).map(|x| (0..20).map(|y| f64::from(picture.pixels[y * PIXELS + x][0])).sum()).collect()
    };
    let (lit, open) = (columns(&draw(shadows)), columns(&draw(json!({"algorithm": "none"}))));
    lit.iter().zip(&open).map(|(lit, open)| lit / open).collect()
}

/// Place of a column on the floor.
fn place(column: usize) -> f64 {
    2.0 * HALF * ((column as f64 + 0.5) / PIXELS as f64 - 0.5)
}

/// Part of a disk on one side of a line `u` radii from its centre.
fn segment(u: f64) -> f64 {
    let u = u.clamp(-1.0, 1.0);
    0.5 + (u * (1.0 - u * u).sqrt() + u.asin()) / PI
}

/// Root mean square difference from a closed form.
fn rms(profile: &[f64], expected: impl Fn(f64) -> f64) -> f64 {
    let squares = profile.iter().enumerate().map(|(column, got)| (got - expected(place(column))).powi(2));
    (squares.sum::<f64>() / profile.len() as f64).sqrt()
}

/// Distance between the places where a tenth and nine tenths of the light come through.
fn width(profile: &[f64]) -> f64 {
    let place_of = |level: f64| profile.iter().position(|&v| v > level).map_or(f64::NAN, place);
    place_of(0.9) - place_of(0.1)
}

/// 10 % to 90 % of a disk lie between -0.687 and 0.687 radii.
const TENTHS: f64 = 2.0 * 0.687;

#[test]
fn soft_shadows_are_as_wide_as_the_disk_makes_them() {
    for size in [0.2, 0.5] {
        // By similar triangles; a directional light's size is that at distance 1.
        for (kind, radius) in [
            ("spot", 0.5 * size * EDGE / (LIGHT - EDGE)),
            ("point", 0.5 * size * EDGE / (LIGHT - EDGE)),
            ("directional", 0.5 * size * EDGE),
        ] {
            for (algorithm, taps, tolerance) in [("ray", 256, 0.005), ("pcss", 256, 0.01), ("pcss_noise", 256, 0.03)] {
                let shadows = json!({"algorithm": algorithm, "taps": taps, "light_size": size, "map_size": 2048});
                let profile = profile(kind, shadows);
                let error = rms(&profile, |x| segment(x / radius));
                let wide = width(&profile) / (TENTHS * radius);
                eprintln!("{kind} {size} {algorithm}: rms {error:.4}, width {wide:.3} of the closed form's");
                assert!(error < tolerance, "{kind} {size} {algorithm}: {error}");
                // Normal deviates have wider tails than a disk as wide.
                let widest = if algorithm == "pcss_noise" { 1.5 } else { 1.12 };
                assert!(wide > 0.85 && wide < widest, "{kind} {size} {algorithm}: {wide}");
            }
        }
    }
}

#[test]
fn hard_shadows_end_at_the_edge() {
    for kind in ["spot", "point", "directional"] {
        for algorithm in ["basic", "ray"] {
            let profile = profile(kind, json!({"algorithm": algorithm, "taps": 1, "map_size": 2048}));
            // A texel and its bias move the edge by less than a pixel or two of this picture.
            let error = rms(&profile, |x| f64::from(u8::from(x > 0.0)));
            assert!(error < 0.15, "{kind} {algorithm}: {error}");
            assert!(profile.iter().all(|&v| v == 0.0 || (v - 1.0).abs() < 1e-3 || v < 1.0), "{kind} {algorithm}");
        }
    }
}

/// The kernel is so many texels of the map wide: known where the map's extent is. `spot`: the cone of 40 degrees.
#[test]
fn filters_are_as_wide_as_their_kernel() {
    let (radius, size) = (12.0, 512);
    // The map's half width on the floor, by the cone, which is narrower than the scene.
    let half_width = radius * 2.0 * 40.0f64.to_radians().tan() * 1.001 / f64::from(size) * LIGHT;
    let shadows = |algorithm: &str| json!({"algorithm": algorithm, "taps": 576, "radius": radius, "map_size": size});
    let regular = rms(&profile("spot", shadows("pcf")), |x| (0.5 + 0.5 * x / half_width).clamp(0.0, 1.0));
    // Phi(x / sigma), by its logistic approximation to 0.01.
    let deviation = half_width / 3.0f64.sqrt();
    let noisy = rms(&profile("spot", shadows("noise")), |x| 1.0 / (1.0 + (-1.702 * x / deviation).exp()));
    eprintln!("pcf {regular:.4}, noise {noisy:.4}");
    assert!(regular < 0.03, "pcf: {regular}");
    assert!(noisy < 0.03, "noise: {noisy}");
}

/// Objects of several shapes and all kinds of lights: maps and rays must agree but near edges.
#[test]
fn maps_show_what_rays_find() {
    let room = |at: [f64; 3], half: f64| {
        DAffine3::from_scale_rotation_translation(DVec3::splat(half), DQuat::IDENTITY, at.into())
    };
    let objects = scene(vec![
        (square(4.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY),
        (sphere(48), grey(0.5, 0.6, 0.0), room([0.9, 0.6, 0.2], 0.5)),
        (sphere(48), grey(0.5, 0.6, 0.0), room([-1.0, 0.8, -0.6], 0.6)),
    ]);
    for light in [
        json!({"type": "point", "position": [0, 1.5, 0.4], "intensity": 10}),
        json!({"type": "spot", "position": [2, 3, 2], "direction": [-2, -3, -2], "intensity": 30, "outer_cone_degrees": 50}),
        json!({"type": "directional", "direction": [-1, -2, -0.7], "intensity": 3}),
    ] {
        for path in ["deferred", "forward"] {
            let by = |algorithm: &str| {
                let shadows = json!({"algorithm": algorithm, "taps": 1, "map_size": 2048});
                preview(
                    &objects,
                    json!({"width": 128, "height": 128, "lights": [light], "preview": {"path": path, "shadows": shadows},
                           "camera": {"position": [0.5, 3, 5], "target": [0, 0.4, 0], "yfov_degrees": 40}}),
                )
            };
            let (rays, none) = (by("ray"), by("none"));
            let in_shadow = part_differing(&rays, &none, 0.02);
            assert!(in_shadow > 0.02, "{light}: only {in_shadow} in shadow");
            let wrong = part_differing(&by("basic"), &rays, 0.02);
            eprintln!("{path} {light}: {:.2} % in shadow, {:.2} % wrong", 100.0 * in_shadow, 100.0 * wrong);
            assert!(wrong < 0.015, "{path}, {light}: {:.2} % of the pixels", 100.0 * wrong);
        }
    }
}

/// A convex body lit from the side, and a floor at a grazing angle: no tap may find the surface itself.
#[test]
fn surfaces_do_not_shadow_themselves() {
    let body = scene(vec![(sphere(64), grey(0.7, 1.0, 0.0), DAffine3::IDENTITY)]);
    let floor = scene(vec![(square(2.0), grey(0.7, 1.0, 0.0), DAffine3::IDENTITY)]);
    let low = json!({"type": "directional", "direction": [-1, -0.3, -0.2], "intensity": 3});
    for (name, scene) in [("body", &body), ("floor", &floor)] {
        for (algorithm, taps) in
            [("basic", 1), ("pcf", 25), ("noise", 25), ("pcss", 25), ("pcss_noise", 25), ("ray", 4)]
        {
            let by = |algorithm: &str| {
                let shadows = json!({"algorithm": algorithm, "taps": taps, "map_size": 512, "light_size": 0.05});
                preview(
                    scene,
                    json!({"lights": [low], "preview": {"shadows": shadows, "shading": "lambert"},
                           "camera": {"position": [1, 2, 3], "target": [0, 0, 0], "yfov_degrees": 50}}),
                )
            };
            let (shadowed, open) = (by(algorithm), by("none"));
            let light = |p: &Picture| p.pixels.iter().map(|p| f64::from(p[0])).sum::<f64>();
            let lost = 1.0 - light(&shadowed) / light(&open);
            eprintln!("{name} {algorithm}: {:.3} % of the light lost", 100.0 * lost);
            assert!(lost < 0.01, "{name} {algorithm}: {:.2} % of the light is lost", 100.0 * lost);
        }
    }
}

/// Leaves that are cut out of squares, and a pane that fades: their shadows are theirs, not their squares'.
#[test]
fn what_is_cut_away_casts_no_shadow() {
    let scene = demo("detail");
    let light = json!({"type": "directional", "direction": [-0.2, -1, -0.6], "intensity": 3});
    let by = |algorithm: &str| {
        let shadows = json!({"algorithm": algorithm, "taps": 16, "map_size": 2048, "radius": 2});
        preview(
            &scene,
            json!({"scene_lights": false, "lights": [light], "preview": {"shadows": shadows, "samples": 4}}),
        )
    };
    let wrong = part_differing(&by("pcf"), &by("ray"), 0.1);
    assert!(wrong < 0.04, "{:.2} % of the pixels", 100.0 * wrong);
}
