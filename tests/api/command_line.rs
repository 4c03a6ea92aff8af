//! `candela render --manifest`: the same pictures here and from a server.

use crate::engine;
use crate::support::{Server, Setup, endless, radiance, tiny, triangle, triangle_text, vertices};
use candela::config::Limits;
use candela::render::Engines;
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

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
fn pictures_of_a_manifest_replace_nothing_that_nobody_named() {
    let folder = folder();
    let params = json!({ "engine": "cpu", "width": 8, "height": 8, "max_samples": 1 });
    let line = |name: &str| format!("{}\n", json!({ "scene": "triangle.glb", "name": name, "params": params }));
    std::fs::write(folder.path().join("two.ndjson"), [line("new"), line("old")].concat()).unwrap();
    let (old, new) = (folder.path().join("old.png"), folder.path().join("new.png"));
    std::fs::write(&old, b"mine").unwrap();
    let refused = candela(folder.path(), &["two.ndjson", "-q"]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(2) && said.contains("old.png") && said.contains("-o ."), "{said}");
    assert!(std::fs::read(&old).unwrap() == b"mine" && !new.exists(), "nothing is rendered");
    assert!(candela(folder.path(), &["two.ndjson", "-q", "-o", "."]).status.success());
    assert!(std::fs::read(&old).unwrap() != b"mine" && new.exists());
}

/// A command that has a server render the lines `name`, `params`.
fn send(folder: &Path, server: &Server, lines: &[(&str, &Value)]) -> Child {
    let line = |(name, params): &(&str, &Value)| {
        format!("{}\n", json!({ "scene": "triangle.glb", "name": name, "params": params }))
    };
    std::fs::write(folder.join("sent.ndjson"), lines.iter().map(line).collect::<String>()).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_candela"));
    command.args(["render", "--manifest", "sent.ndjson", "-o", "out", "--server", &server.url("")]);
    command.current_dir(folder).stderr(Stdio::piped()).spawn().expect("candela runs")
}

/// Waits for the first item of the newest batch to be running.
fn under_way(server: &Server) -> Value {
    let begun = Instant::now();
    loop {
        let batches = server.get("/v1/batches").json();
        if let Some(id) = batches["items"][0]["id"].as_str() {
            let batch = server.get(&format!("/v1/batches/{id}")).json();
            if batch["counts"]["running"].as_u64() > Some(0) {
                return batch;
            }
        }
        assert!(begun.elapsed() < Duration::from_secs(30), "{batches}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_manifest_outlives_a_restart_of_its_server() {
    let (folder, data) = (folder(), tempfile::tempdir().unwrap());
    let start = |address| {
        let limits = Limits { save_film_ms: 20, ..Limits::default() };
        let setup = Setup { folder: Some(data.path().to_owned()), limits, address, ..Setup::default() };
        Server::set_up(setup, engine::faulty(engine::Fault::None, 0))
    };
    let long = json!({ "width": 64, "height": 64, "max_samples": 4_000_000, "deadline_ms": 3_000 });
    let server = start(None);
    let command = send(folder.path(), &server, &[("a", &tiny()), ("b", &long)]);
    under_way(&server);
    let address = server.address;
    drop(server);
    std::thread::sleep(Duration::from_millis(1500));
    let server = start(Some(address));
    let done = command.wait_with_output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(["a", "b"].iter().all(|name| folder.path().join(format!("out/{name}.png")).is_file()));
    assert_eq!(server.get("/v1/batches").json()["items"].as_array().map(Vec::len), Some(1), "sent once");
}

#[test]
fn a_command_that_is_stopped_cancels_what_it_has_begun() {
    let folder = folder();
    let server = Server::with(Limits::default(), engine::faulty(engine::Fault::None, 0), Duration::ZERO);
    for (signal, code) in [(rustix::process::Signal::TERM, 143), (rustix::process::Signal::INT, 130)] {
        let command = send(folder.path(), &server, &[("a", &endless()), ("b", &endless())]);
        let batch = under_way(&server);
        rustix::process::kill_process(rustix::process::Pid::from_child(&command), signal).unwrap();
        let done = command.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.code() == Some(code) && said.contains("cancelled"), "{:?}: {said}", done.status);
        let batch = server.get(batch["links"]["self"].as_str().expect("a link")).json();
        assert_eq!(batch["counts"]["cancelled"], 2, "{batch}");
    }
    // One that cannot go on cancels, too.
    std::fs::create_dir_all(folder.path().join("out/c.png")).unwrap();
    let command = send(folder.path(), &server, &[("c", &tiny()), ("d", &endless())]);
    assert_eq!(command.wait_with_output().unwrap().status.code(), Some(1));
    let newest = server.get("/v1/batches?limit=1").json()["items"][0].clone();
    assert_eq!(newest["counts"]["cancelled"], 1, "{newest}");
}

#[test]
fn keys_that_are_made_at_once_are_all_kept() {
    let folder = tempfile::tempdir().unwrap();
    let key = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_candela"));
        command.args(["key", "--keys", "keys.json"]).args(arguments).current_dir(folder.path());
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("candela runs")
    };
    for what in [vec!["list"], vec!["revoke", "k0"]] {
        let none = key(&what).wait_with_output().unwrap();
        assert!(none.status.code() == Some(2) && none.stdout.is_empty(), "{none:?}");
    }
    let names: Vec<String> = (0..12).map(|n| format!("k{n}")).collect();
    let made: Vec<Child> = names.iter().map(|name| key(&["add", name])).collect();
    for command in made {
        let done = command.wait_with_output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    }
    let listed = String::from_utf8(key(&["list"]).wait_with_output().unwrap().stdout).unwrap();
    assert_eq!(listed.lines().count(), 13, "{listed}");
    let files: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().file_name()).collect();
    assert!(files.iter().all(|file| !file.to_string_lossy().contains("new")), "{files:?}");
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
