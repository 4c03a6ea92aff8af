//! Animated scenes: one upload, pictures at several times.

use crate::support::{Server, glb};
use serde_json::{Value, json};

/// A square that an animation `slide` moves out of the picture within two seconds, and one `wink` that moves the camera.
fn sliding() -> Vec<u8> {
    let floats: Vec<f32> = [
        &[-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 1.0, 1.0, 0.0, -1.0, 1.0, 0.0][..],
        &[0.0, 2.0],
        &[0.0, 0.0, 0.0, 100.0, 0.0, 0.0],
    ]
    .concat();
    let mut bin: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    bin.extend([0_u8, 1, 2, 0, 2, 3, 0, 0]);
    let animation = |name: &str, node: u32| {
        json!({"name": name, "samplers": [{"input": 1, "output": 2}],
            "channels": [{"sampler": 0, "target": {"node": node, "path": "translation"}}]})
    };
    let json = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0, 5]}],
        "cameras": [{"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 9, "znear": 0}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 3}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 2, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"},
            {"bufferView": 3, "componentType": 5121, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 8},
            {"buffer": 0, "byteOffset": 56, "byteLength": 24}, {"buffer": 0, "byteOffset": 80, "byteLength": 6},
        ],
        "buffers": [{"byteLength": bin.len()}],
        "animations": [animation("slide", 0), animation("wink", 1)],
    });
    glb(&json.to_string(), &bin)
}

fn params(more: &Value) -> Value {
    let mut params = json!({"width": 8, "height": 8, "max_samples": 1, "camera": {"index": 0}});
    params.as_object_mut().expect("an object").extend(more.as_object().expect("an object").clone());
    params
}

#[test]
fn a_scene_is_rendered_at_several_times() {
    let server = Server::start();
    let reply = server.post("/v1/scenes", "model/gltf-binary", &sliding());
    let description = reply.json();
    let slide = json!({"index": 0, "name": "slide", "start_seconds": 0.0, "end_seconds": 2.0});
    assert_eq!((reply.status, &description["animations"][0]), (201, &slide), "{reply:?}");
    let scene = description["id"].as_str().expect("an id");
    let report = |more: Value| {
        let job = server.wait_for(&server.begin(scene, &params(&more)), &["succeeded", "failed"]);
        assert_eq!(job["state"], "succeeded", "{job}");
        job["report"].clone()
    };
    let defaults = |report: &Value| {
        let list = report["defaults"].as_array().expect("a list").clone();
        list.into_iter()
            .filter(|d| ["animation", "time"].contains(&d["what"].as_str().unwrap_or_default()))
            .collect::<Vec<_>>()
    };
    assert!(defaults(&report(json!({}))).is_empty());
    let timed = report(json!({"time": 1.5}));
    assert_eq!(defaults(&timed), [json!({"what": "animation", "value": {"index": 0, "name": "slide"}})]);
    assert_eq!(defaults(&report(json!({"animation": 1}))), [json!({"what": "time", "value": 0.0})]);
    assert!(defaults(&report(json!({"animation": "wink", "time": 0.5}))).is_empty());
}

#[test]
fn faults_name_their_field() {
    let server = Server::start();
    let scene = server.post("/v1/scenes", "model/gltf-binary", &sliding()).json()["id"].clone();
    let fault = |more: Value| {
        let job =
            server.wait_for(&server.begin(scene.as_str().expect("an id"), &params(&more)), &["succeeded", "failed"]);
        assert_eq!(job["state"], "failed", "{job}");
        job["problem"]["errors"][0].clone()
    };
    for animation in [json!("jump"), json!(2)] {
        let fault = fault(json!({ "animation": animation }));
        assert_eq!(fault["pointer"], "/params/animation");
        let detail = fault["detail"].as_str().expect("text");
        assert!(detail.ends_with("the file has 0 (\"slide\"), 1 (\"wink\")"), "{detail}");
    }
    let refused = server.post_json("/v1/jobs", &json!({"scene": scene, "params": {"animation": [1]}}));
    assert_eq!(refused.json()["errors"][0]["pointer"], "/params/animation", "{refused:?}");
    assert!(refused.json()["errors"][0]["detail"].as_str().expect("text").contains("the index or the name"));
}

#[test]
fn a_shutter_takes_time_and_says_where_it_cannot() {
    let server = Server::start();
    let scene = server.post("/v1/scenes", "model/gltf-binary", &sliding()).json()["id"].clone();
    let scene = scene.as_str().expect("an id");
    let report = |more: Value| {
        let job = server.wait_for(&server.begin(scene, &params(&more)), &["succeeded", "failed"]);
        assert_eq!(job["state"], "succeeded", "{job}");
        job["report"].clone()
    };
    let codes = |report: &Value| -> Vec<String> {
        let warnings = report["warnings"].as_array().expect("a list");
        warnings.iter().filter_map(|warning| warning["code"].as_str().map(str::to_owned)).collect()
    };
    let shutter = json!({"open": -0.1, "close": 0.1});
    let blurred = report(json!({"time": 0.5, "shutter": shutter}));
    assert!(!codes(&blurred).contains(&"shutter_ignored".to_owned()), "{blurred}");
    let taken = report(json!({"shutter": shutter}));
    let named = |what: &str| taken["defaults"].as_array().expect("a list").iter().any(|d| d["what"] == what);
    assert!(named("animation") && named("time"), "{taken}");
    let direct = report(json!({"time": 0.5, "shutter": shutter, "mode": "direct"}));
    assert!(codes(&direct).contains(&"shutter_ignored".to_owned()), "{direct}");
    for (shutter, pointer) in [
        (json!({"open": 1, "close": 0}), "/params/shutter/close"),
        (json!({"open": 0, "close": 1, "steps": 99}), "/params/shutter/steps"),
        (json!({"open": 0}), "/params/shutter/close"),
        (json!({"open": 0, "close": 1, "angle": 180}), "/params/shutter/angle"),
    ] {
        let refused = server.post_json("/v1/jobs", &json!({"scene": scene, "params": {"shutter": shutter}}));
        assert_eq!((refused.status, &refused.json()["errors"][0]["pointer"]), (422, &json!(pointer)), "{refused:?}");
    }
}
