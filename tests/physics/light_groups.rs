//! Light split by what emitted it: groups add up to the picture, and each is the picture with the other lights off.

use crate::support::{engines, grey, params, scene, sphere, square, work};
use candela::film::{Aov, Film, encode_aov};
use candela::params::EngineChoice;
use candela::render::prepare::render_to_end;
use candela::render::{NonFinite, Work};
use candela::scene::{Extended, Light, LightKind, Material, Node, Scene, Volume};
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use glam::{DAffine3, DVec3, Vec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::io::Cursor;
use std::sync::Arc;

/// Pictures of each kind: their seeds differ.
const SEEDS: usize = 16;

/// Difference of two means in terms of its error that by chance is exceeded once in 1000 runs of the test, which makes 15 comparisons:
/// of Student's t with 30 degrees of freedom at a significance of 1 - 0.999^(1/15).
const MOST_T: f64 = 4.55;

/// A floor, a rough ball, one of glass, something unlit, a lamp, and a light of the file.
fn room(glows: bool) -> Scene {
    let glow = if glows { Vec3::new(3.0, 2.0, 1.0) } else { Vec3::ZERO };
    let lamp = Material { emissive: glow, ..grey(0.1, 1.0, 0.0) };
    let volume = Some(Volume { attenuation_color: Vec3::ONE, attenuation_distance: f32::INFINITY });
    let glass = Extended { transmission: 1.0, volume, ..Extended::default() };
    let glass = Material { extended: Some(Arc::new(glass)), ..grey(1.0, 0.0, 0.0) };
    let sign = Material { unlit: glows, ..grey(if glows { 0.4 } else { 0.0 }, 1.0, 0.0) };
    let at = |x, y, z| DAffine3::from_translation(DVec3::new(x, y, z));
    let small = |x, z| at(x, 0.5, z) * DAffine3::from_scale(DVec3::splat(0.5));
    let mut room = scene(vec![
        (square(4.0), grey(0.7, 0.5, 0.0), DAffine3::IDENTITY),
        (sphere(12), grey(0.8, 0.3, 0.5), small(-0.8, 0.0)),
        (sphere(12), glass, small(0.6, 0.6)),
        (square(0.3), sign, at(1.5, 0.02, -0.5)),
        (square(0.5), lamp, at(0.0, 2.5, 0.0) * DAffine3::from_rotation_x(PI)),
    ]);
    let (intensity, kind) = (Vec3::new(1.0, 2.0, 4.0), LightKind::Point);
    room.lights.push(Light { name: None, intensity, range: None, kind, profile: None });
    room.scenes[0].nodes.push(room.nodes.len());
    room.nodes.push(Node { light: Some(0), local: at(-2.0, 1.5, 1.0), ..Node::default() });
    room
}

fn lights() -> Vec<Value> {
    vec![
        json!({"type": "spot", "position": [2, 3, 2], "direction": [-2, -3, -2], "intensity": 30, "color": [1, 0.5, 0.2]}),
        json!({"type": "rect", "position": [-2, 2, -1], "direction": [2, -2, 1], "intensity": 4, "color": [0.3, 1, 0.6]}),
        json!({"type": "sphere", "position": [1.5, 1.5, -1.5], "radius": 0.2, "intensity": 9}),
        json!({"type": "ambient", "intensity": 0.1}),
    ]
}

fn asked(extra: &Value) -> Value {
    let mut all = json!({"environment": {"gradient": {"top": [0.5, 0.6, 0.9], "horizon": [0.4, 0.4, 0.4], "bottom": [0.1, 0.1, 0.1]}},
        "camera": {"position": [0, 2.5, 5], "target": [0, 0.6, 0], "yfov_degrees": 40},
        "lights": lights(), "light_groups": {"key": [0], "fill": [1, 2]}, "max_samples": 32, "width": 24, "height": 24});
    for (name, value) in extra.as_object().into_iter().flatten() {
        all[name] = value.clone();
    }
    all
}

fn traced(mut work: Work) -> Film {
    work.settings.engine = EngineChoice::Auto;
    let rendered = render_to_end(&mut *engines(), work, &mut |_| {}).expect("a render");
    assert_eq!(rendered.non_finite, NonFinite::default(), "non-finite samples");
    rendered.film
}

fn film(scene: &Scene, extra: &Value) -> Film {
    traced(work(scene, &params(&asked(extra).to_string())))
}

/// Layers of the file by name, as red, green and blue by pixel; the picture itself has no name.
fn layers(film: &Film) -> BTreeMap<String, Vec<[f32; 3]>> {
    let file = encode_aov(&film.aovs(), Aov::LightGroups, &[]).expect("groups").expect("a file");
    let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let image = image.from_buffered(Cursor::new(file)).expect("an EXR");
    let mut layers = BTreeMap::new();
    for channel in &image.layer_data.channel_data.list {
        let name = channel.name.to_string();
        let (layer, channel_name) = name.rsplit_once('.').unwrap_or(("", &name));
        let place = ["R", "G", "B"].iter().position(|known| *known == channel_name).expect("a colour");
        let FlatSamples::F32(values) = &channel.sample_data else { panic!("samples are not f32") };
        let pixels = layers.entry(layer.to_owned()).or_insert_with(|| vec![[0.0; 3]; values.len()]);
        pixels.iter_mut().zip(values).for_each(|(pixel, value)| pixel[place] = *value);
    }
    layers
}

fn means(pixels: &[[f32; 3]]) -> [f64; 3] {
    let mean = |channel: usize| pixels.iter().map(|pixel| f64::from(pixel[channel])).sum::<f64>();
    [0, 1, 2].map(|channel| mean(channel) / pixels.len() as f64)
}

#[test]
fn groups_add_up_to_the_picture() {
    for extra in [json!({}), json!({"mode": "direct"}), json!({"adaptive": false, "max_bounces": 2})] {
        let film = film(&room(true), &extra);
        let layers = layers(&film);
        let names: Vec<&str> = layers.keys().map(String::as_str).collect();
        assert_eq!(names, ["", "environment", "fill", "key", "lights", "surfaces"]);
        let whole = film.picture();
        for (place, pixel) in whole.pixels.iter().enumerate() {
            for channel in 0..3 {
                let sum: f32 = layers.iter().filter(|(name, _)| !name.is_empty()).map(|(_, l)| l[place][channel]).sum();
                for (what, found) in [("sum", sum), ("layer without a name", layers[""][place][channel])] {
                    let beauty = pixel[channel];
                    assert!((found - beauty).abs() <= 2e-6 * beauty.max(0.1), "{what} {found} for {beauty}, {extra}");
                }
            }
        }
        assert!(layers.iter().all(|(name, layer)| means(layer)[1] > 1e-3 || panic!("{name} is dark in {extra}")));
    }
}

#[test]
fn splitting_changes_no_picture() {
    let split = film(&room(true), &json!({})).picture();
    let mut plain = work(&room(true), &params(&asked(&json!({"light_groups": null})).to_string()));
    assert!(plain.lighting.groups.is_empty());
    plain.settings.engine = EngineChoice::Cpu;
    let plain = render_to_end(&mut *engines(), plain, &mut |_| {}).expect("a render").film;
    assert!(plain.aovs().picture(Aov::LightGroups).is_none());
    assert_eq!(split.pixels, plain.picture().pixels);
}

#[test]
fn each_group_is_the_picture_with_the_others_off() {
    let named = lights();
    let off = json!({"environment": null, "scene_lights": false, "lights": [], "light_groups": null});
    let with = |fields: Value| {
        let mut all = off.clone();
        for (name, value) in fields.as_object().into_iter().flatten() {
            all[name] = value.clone();
        }
        all
    };
    let sky = asked(&json!({}))["environment"].clone();
    let alone = [
        ("environment", false, with(json!({"environment": sky, "lights": [named[3]]}))),
        ("surfaces", true, off.clone()),
        ("lights", false, with(json!({"scene_lights": true}))),
        ("key", false, with(json!({"lights": [named[0]]}))),
        ("fill", false, with(json!({"lights": [named[1], named[2]]}))),
    ];
    let whole = room(true);
    let split: Vec<_> = (0..SEEDS).map(|seed| layers(&film(&whole, &json!({ "seed": seed })))).collect();
    for (name, glows, request) in alone {
        let scene = room(glows);
        let of_alone = (0..SEEDS).map(|seed| {
            let mut request = request.clone();
            request["seed"] = json!(1000 + seed);
            let mut work = work(&scene, &params(&asked(&request).to_string()));
            work.settings.engine = EngineChoice::Cpu;
            let film = render_to_end(&mut *engines(), work, &mut |_| {}).expect("a render").film;
            means(&film.picture().pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect::<Vec<_>>())
        });
        let (of_alone, of_group): (Vec<_>, Vec<_>) =
            (of_alone.collect(), split.iter().map(|s| means(&s[name])).collect());
        for channel in 0..3 {
            let moments = |of: &[[f64; 3]]| {
                let mean = of.iter().map(|means| means[channel]).sum::<f64>() / SEEDS as f64;
                let squares = of.iter().map(|means| (means[channel] - mean).powi(2)).sum::<f64>();
                (mean, squares / (SEEDS * (SEEDS - 1)) as f64)
            };
            let ((a, of_a), (b, of_b)) = (moments(&of_alone), moments(&of_group));
            let t = (a - b) / (of_a + of_b).sqrt();
            eprintln!("{name} {channel}: alone {a:.5}, of the whole {b:.5}, t = {t:.2}");
            assert!(t.abs() < MOST_T, "{name}: {a} alone, {b} of the whole");
        }
    }
}
