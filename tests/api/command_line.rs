//! `candela render --manifest`: the same pictures here and from a server.

use crate::support::{Server, radiance, triangle, triangle_text, vertices};
use candela::config::Limits;
use candela::render::Engines;
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

/// A folder with scenes, an environment and a manifest that names them.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("triangle.glb", &triangle());
    write("parts.gltf", triangle_text("parts.bin").as_bytes());
    write("parts.bin", &vertices());
    write("sky.hdr", &radiance());
    let params = |more: Value| {
        let mut params = json!({ "engine": "cpu", "width": 16, "height": 8, "max_samples": 4 });
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        params
    };
    let lines = [
        json!({ "scene": "triangle.glb", "name": "plain", "params": params(json!({})) }),
        json!({ "scene": "parts.gltf", "params": params(json!({ "output": { "format": "exr" } })) }),
        json!({ "scene": "triangle.glb", "name": "sky", "params": params(json!({ "environment": { "hdri": "sky.hdr" } })) }),
        json!({ "scene": "triangle.glb", "name": "bad", "params": params(json!({ "camera": { "index": 7 } })) }),
    ];
    write("manifest.ndjson", lines.map(|line| format!("{line}\n")).concat().as_bytes());
    folder
}

fn candela(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_candela"));
    command.args(["render", "--manifest"]).args(arguments).current_dir(folder).env("NODEVICE_SELECT", "1");
    command.output().expect("candela runs")
}

#[test]
fn a_manifest_gives_the_same_pictures_here_and_there() {
    let folder = folder();
    let factory = Box::new(|| Ok(Box::new(Engines::new()) as Box<dyn candela::render::Engine>));
    let server = Server::with(Limits { batch_items: 3, ..Limits::default() }, factory, Duration::ZERO);
    for (output, more) in [("here", vec![]), ("there", vec!["--server".to_owned(), server.url("")])] {
        let mut arguments = vec!["manifest.ndjson", "--output", output];
        arguments.extend(more.iter().map(String::as_str));
        let done = candela(folder.path(), &arguments);
        let said = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{said}");
        assert!(said.contains("bad: FAILED") && said.contains("1 of 4 pictures failed"), "{said}");
    }
    for name in ["plain.png", "0001.exr", "sky.png"] {
        let [here, there] =
            ["here", "there"].map(|output| std::fs::read(folder.path().join(output).join(name)).unwrap());
        assert!(here == there && here.len() > 100, "{name}");
    }
    assert_eq!(server.get("/v1/batches").json()["items"].as_array().map(Vec::len), Some(2), "parts of at most 3");
}

#[test]
fn a_manifest_is_sent_in_parts_that_the_server_reads() {
    let folder = folder();
    // A line with all its parameters has more than a fifth of that.
    let limits = Limits { manifest_bytes: 4_000, ..Limits::default() };
    let factory = Box::new(|| Ok(Box::new(Engines::new()) as Box<dyn candela::render::Engine>));
    let server = Server::with(limits, factory, Duration::ZERO);
    let params = json!({ "engine": "cpu", "width": 16, "height": 8, "max_samples": 4 });
    let lines =
        (0..5).map(|n| format!("{}\n", json!({ "scene": "triangle.glb", "name": format!("n{n}"), "params": params })));
    std::fs::write(folder.path().join("five.ndjson"), lines.collect::<String>()).unwrap();
    let done = candela(folder.path(), &["five.ndjson", "--output", "out", "--server", &server.url("")]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!((0..5).all(|n| folder.path().join(format!("out/n{n}.png")).is_file()));
    let batches = server.get("/v1/batches").json()["items"].as_array().map_or(0, Vec::len);
    assert!((2..5).contains(&batches), "{batches} parts");
    let long = format!("{}\n", json!({ "scene": server.upload(), "name": "x".repeat(90) })).repeat(80);
    let problem = server.post("/v1/batches", "application/x-ndjson", long.as_bytes()).problem(413, "payload_too_large");
    assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("manifest_bytes")), "{problem}");
    assert_eq!(server.get("/v1/limits").json()["manifest_bytes"], 4_000);
}

#[test]
fn a_picture_that_nobody_named_is_not_replaced() {
    let folder = folder();
    let render = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_candela"));
        command.args(["render", "triangle.glb", "--set", "width=16", "--set", "height=8", "--set", "max_samples=1"]);
        command.args(["--set", "engine=cpu", "--quiet"]).args(more).current_dir(folder.path());
        command.output().expect("candela runs")
    };
    assert!(render(&[]).status.success());
    let (file, before) = (folder.path().join("triangle.png"), b"mine".as_slice());
    std::fs::write(&file, before).unwrap();
    let refused = render(&[]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("-o triangle.png"));
    assert_eq!(std::fs::read(&file).unwrap(), before);
    assert!(render(&["-o", "triangle.png"]).status.success());
    assert_ne!(std::fs::read(&file).unwrap(), before);
}

#[test]
fn what_is_wrong_with_a_manifest_is_said_before_anything_is_rendered() {
    let folder = folder();
    let write = |text: &str| std::fs::write(folder.path().join("bad.ndjson"), text).unwrap();
    for (text, says) in [
        ("{\"scene\": \"triangle.glb\", \"params\": {\"width\": 0}}", "/items/0/params/width"),
        ("{\"scene\": \"triangle.glb\"}\n{", "line 2"),
        ("{\"scene\": \"triangle.glb\", \"nmae\": \"a\"}", "nmae"),
        ("{\n\"scenes\": [\"triangle.glb\"],\n\"params\": {\"width\": 9}\n\"cameras\": []\n}", "line 4 column 1"),
        ("{\n\"scenes\": [\"triangle.glb\"],\n\"cameras\": [{\"blades\": 2}]\n}", "/cameras/0/blades"),
        ("", "/items"),
    ] {
        write(text);
        let done = candela(folder.path(), &["bad.ndjson", "--output", "out"]);
        let said = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.code() == Some(2) && said.contains(says), "{text}: {said}");
    }
    let done = candela(folder.path(), &["manifest.ndjson", "--server", "127.0.0.1:1"]);
    assert!(String::from_utf8_lossy(&done.stderr).contains("http://"));
    let done = candela(folder.path(), &["manifest.ndjson", "--server", "http://127.0.0.1:1"]);
    assert_eq!(done.status.code(), Some(1), "nobody listens");
}
