//! Materials with extensions: their lobes are the tracer's, and through glass is seen what the tracer sees.

use super::agreement::{assert_agrees, assert_same};
use super::preview;
use crate::support::{grey, mean, render, scene, sphere, square, work};
use candela::film::Picture;
use candela::params::{EngineChoice, RenderParams};
use candela::scene::{Extended, Material, Scene, Volume};
use glam::{DAffine3, DVec3, Vec3, Vec4};
use serde_json::{Value, json};
use std::sync::Arc;

fn with(extended: Extended) -> Material {
    Material { extended: Some(Arc::new(extended)), ..grey(0.6, 0.5, 0.0) }
}

/// On convex bodies without shadows, under one light, pixel by pixel.
#[test]
fn layers_are_those_of_the_tracer() {
    let cases: [fn() -> Material; 2] = [
        || {
            with(Extended {
                clearcoat: 0.8,
                clearcoat_roughness: 0.4,
                ior: 1.9,
                specular_color: Vec3::new(1.0, 0.5, 0.2),
                ..Extended::default()
            })
        },
        || with(Extended { iridescence: 1.0, iridescence_thickness: [100.0, 400.0], ..Extended::default() }),
    ];
    for material in cases {
        assert_agrees(material, "pbr", |work| work);
    }
}

/// Asserts the same of a sheet under a lamp.
fn assert_same_on_a_sheet(material: Material, lamp: [f64; 3]) {
    let scene = scene(vec![(square(1.0), material, DAffine3::IDENTITY)]);
    let mut extra = json!({"camera": {"position": [0, 2, 1], "target": [0, 0, 0]},
                           "lights": [{"type": "point", "position": lamp, "intensity": 20}]});
    let drawn = preview(&scene, extra.clone());
    super::merge(&mut extra, json!({"mode": "direct", "max_samples": 1}));
    let traced = render(EngineChoice::Cpu, work(&scene, &super::request(extra)));
    assert_same(&drawn, &traced, "a sheet");
}

/// On a sheet alone: at a body's rim sheen grows so fast that the rasteriser's place of a pixel, a 256th of one off, is to be seen.
#[test]
fn sheen_is_that_of_the_tracer() {
    let sheen = Extended { sheen_color: Vec3::new(1.0, 0.3, 0.1), sheen_roughness: 0.5, ..Extended::default() };
    assert_same_on_a_sheet(with(sheen), [0.8, 1.0, 0.5]);
}

/// A leaf with the lamp behind it.
#[test]
fn light_from_behind_passes_diffusely() {
    let green = Vec3::new(0.2, 1.0, 0.1);
    let leaf = with(Extended { diffuse_transmission: 0.7, diffuse_transmission_color: green, ..Extended::default() });
    assert_same_on_a_sheet(Material { double_sided: true, ..leaf }, [0.3, -1.0, 0.2]);
}

/// The preview, and the tracer with as many bounces as glass needs.
fn both(scene: &Scene, extra: &Value) -> [Picture; 2] {
    let mut traced = json!({"mode": "path", "max_bounces": 12, "max_samples": 256, "adaptive": false, "width": 32,
                            "height": 32, "filter": {"kind": "box", "radius": 0.5}});
    super::merge(&mut traced, extra.clone());
    let params: RenderParams = serde_json::from_value(traced).expect("parameters");
    [preview(scene, extra.clone()), render(EngineChoice::Cpu, work(scene, &params))]
}

fn assert_near_in_all_channels(what: &str, [drawn, traced]: &[Picture; 2], tolerance: f64) {
    for channel in 0..3 {
        let (got, expected) = (mean(drawn, channel), mean(traced, channel));
        assert!(expected > 0.01, "{what}: all is dark");
        assert!((got / expected - 1.0).abs() < tolerance, "{what}, channel {channel}: {got} for {expected}");
    }
}

/// A coloured floor behind a tinted wall, and behind a filled sheet, which absorbs besides.
#[test]
fn what_stands_behind_glass_is_seen_in_its_colour() {
    let floor = Material { unlit: true, base_color: Vec4::new(0.9, 0.5, 0.2, 1.0), ..Material::default() };
    let camera =
        json!({"camera": {"position": [0, 3, 0.5], "target": [0, 0, 0], "yfov_degrees": 20}, "environment": null});
    let volume = Some(Volume { attenuation_color: Vec3::new(0.3, 0.8, 0.5), attenuation_distance: 0.5 });
    for (name, volume) in [("thin", None), ("filled", volume)] {
        let mut pane = with(Extended { transmission: 1.0, volume, ..Extended::default() });
        (pane.base_color, pane.roughness, pane.double_sided) = (Vec4::new(0.5, 0.9, 0.7, 1.0), 0.0, true);
        let at = |height| DAffine3::from_translation(DVec3::new(0.0, height, 0.0));
        let mut parts = vec![(square(4.0), floor.clone(), DAffine3::IDENTITY), (square(2.0), pane.clone(), at(1.0))];
        if volume.is_some() {
            let under = at(0.8) * DAffine3::from_rotation_x(std::f64::consts::PI);
            parts.push((square(2.0), pane, under));
        }
        assert_near_in_all_channels(name, &both(&scene(parts), &camera), 0.02);
    }
}

/// A ball bends a sky; what is left out is light that is reflected within it, one part in 25 at each side.
#[test]
fn a_glass_ball_shows_the_sky_upside_down() {
    let clear = Some(Volume { attenuation_color: Vec3::ONE, attenuation_distance: f32::INFINITY });
    let mut glass = with(Extended { transmission: 1.0, volume: clear, ..Extended::default() });
    (glass.base_color, glass.roughness) = (Vec4::ONE, 0.0);
    let ball = scene(vec![(sphere(64), glass, DAffine3::IDENTITY)]);
    let sky = json!({"camera": {"position": [0, 0, 4], "target": [0, 0, 0], "yfov_degrees": 20},
                     "environment": {"gradient": {"top": [0.2, 0.4, 1], "horizon": [0.5, 0.5, 0.5], "bottom": [1, 0.6, 0.1]}}});
    let pictures = both(&ball, &sky);
    assert_near_in_all_channels("ball", &pictures, 0.06);
    let row = |picture: &Picture, part: f64| {
        let row = (part * f64::from(picture.height)) as usize * picture.width as usize;
        let middle = row + picture.width as usize / 2;
        picture.pixels[middle]
    };
    for picture in &pictures {
        let (above, below) = (row(picture, 0.3), row(picture, 0.7));
        assert!(above[0] > above[2] && below[2] > below[0], "{above:?} above {below:?}");
    }
}
