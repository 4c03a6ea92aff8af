//! `mode: preview` against the path tracer's direct light, closed forms and itself.

mod agreement;
mod layers;
mod light;
mod shadows;

use crate::support::{engines, work};
use candela::film::Picture;
use candela::params::RenderParams;
use candela::render::prepare::render_to_end;
use candela::render::{NonFinite, Work};
use candela::scene::{Limits, Package, Scene, import};
use serde_json::{Value, json};

/// What one step of an 8-bit channel is in radiance between 0 and 1.
const STEP: f32 = 1.0 / 255.0;

/// Parameters of a preview that shows pixels' centres, without environment and shadows, over which `extra` goes.
fn request(extra: Value) -> RenderParams {
    let mut params = json!({
        "mode": "preview", "width": 64, "height": 64, "environment": null, "filter": {"kind": "box", "radius": 0.001},
        "output": {"transparent": true}, "preview": {"samples": 1, "shadows": {"algorithm": "none"}},
    });
    merge(&mut params, extra);
    serde_json::from_value(params).expect("parameters")
}

/// Lays one object over another, fields within fields.
fn merge(target: &mut Value, over: Value) {
    match (target, over) {
        (Value::Object(target), Value::Object(over)) => {
            over.into_iter().for_each(|(name, value)| merge(target.entry(name).or_insert(Value::Null), value));
        }
        (target, over) => *target = over,
    }
}

fn drawn(work: Work) -> Picture {
    let rendered = render_to_end(&mut *engines(), work, &mut |_| {}).expect("a preview");
    assert_eq!(rendered.non_finite, NonFinite::default(), "non-finite pixels");
    rendered.film.picture()
}

/// The preview of a scene.
fn preview(scene: &Scene, extra: Value) -> Picture {
    drawn(work(scene, &request(extra)))
}

/// A scene that Candela makes itself.
fn demo(name: &str) -> Scene {
    imported(candela::demo::by_name(name).expect("a demo"))
}

fn imported(glb: Vec<u8>) -> Scene {
    let limits = Limits::default();
    let package = Package::from_bytes(glb, &limits).expect("a package");
    import(&package, &limits).expect("a scene")
}

/// Largest difference of a pixel's channels.
fn difference(a: &[f32; 4], b: &[f32; 4]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Part of the pixels that differ by more than `step`.
fn part_differing(a: &Picture, b: &Picture, step: f32) -> f64 {
    let differing = a.pixels.iter().zip(&b.pixels).filter(|(a, b)| difference(a, b) > step).count();
    differing as f64 / a.pixels.len() as f64
}
