//! Denoising: without a library, with one that fails, and with the real one where it is present.

use crate::engine;
use crate::support::{Server, Setup, tiny};
use candela::demo;
use candela::denoise::{Bounds, Denoiser, Guidance};
use candela::film::Picture;
use candela::jobs::EngineFactory;
use candela::render::Engines;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::Command;

fn asked(extra: &Value) -> Value {
    let mut params = tiny();
    params["denoise"] = json!(true);
    for (name, value) in extra.as_object().into_iter().flatten() {
        params[name] = value.clone();
    }
    params
}

/// A server whose denoiser greets as version 9.9.9 and then does as a shell does.
fn with_shell(script: &'static str, engines: EngineFactory) -> Server {
    let start = move || {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        Ok(command)
    };
    let denoiser = Denoiser::find(Box::new(start), None, Bounds::default()).expect("it greets");
    Server::set_up(Setup { denoiser: Some(denoiser), ..Setup::default() }, engines)
}

/// The real one; none, told aloud: its library is not here.
fn real() -> Option<Denoiser> {
    let place = std::env::var_os("CANDELA_OIDN").map(PathBuf::from);
    let start = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_candela"));
        command.arg("denoise");
        Ok(command)
    };
    match Denoiser::find(Box::new(start), place.as_deref(), Bounds::default()) {
        Ok(denoiser) => Some(denoiser),
        Err(why) if place.is_some() => panic!("CANDELA_OIDN: {why}"),
        Err(why) => {
            eprintln!("SKIPPED: {why} (script/oidn, and CANDELA_OIDN)");
            None
        }
    }
}

fn real_engines() -> EngineFactory {
    Box::new(|| Ok(Box::new(Engines::new())))
}

#[test]
fn without_a_library_it_is_refused_before_the_work() {
    let server = Server::start();
    assert_eq!(server.get("/v1/limits").json()["denoiser"], Value::Null);
    let scene = server.upload();
    let reply = server.post_json("/v1/jobs", &json!({ "scene": scene, "params": asked(&json!({})) }));
    let problem = reply.problem(422, "denoiser_missing");
    assert_eq!(problem["errors"][0]["pointer"], "/params/denoise");
    assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("script/oidn")), "{problem}");
    let items = format!("{}\n", json!({ "scene": scene, "params": asked(&json!({})) }));
    let problem = server.post("/v1/batches", "application/x-ndjson", items.as_bytes()).problem(422, "denoiser_missing");
    assert_eq!(problem["errors"][0]["pointer"], "/items/0/params/denoise");
    let preview = asked(&json!({ "mode": "preview" }));
    let problem =
        server.post_json("/v1/jobs", &json!({ "scene": scene, "params": preview })).problem(422, "invalid_params");
    assert_eq!(problem["errors"][0]["pointer"], "/params/denoise");
    let plain = server.begin(&scene, &tiny());
    server.wait_for(&plain, &["succeeded"]);
    let reply = server.get(&format!("/v1/jobs/{plain}/result"));
    assert_eq!(reply.header("candela-denoised"), Some("no"));
    let detail = server.get(&format!("/v1/jobs/{plain}/result?aov=undenoised")).problem(406, "not_acceptable");
    assert!(detail["detail"].as_str().is_some_and(|detail| detail.contains("denoise: true")), "{detail}");
}

#[cfg(unix)]
#[test]
fn a_denoiser_that_crashes_leaves_the_picture_as_it_was_traced_and_says_so() {
    let script = r"printf '\007\0\0\0\0\0\0\0\0\0059.9.9'; head -c 1 >/dev/null; kill -SEGV $$";
    let server = with_shell(script, real_engines());
    assert_eq!(server.get("/v1/limits").json()["denoiser"], "Open Image Denoise 9.9.9");
    let scene = server.upload();
    let picture = |params: &Value| {
        let id = server.begin(&scene, params);
        let job = server.wait_for(&id, &["succeeded", "failed"]);
        (job, server.send("GET", &format!("/v1/jobs/{id}/result"), &[("accept", "image/png")], &[]), id)
    };
    let (job, reply, id) = picture(&asked(&json!({ "engine": "cpu" })));
    assert_eq!((&job["state"], &job["report"]["denoised"]), (&json!("succeeded"), &Value::Null), "{job}");
    let warnings = job["report"]["warnings"].as_array().cloned().unwrap_or_default();
    let failed = warnings.iter().find(|warning| warning["code"] == "denoise_failed").expect("a warning");
    assert!(failed["detail"].as_str().is_some_and(|detail| detail.contains("signal: 11")), "{failed}");
    assert_eq!(reply.header("candela-denoised"), Some("no"));
    assert!(!job["report"]["biases"].to_string().contains("denoise"), "{job}");
    server.get(&format!("/v1/jobs/{id}/result?aov=undenoised")).problem(406, "not_acceptable");
    // Tried again, not taken from the first.
    let (again, ..) = picture(&asked(&json!({ "engine": "cpu" })));
    assert!(again["report"]["seconds"]["trace"] != job["report"]["seconds"]["trace"], "{again}");
    let (_, plain, _) = picture(&{
        let mut params = tiny();
        params["engine"] = json!("cpu");
        params
    });
    let pixels = |reply: &[u8]| image::load_from_memory(reply).expect("a PNG").to_rgb8();
    assert_eq!(pixels(&plain.body), pixels(&reply.body));
}

#[test]
fn a_render_without_guides_is_not_denoised() {
    // The engine of the tests traces none.
    let script = r"printf '\007\0\0\0\0\0\0\0\0\0059.9.9'";
    if cfg!(not(unix)) {
        return;
    }
    let server = with_shell(script, engine::faulty(engine::Fault::None, 0));
    let scene = server.upload();
    let id = server.begin(&scene, &asked(&json!({})));
    let job = server.wait_for(&id, &["succeeded", "failed"]);
    assert!(job["report"]["warnings"].to_string().contains("before albedo and normals"), "{job}");
}

#[test]
fn the_reply_names_the_denoiser_and_keeps_what_it_was_given() {
    let Some(denoiser) = real() else { return };
    let name = denoiser.name();
    let server = Server::set_up(Setup { denoiser: Some(denoiser), ..Setup::default() }, real_engines());
    let glb = demo::by_name("grid").expect("the demo");
    let scene = server.post("/v1/scenes", "model/gltf-binary", &glb).json()["id"].as_str().expect("an id").to_owned();
    let more = json!({ "engine": "cpu", "width": 61, "height": 37, "max_samples": 8, "output": { "format": "exr" } });
    let params = asked(&more);
    let id = server.begin(&scene, &params);
    let job = server.wait_for(&id, &["succeeded", "failed"]);
    assert_eq!(job["report"]["denoised"], json!(name), "{job}");
    assert!(job["report"]["biases"].to_string().contains("denoise:"), "{job}");
    assert!(job["report"]["seconds"]["denoise"].as_f64().is_some_and(|seconds| seconds > 0.0), "{job}");
    let result = |id: &str, query: &str| server.get(&format!("/v1/jobs/{id}/result{query}"));
    let denoised = result(&id, "");
    assert_eq!(denoised.header("candela-denoised"), Some(name.as_str()));

    let mut plain = params.clone();
    plain["denoise"] = json!(false);
    let plain_id = server.begin(&scene, &plain);
    let plain_job = server.wait_for(&plain_id, &["succeeded"]);
    assert_eq!(plain_job["report"]["error"], job["report"]["error"], "the error is that of the picture before");
    let (plain, undenoised) = (pixels(&result(&plain_id, "").body), pixels(&result(&id, "?aov=undenoised").body));
    assert_eq!(plain, undenoised);
    assert_ne!(plain, pixels(&denoised.body));
    let within =
        |aov: &str, low: f32| pixels(&result(&id, aov).body).iter().flatten().all(|value| (low..=1.0).contains(value));
    assert!(within("?aov=albedo", 0.0) && within("?aov=normal", -1.0));

    let body = json!({ "scene": scene, "params": params }).to_string();
    let headers = [("content-type", "application/json"), ("cache-control", "no-cache"), ("prefer", "wait=60")];
    let again = server.send("POST", "/v1/jobs", &headers, body.as_bytes());
    assert!(again.body == denoised.body, "the same request, other bytes");
}

/// Pixels of an EXR.
fn pixels(file: &[u8]) -> Vec<[f32; 3]> {
    image::load_from_memory(file).expect("an EXR").to_rgb32f().pixels().map(|pixel| pixel.0).collect()
}

/// Light of a mean, with noise of its own size that is the same every time.
fn noisy(width: u32, height: u32, mean: f32) -> Picture {
    let noise = |i: u32| (i.wrapping_mul(747_796_405).wrapping_add(1) ^ (i >> 3)).wrapping_mul(277_803_737) >> 8;
    let value = |i: u32| mean * 2.0 * noise(i) as f32 / (1 << 24) as f32;
    let pixels = (0..width * height).map(|i| [value(3 * i), value(3 * i + 1), value(3 * i + 2), 1.0]).collect();
    Picture { width, height, pixels }
}

fn mean(picture: &Picture) -> f64 {
    let sum: f64 = picture.pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).map(f64::from).sum();
    sum / (3 * picture.pixels.len()) as f64
}

#[test]
fn any_size_and_any_brightness_keep_their_mean() {
    let Some(denoiser) = real() else { return };
    let smooth = |picture: &Picture| denoiser.denoise(picture, None, Guidance::None, &|| true).expect("a picture");
    // Even light with noise as large as itself.
    for (width, height) in [(1, 1), (3, 2), (1, 300), (257, 129)] {
        for brightness in [0.5, 1e-9, 1e6] {
            let raw = noisy(width, height, brightness);
            let (before, after) = (mean(&raw), mean(&smooth(&raw)));
            let ratio = after / before;
            eprintln!("{width} x {height} at {brightness:e}: {ratio:.4}");
            assert!((ratio - 1.0).abs() < 0.02, "{width} x {height} at {brightness:e}: {after:e} for {before:e}");
        }
    }
    let raw = noisy(64, 64, 0.5);
    assert_eq!(smooth(&raw), smooth(&raw), "the same bytes");
}

#[test]
fn lamps_nothing_and_coverage_stay_what_they_are() {
    let Some(denoiser) = real() else { return };
    let smooth = |picture: &Picture| denoiser.denoise(picture, None, Guidance::None, &|| true).expect("a picture");
    let mut raw = noisy(96, 64, 0.5);
    for (index, pixel) in raw.pixels.iter_mut().enumerate() {
        match (index % 96, index / 96) {
            (0..20, 0..20) => *pixel = [1e30, 1e30, 1e30, 1.0],
            (40..60, 0..20) => *pixel = [1e5, 1e5, 1e5, 1.0],
            (80.., _) => *pixel = [0.0; 4],
            _ => pixel[3] = 0.5,
        }
    }
    let made = smooth(&raw);
    let at = |x: usize, y: usize| made.pixels[y * 96 + x];
    assert_eq!((at(5, 5), at(90, 30)), ([1e30, 1e30, 1e30, 1.0], [0.0; 4]));
    assert!((at(50, 10)[0] / 1e5 - 1.0).abs() < 0.05, "{:?}", at(50, 10));
    assert!(made.pixels.iter().zip(&raw.pixels).all(|(made, raw)| made[3] == raw[3]));
    assert!(made.pixels.iter().flatten().all(|value| value.is_finite() && *value >= 0.0));
    let dim = |picture: &Picture| {
        let places = (40..64).flat_map(|y| (0..70).map(move |x| y * 96 + x));
        places.map(|place| f64::from(picture.pixels[place][1])).sum::<f64>()
    };
    let ratio = dim(&made) / dim(&raw);
    assert!((ratio - 1.0).abs() < 0.05, "beside blinding light: {ratio}");
}
