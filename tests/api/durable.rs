//! What outlives a request, and a server: data folders, ids of clients, results that serve again.

use crate::engine;
use crate::events::{Heard, listen};
use crate::support::{Reply, Server, endless, tiny, triangle};
use candela::config::Limits;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;

/// A server of the test's engine that keeps its data, and saves films every 20 ms.
fn keeping(folder: &Path) -> Server {
    let limits = Limits { save_film_ms: 20, ..Limits::default() };
    Server::in_folder(Some(folder), limits, engine::faulty(engine::Fault::None, 0), Duration::ZERO)
}

fn post(server: &Server, key: &str, body: &Value) -> Reply {
    let headers = [("content-type", "application/json"), ("idempotency-key", key)];
    server.send("POST", "/v1/jobs", &headers, body.to_string().as_bytes())
}

fn put(server: &Server, id: &str, body: &Value) -> Reply {
    let headers = [("content-type", "application/json")];
    server.send("PUT", &format!("/v1/jobs/{id}"), &headers, body.to_string().as_bytes())
}

fn result(server: &Server, id: &str) -> Vec<u8> {
    let reply = server.get(&format!("/v1/jobs/{id}/result"));
    assert_eq!(reply.status, 200, "{reply:?}");
    reply.body
}

#[test]
fn a_restart_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let long = json!({ "width": 32, "height": 16, "max_samples": 600, "output": { "format": "png" } });
    let (scene, done, picture, running, queued, heard);
    {
        let server = keeping(folder.path());
        scene = server.upload();
        done = server.begin(&scene, &tiny());
        server.wait_for(&done, &["succeeded"]);
        picture = result(&server, &done);
        running = server.begin(&scene, &long);
        queued = server.begin(&scene, &json!({ "width": 32, "height": 16, "max_samples": 500, "seed": 2 }));
        heard = listen(&server, &running, None, |heard| heard.iter().any(|e| e.data["samples"].as_u64() > Some(50)));
        server.send("DELETE", &format!("/v1/scenes/{scene}"), &[], &[]);
    }
    let server = keeping(folder.path());
    assert_eq!(result(&server, &done), picture);
    let tag = [("accept", "image/x-exr")];
    assert_eq!(server.send("GET", &format!("/v1/jobs/{done}/result"), &tag, &[]).status, 200);
    server.get(&format!("/v1/scenes/{scene}")).problem(404, "scene_not_found");

    let last = heard.last().expect("events").id;
    let rest = listen(&server, &running, Some(last), |_| false);
    let kinds: Vec<_> = rest.iter().filter(|e| !["progress", "preview"].contains(&e.kind.as_str())).collect();
    assert_eq!(kinds.iter().map(|e| e.kind.as_str()).collect::<Vec<_>>(), ["queued", "started", "completed"]);
    assert_eq!(kinds[0].data["again"], true);
    assert!(rest.iter().all(|event| event.id > last) && rest.is_sorted_by(|a, b| a.id < b.id));
    server.wait_for(&queued, &["succeeded"]);

    // From its saved film or from the beginning: the bytes are those of a server that was not disturbed.
    let other = Server::with(Limits::default(), engine::faulty(engine::Fault::None, 0), Duration::ZERO);
    let undisturbed = other.begin(&other.upload(), &long);
    other.wait_for(&undisturbed, &["succeeded"]);
    assert_eq!(result(&server, &running), result(&other, &undisturbed));
}

#[test]
fn a_render_goes_on_from_its_saved_film() {
    let folder = tempfile::tempdir().unwrap();
    let (id, before, shown) = {
        let server = keeping(folder.path());
        let id = server.begin(&server.upload(), &endless());
        let far = |heard: &[Heard]| heard.iter().any(|e| e.data["samples"].as_u64() > Some(100));
        let heard = listen(&server, &id, None, |heard| far(heard) && heard.iter().any(|e| e.kind == "preview"));
        let preview = heard.iter().rev().find(|e| e.kind == "preview").expect("a preview");
        (id, preview.data["n"].as_u64(), heard.last().expect("events").id)
    };
    let server = keeping(folder.path());
    // Numbers of previews go on, so that their addresses are new.
    let number = |heard: &[Heard]| heard.iter().rev().find(|e| e.kind == "preview").and_then(|e| e.data["n"].as_u64());
    assert!(number(&listen(&server, &id, Some(shown), |heard| number(heard).is_some())) > before);
    let heard = listen(&server, &id, None, |heard| heard.iter().any(|e| e.kind == "started" && e.id > 4));
    let started = heard.last().expect("events").id;
    let heard = listen(&server, &id, Some(started), |heard| heard.iter().any(|e| e.kind == "progress"));
    let samples = heard.last().expect("progress").data["samples"].as_u64();
    assert!(samples > Some(100), "{samples:?}");
}

#[test]
fn a_request_that_waited_ends_with_its_server() {
    let folder = tempfile::tempdir().unwrap();
    let id = {
        let server = keeping(folder.path());
        std::thread::scope(|scope| {
            let path = "/v1/render?width=64&height=64&max_samples=4000000";
            let client = scope.spawn(|| server.post(path, "model/gltf-binary", &triangle()));
            while server.get("/v1/jobs").json()["items"][0]["state"] != "running" {
                std::thread::sleep(Duration::from_millis(5));
            }
            let id = server.get("/v1/jobs").json()["items"][0]["id"].as_str().expect("an id").to_owned();
            server.stop();
            client.join().expect("a client").problem(503, "shutting_down");
            id
        })
    };
    assert_eq!(keeping(folder.path()).job(&id)["state"], "failed");
}

#[test]
fn a_folder_has_one_server() {
    let folder = tempfile::tempdir().unwrap();
    let _server = keeping(folder.path());
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    let second = candela::jobs::Service::start_in(Some(folder.path()), Limits::default(), engine::any());
    let error = runtime.block_on(second).err().expect("a refusal").to_string();
    assert!(error.contains("another server"), "{error}");
}

#[test]
fn the_same_key_is_the_same_job() {
    let server = Server::start();
    let scene = server.upload();
    let body = |seed| json!({ "scene": scene, "params": { "width": 16, "height": 8, "max_samples": 4, "seed": seed } });
    let first = post(&server, "a", &body(1));
    let again = post(&server, "a", &body(1));
    assert_eq!((first.status, again.status), (202, 202));
    assert_eq!(first.json()["id"], again.json()["id"]);
    assert_ne!(post(&server, "b", &body(1)).json()["id"], first.json()["id"]);
    post(&server, "a", &body(2)).problem(422, "idempotency_mismatch");
    for odd in [&"k".repeat(256), "a b", "a\tb", "\u{e4}"] {
        post(&server, odd, &body(1)).problem(400, "bad_request");
    }
    post(&server, &"k".repeat(255), &body(1)).json()["id"].as_str().expect("an id");
}

#[test]
fn a_client_may_choose_the_id() {
    let server = Server::start();
    let scene = server.upload();
    let body = json!({ "scene": scene, "params": tiny() });
    for _ in 0..2 {
        let reply = put(&server, "shot_7.b-2", &body);
        assert_eq!((reply.status, reply.header("location")), (202, Some("/v1/jobs/shot_7.b-2")), "{reply:?}");
    }
    server.wait_for("shot_7.b-2", &["succeeded"]);
    assert_eq!(put(&server, "shot_7.b-2", &body).json()["state"], "succeeded");
    put(&server, "shot_7.b-2", &json!({ "scene": scene, "params": endless() })).problem(409, "job_conflict");
    for bad in ["job-1", "a%20b", ".a", "%C3%A4", &"x".repeat(65)] {
        put(&server, bad, &body).problem(422, "invalid_params");
    }
    assert_eq!(put(&server, &"x".repeat(64), &body).status, 202);
}

#[test]
fn asking_again_needs_no_scene() {
    let server = Server::start();
    let scene = server.upload();
    let body = json!({ "scene": scene, "params": tiny(), "priority": 3 });
    let batch = || {
        let headers = [("content-type", "application/x-ndjson"), ("idempotency-key", "k")];
        server.send("POST", "/v1/batches", &headers, format!("{body}\n").as_bytes())
    };
    let ask = || [put(&server, "mine", &body), post(&server, "k", &body), batch()];
    let first = ask();
    assert_eq!(server.delete(&format!("/v1/scenes/{scene}")).status, 204);
    for (first, again) in first.iter().zip(ask()) {
        assert_eq!((again.status, &again.json()["id"]), (202, &first.json()["id"]), "{again:?}");
    }
    let other = json!({ "scene": scene, "params": tiny(), "priority": 4 });
    put(&server, "mine", &other).problem(409, "job_conflict");
    post(&server, "k", &other).problem(422, "idempotency_mismatch");
    put(&server, "other", &body).problem(404, "scene_not_found");
}

#[test]
fn an_id_that_serves_again_is_not_read_from_a_cache() {
    let server = Server::start();
    let scene = server.upload();
    let picture = |seed: u32| {
        let params = json!({ "width": 16, "height": 8, "max_samples": 4, "seed": seed });
        assert_eq!(put(&server, "shot", &json!({ "scene": scene, "params": params })).status, 202);
        server.wait_for("shot", &["succeeded"]);
        ["result", "preview?n=1"].map(|part| server.get(&format!("/v1/jobs/shot/{part}")))
    };
    let first = picture(1);
    assert_eq!(server.delete("/v1/jobs/shot").status, 204);
    for (first, second) in first.iter().zip(picture(2)) {
        assert_ne!(first.header("etag"), second.header("etag"));
        assert_eq!(first.header("cache-control"), Some("private, no-cache"), "whoever has it asks whether it holds");
    }
}

#[test]
fn what_was_rendered_is_not_rendered_again() {
    let server = Server::start();
    let scene = server.upload();
    let begin = |headers: &[(&str, &str)]| {
        let headers = [&[("content-type", "application/json")], headers].concat();
        let body = json!({ "scene": scene, "params": tiny() }).to_string();
        let reply = server.send("POST", "/v1/jobs", &headers, body.as_bytes());
        let id = reply.json()["id"].as_str().expect("an id").to_owned();
        server.wait_for(&id, &["succeeded"]);
        listen(&server, &id, None, |_| false).pop().expect("an event")
    };
    assert_eq!(begin(&[]).data["cached"], false);
    assert_eq!(begin(&[]).data["cached"], true);
    assert_eq!(begin(&[("cache-control", "no-cache")]).data["cached"], false);
    let path = "/v1/render?width=16&height=8&max_samples=4";
    let first = server.post(path, "model/gltf-binary", &triangle());
    let tag = first.header("etag").expect("a tag").to_owned();
    let job = format!("/v1/jobs/{}/result", first.header("candela-job").expect("a job"));
    for known in [tag.as_str(), "*"] {
        let looked = server.send("GET", &job, &[("if-none-match", known)], &[]);
        assert_eq!((looked.status, looked.header("etag"), looked.body.len()), (304, Some(tag.as_str()), 0));
        // What is asked for is made: the condition is about what a request merely looks at (RFC 9110, 13.1.2).
        let headers = [("content-type", "model/gltf-binary"), ("if-none-match", known)];
        let again = server.send("POST", path, &headers, &triangle());
        assert_eq!((first.status, again.status), (200, 200));
        assert!(again.body == first.body);
    }
}

#[test]
fn what_a_clock_has_ended_serves_nobody_else() {
    let server = Server::start();
    let scene = server.upload();
    let params = json!({ "width": 64, "height": 64, "max_samples": 4_000_000, "deadline_ms": 50 });
    for _ in 0..2 {
        let id = server.begin(&scene, &params);
        server.wait_for(&id, &["succeeded"]);
        assert_eq!(listen(&server, &id, None, |_| false).pop().expect("an event").data["cached"], false);
    }
}

#[test]
fn a_lost_file_comes_back_with_its_upload() {
    let folder = tempfile::tempdir().unwrap();
    let blobs = folder.path().join("blobs");
    let (scene, done) = {
        let server = keeping(folder.path());
        let scene = server.upload();
        let done = server.begin(&scene, &tiny());
        server.wait_for(&done, &["succeeded"]);
        (scene, done)
    };
    std::fs::remove_dir_all(&blobs).unwrap();
    let server = keeping(folder.path());
    let order = json!({ "scene": scene, "params": tiny() });
    post(&server, "lost", &order).problem(404, "scene_not_found");
    assert_eq!(server.upload(), scene);
    // The picture that was made before is lost as well, so that it is made anew.
    let again = post(&server, "found", &order).json()["id"].as_str().unwrap().to_owned();
    server.wait_for(&again, &["succeeded"]);
    assert!(!result(&server, &again).is_empty());
    // It has the same bytes, and so is there again for the first job, too.
    assert!(!result(&server, &done).is_empty());
}
