//! What runs in processes of its own is killed and stopped: the server and all that was accepted go on.
//!
//! Only where the system says which processes there are (Linux).

use crate::server::Server;
use candela::demo;
use serde_json::{Value, json};
use std::process::Command;
use std::time::{Duration, Instant};

fn skips() -> bool {
    let skips = !cfg!(target_os = "linux");
    if skips {
        eprintln!("SKIPPED: no list of processes here");
    }
    skips
}

/// The process of that subcommand which the server has started, once there is one.
fn process(server: &Server, subcommand: &str) -> String {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(30) {
        if let Some(found) = server.children().into_iter().find(|(_, arguments)| arguments.ends_with(subcommand)) {
            return found.0;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("no process of `{subcommand}`");
}

fn signal(name: &str, process: &str) {
    assert!(Command::new("kill").args([name, process]).status().expect("kill runs").success());
}

fn begin(server: &Server, scene: &str, params: &Value) -> String {
    let body = json!({ "scene": scene, "params": params });
    let (status, job) = server.send("POST", "/v1/jobs", &body, true, None).expect("a reply");
    assert_eq!(status, 202, "{job}");
    job["id"].as_str().expect("an id").to_owned()
}

fn wait(server: &Server, id: &str, reached: impl Fn(&Value) -> bool) -> Value {
    let begun = Instant::now();
    loop {
        let job = server.get(&format!("/v1/jobs/{id}")).1;
        if reached(&job) {
            return job;
        }
        assert!(begun.elapsed() < Duration::from_secs(120), "{job}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn has_samples(job: &Value) -> bool {
    assert_ne!(job["state"], "succeeded", "it ended before anything was done to it");
    job["progress"]["samples"].as_u64().is_some_and(|samples| samples > 0)
}

fn picture() -> Value {
    json!({ "engine": "cpu", "width": 64, "height": 48, "max_samples": 120 })
}

#[test]
fn a_killed_or_stopped_engine_is_replaced_and_the_picture_is_the_same() {
    if skips() {
        return;
    }
    let glb = demo::by_name("grid").expect("the demo");
    let undisturbed = {
        let server = Server::start_with(None, &["--apart", "false"]);
        let scene = server.upload(&glb).expect("an upload");
        assert!(server.children().is_empty());
        server.result(&begin(&server, &scene, &picture()))
    };
    let server = Server::start_with(None, &["--device-seconds", "10"]);
    let scene = server.upload(&glb).expect("an upload");
    let calm = begin(&server, &scene, &picture());
    assert!(server.result(&calm) == undisturbed, "another process, another picture");
    for (name, other) in [("-KILL", 1), ("-STOP", 2)] {
        let (id, beside) = (
            begin(&server, &scene, &picture()),
            begin(
                &server,
                &scene,
                &json!({ "engine": "cpu", "width": 32, "height": 32, "max_samples": 400, "seed": other }),
            ),
        );
        wait(&server, &id, has_samples);
        let victim = process(&server, "engine");
        let begun = Instant::now();
        signal(name, &victim);
        assert_eq!(server.get("/v1/limits").0, 200);
        assert!(server.result(&id) == undisturbed, "after {name}");
        assert!(!server.result(&beside).is_empty());
        assert_ne!(process(&server, "engine"), victim);
        eprintln!("after {name} both pictures were there in {:.1?}", begun.elapsed());
    }
}

#[test]
fn a_render_that_ends_its_engine_again_and_again_fails_alone() {
    if skips() {
        return;
    }
    let server = Server::start_with(None, &[]);
    let scene = server.upload(&demo::by_name("grid").expect("the demo")).expect("an upload");
    let endless = json!({ "engine": "cpu", "width": 64, "height": 64, "max_samples": 1_000_000 });
    let id = begin(&server, &scene, &endless);
    let (mut killed, mut samples) = (0, 0);
    let job = loop {
        let has_more = |job: &Value| job["progress"]["samples"].as_u64().is_some_and(|now| now > samples);
        let job = wait(&server, &id, |job| job["state"] == "failed" || has_more(job));
        if job["state"] == "failed" {
            break job;
        }
        assert!(killed < 10, "{job}");
        samples = job["progress"]["samples"].as_u64().unwrap_or_default();
        signal("-KILL", &process(&server, "engine"));
        killed += 1;
    };
    assert_eq!(job["problem"]["code"], "render_failed", "{job}");
    assert!(job["problem"]["detail"].as_str().is_some_and(|detail| detail.contains("signal: 9")), "{job}");
    assert_eq!(killed, 2);
    assert!(!server.result(&begin(&server, &scene, &picture())).is_empty());
}

#[test]
fn an_engine_that_died_while_idle_is_replaced_without_a_trace() {
    if skips() {
        return;
    }
    let server = Server::start_with(None, &[]);
    let scene = server.upload(&demo::by_name("grid").expect("the demo")).expect("an upload");
    let first = server.result(&begin(&server, &scene, &picture()));
    signal("-KILL", &process(&server, "engine"));
    std::thread::sleep(Duration::from_millis(50));
    assert!(server.result(&begin(&server, &scene, &picture())) == first);
}

#[test]
fn an_import_that_is_killed_or_hangs_is_refused_and_nothing_else_suffers() {
    if skips() {
        return;
    }
    let server = Server::start_with(None, &["--import-seconds", "3"]);
    // Large enough that its reading is seen.
    let glb = demo::by_name("bumpy-1m").expect("the demo");
    for name in ["-KILL", "-STOP"] {
        let reply = std::thread::scope(|scope| {
            let upload = scope.spawn(|| server.post("/v1/scenes", "model/gltf-binary", &glb));
            signal(name, &process(&server, "import"));
            assert_eq!(server.get("/v1/limits").0, 200);
            upload.join().expect("a reply")
        });
        assert_eq!((reply.0, &reply.1["code"]), (422, &json!("import_failed")), "{name}: {}", reply.1);
    }
    let (status, scene) = server.post("/v1/scenes", "model/gltf-binary", &glb);
    assert_eq!(status, 201, "{scene}");
}
