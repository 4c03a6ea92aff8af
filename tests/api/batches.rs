//! `/v1/batches`: manifests in, jobs a few at a time, one zip out.

use crate::engine;
use crate::events::listen_at;
use crate::support::{Reply, Server, endless, tiny};
use candela::config::Limits;
use serde_json::{Value, json};
use std::io::{Cursor, Read};
use std::path::Path;
use std::time::{Duration, Instant};

fn line(scene: &str, name: &str, params: &Value) -> String {
    format!("{}\n", json!({ "scene": scene, "name": name, "params": params }))
}

fn begin(server: &Server, lines: &[String]) -> Value {
    let reply = server.post("/v1/batches", "application/x-ndjson", lines.concat().as_bytes());
    assert_eq!(reply.status, 202, "{reply:?}");
    let batch = reply.json();
    assert_eq!(reply.header("location"), batch["links"]["self"].as_str());
    batch
}

/// Waits for the end of a batch.
fn finished(server: &Server, id: &Value) -> Value {
    let path = format!("/v1/batches/{}", id.as_str().expect("an id"));
    let reply = server.send("GET", &path, &[("prefer", "wait=60")], &[]);
    assert_eq!(reply.header("preference-applied"), Some("wait=60"));
    let batch = reply.json();
    assert_eq!(batch["state"], "finished", "{batch}");
    batch
}

/// Name and content of each entry.
fn entries(reply: &Reply) -> Vec<(String, Vec<u8>)> {
    assert_eq!((reply.status, reply.header("content-type")), (200, Some("application/zip")), "{reply:?}");
    let mut archive = zip::ZipArchive::new(Cursor::new(&reply.body)).expect("a zip");
    let count = archive.len();
    let mut entry = |n| {
        let mut file = archive.by_index(n).expect("an entry");
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).expect("its content");
        (file.name().expect("a name").into_owned(), bytes)
    };
    (0..count).map(&mut entry).collect()
}

/// Keeps its data, and renders one picture at a time.
fn keeping(folder: &Path) -> Server {
    let limits = Limits { save_film_ms: 20, active_renders: 1, ..Limits::default() };
    Server::in_folder(Some(folder), limits, engine::faulty(engine::Fault::TooLarge, 0), Duration::ZERO)
}

#[test]
fn a_manifest_becomes_pictures_in_one_zip() {
    let server = Server::with(Limits::default(), engine::faulty(engine::Fault::TooLarge, 0), Duration::ZERO);
    let scene = server.upload();
    let failing = json!({ "width": 16, "height": 8, "max_samples": 4, "seed": engine::FAULTY_SEED });
    let exr = json!({ "width": 16, "height": 8, "max_samples": 4, "output": { "format": "exr" } });
    let lines = [line(&scene, "one", &tiny()), line(&scene, "two", &failing), line(&scene, "three", &exr)];
    let batch = begin(&server, &lines);
    // The stream begins before the last job has ended.
    let zip = server.get(batch["links"]["results"].as_str().expect("a link"));
    let files = entries(&zip);
    let names: Vec<_> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["one.png", "three.exr", "results.ndjson"]);
    let index: Vec<Value> =
        files[2].1.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
    let told: Vec<_> =
        index.iter().map(|line| (line["name"].clone(), line["state"].clone(), line["file"].clone())).collect();
    assert_eq!(told[1], (json!("two"), json!("failed"), Value::Null));
    assert_eq!(told[2], (json!("three"), json!("succeeded"), json!("three.exr")));
    assert_eq!(index[1]["problem"]["code"], "render_too_large");
    let batch = finished(&server, &batch["id"]);
    let counts = json!({ "queued": 0, "running": 0, "succeeded": 2, "failed": 1, "cancelled": 0 });
    assert_eq!(batch["counts"], counts);
    let job = batch["items"][0]["job"].as_str().expect("an id");
    assert_eq!(server.get(&format!("/v1/jobs/{job}/result")).body, files[0].1);
}

#[test]
fn a_matrix_is_every_combination() {
    let server = Server::start();
    let scene = server.upload();
    let matrix = json!({ "scenes": [scene], "params": tiny(),
        "cameras": [{ "orbit": { "azimuth_degrees": 0 } }, { "orbit": { "azimuth_degrees": 90 } }],
        "lights": [[], [{ "type": "point", "position": [0, 1, 2], "intensity": 5 }]] });
    let reply = server.post_json("/v1/batches", &matrix);
    assert_eq!(reply.status, 202, "{reply:?}");
    let batch = finished(&server, &reply.json()["id"]);
    let names: Vec<_> = batch["items"].as_array().expect("items").iter().map(|item| item["name"].clone()).collect();
    assert_eq!(names, ["camera0_lights0", "camera0_lights1", "camera1_lights0", "camera1_lights1"]);
    assert_eq!(batch["counts"]["succeeded"], 4);
    let list = server.get("/v1/batches?limit=1").json();
    assert_eq!((&list["items"][0]["id"], &list["next"]), (&batch["id"], &Value::Null));
}

#[test]
fn a_batch_is_bounded_and_leaves_the_queue_to_others() {
    let limits =
        Limits { queue_length: 2, batch_items: 5, batch_queue_length: 5, active_renders: 1, ..Limits::default() };
    let server = Server::with(limits, engine::faulty(engine::Fault::None, 0), Duration::ZERO);
    let scene = server.upload();
    let lines = |count: usize| -> Vec<String> {
        (0..count)
            .map(|n| {
                line(&scene, &format!("n{n}"), &json!({ "width": 16, "height": 16, "max_samples": 300, "seed": n + 1 }))
            })
            .collect()
    };
    let post = |count| server.post("/v1/batches", "application/x-ndjson", lines(count).concat().as_bytes());
    post(6).problem(422, "invalid_params");
    let first = begin(&server, &lines(5));
    let full = post(5);
    full.problem(503, "queue_full");
    assert_eq!(full.header("retry-after"), Some("30"));
    // The queue of single jobs is free all the while, and what was accepted is not lost.
    let alone = server.begin(&scene, &tiny());
    server.wait_for(&alone, &["succeeded"]);
    assert_eq!(finished(&server, &first["id"])["counts"]["succeeded"], 5);
    begin(&server, &lines(5));
}

#[test]
fn cancelling_a_batch_ends_what_is_not_over() {
    let server = Server::start();
    let scene = server.upload();
    let batch =
        begin(&server, &[line(&scene, "a", &tiny()), line(&scene, "b", &endless()), line(&scene, "c", &endless())]);
    let job = |n: usize| batch["items"][n]["job"].as_str().expect("an id").to_owned();
    server.wait_for(&job(0), &["succeeded"]);
    server.wait_for(&job(1), &["running"]);
    let begun = Instant::now();
    for _ in 0..2 {
        let reply = server.send("POST", batch["links"]["cancel"].as_str().expect("a link"), &[], &[]);
        assert_eq!(reply.status, 200, "{reply:?}");
        let counts = reply.json()["counts"].clone();
        assert_eq!((&counts["succeeded"], &counts["cancelled"]), (&json!(1), &json!(2)));
    }
    assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
    let files = entries(&server.get(batch["links"]["results"].as_str().expect("a link")));
    assert_eq!(files.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["a.png", "results.ndjson"]);
}

#[test]
fn what_is_wrong_is_said_and_nothing_is_begun() {
    let server = Server::start();
    let scene = server.upload();
    let post = |kind: &str, body: &str| server.post("/v1/batches", kind, body.as_bytes());
    let lines = "application/x-ndjson";
    let good = line(&scene, "a", &tiny());
    let pointer = |reply: &Reply, code| reply.problem(422, code)["errors"][0]["pointer"].clone();
    let wide = post(lines, &[good.clone(), line(&scene, "b", &json!({ "width": 0 }))].concat());
    assert_eq!(pointer(&wide, "invalid_params"), "/items/1/params/width");
    let unknown =
        post(lines, &[good.clone(), line("sha256-none", "b", &tiny())].concat()).problem(404, "scene_not_found");
    assert_eq!(unknown["errors"][0]["pointer"], "/items/1/scene");
    let image = json!({ "environment": { "hdri": "sha256-none" } });
    assert_eq!(pointer(&post(lines, &line(&scene, "a", &image)), "invalid_params"), "/items/0/params/environment/hdri");
    assert_eq!(pointer(&post(lines, ""), "invalid_params"), "/items");
    let matrix = |cameras: Value, scene: &str| {
        post("application/json", &json!({ "scenes": [scene], "cameras": cameras, "params": tiny() }).to_string())
    };
    assert_eq!(pointer(&matrix(json!([{}, { "index": "a" }]), &scene), "invalid_params"), "/cameras/1/index");
    let wide = matrix(json!([null, { "yfov_degrees": 500 }]), &scene).problem(422, "invalid_params");
    assert_eq!(wide["errors"][0]["pointer"], "/cameras/1/yfov_degrees", "what is checked later, too");
    assert!(wide["detail"].as_str().is_some_and(|detail| detail.starts_with("`camera1`: /cameras/1")), "{wide}");
    let unknown = matrix(json!([null]), "sha256-none").problem(404, "scene_not_found");
    assert_eq!(unknown["errors"][0]["pointer"], "/scenes/0");
    assert_eq!(pointer(&post("application/json", "{\"scenes\": []}"), "invalid_params"), "/items");
    assert_eq!(pointer(&matrix(json!([]), &scene), "invalid_params"), "/cameras", "no camera is no picture");
    let cut = post(lines, &[good.as_str(), "{\"scene\": "].concat()).problem(400, "malformed_json");
    assert!(cut["detail"].as_str().is_some_and(|detail| detail.matches("line").count() == 1), "{cut}");
    assert!(cut["detail"].as_str().is_some_and(|detail| detail.ends_with("at line 2 column 10")), "{cut}");
    post("application/json", "[").problem(400, "malformed_json");
    post("text/plain", &good).problem(415, "unsupported_media_type");
    server.get("/v1/batches/none").problem(404, "batch_not_found");
    server.get("/v1/batches/none/results").problem(404, "batch_not_found");
    server.get("/v1/batches?cursor=none").problem(400, "bad_cursor");
    assert_eq!(server.get("/v1/jobs").json()["items"], json!([]), "nothing was begun");
}

#[test]
fn the_same_key_is_the_same_batch() {
    let server = Server::start();
    let scene = server.upload();
    let post = |params: &Value| {
        let headers = [("content-type", "application/x-ndjson"), ("idempotency-key", "k")];
        server.send("POST", "/v1/batches", &headers, line(&scene, "a", params).as_bytes())
    };
    let first = post(&tiny());
    assert_eq!(post(&tiny()).json()["id"], first.json()["id"]);
    post(&json!({})).problem(422, "idempotency_mismatch");
}

#[test]
fn a_restart_loses_no_item() {
    let folder = tempfile::tempdir().unwrap();
    let params = |n: usize| json!({ "width": 16, "height": 16, "max_samples": 80, "seed": n + 1 });
    let (scene, batch);
    {
        let server = keeping(folder.path());
        scene = server.upload();
        let lines: Vec<String> = (0..20).map(|n| line(&scene, &format!("n{n}"), &params(n))).collect();
        batch = begin(&server, &lines);
        server.wait_for(batch["items"][2]["job"].as_str().expect("an id"), &["succeeded"]);
    }
    let server = keeping(folder.path());
    let after = finished(&server, &batch["id"]);
    assert_eq!(after["counts"]["succeeded"], 20, "{after}");
    let jobs = |batch: &Value| -> Vec<Value> {
        batch["items"].as_array().expect("items").iter().map(|item| item["job"].clone()).collect()
    };
    assert_eq!(jobs(&batch), jobs(&after), "the same jobs in the same order");
    let files = entries(&server.get(after["links"]["results"].as_str().expect("a link")));
    assert_eq!(files.len(), 21);
    // The bytes are those of a server that was left alone.
    let other = Server::with(Limits::default(), engine::faulty(engine::Fault::None, 0), Duration::ZERO);
    other.upload();
    for n in [0, 7, 19] {
        let id = other.begin(&scene, &params(n));
        other.wait_for(&id, &["succeeded"]);
        assert_eq!(other.get(&format!("/v1/jobs/{id}/result")).body, files[n].1, "item {n}");
    }
}

#[test]
fn the_jobs_of_a_batch_leave_together() {
    let limits = Limits { kept_jobs: 2, ..Limits::default() };
    let server = Server::with(limits, engine::any(), Duration::ZERO);
    let scene = server.upload();
    let lines: Vec<String> = (0..4).map(|n| line(&scene, &format!("n{n}"), &tiny())).collect();
    let batch = begin(&server, &lines);
    let path = batch["links"]["self"].as_str().expect("a link");
    finished(&server, &batch["id"]);
    std::thread::sleep(Duration::from_millis(200));
    // The newest stays, whole.
    assert_eq!(server.get(path).json()["items"].as_array().map(Vec::len), Some(4));
    for seed in 1..=2 {
        let id = server.begin(&scene, &json!({ "width": 8, "height": 8, "max_samples": 2, "seed": seed }));
        server.wait_for(&id, &["succeeded"]);
    }
    std::thread::sleep(Duration::from_millis(300));
    server.get(path).problem(404, "batch_not_found");
    assert_eq!(server.get("/v1/jobs").json()["items"].as_array().map(Vec::len), Some(2));
}

/// Room for the files of some tiny pictures and the linear picture of one.
fn cramped() -> Limits {
    Limits { kept_result_bytes: 6_000, ..Limits::default() }
}

#[test]
fn linear_pictures_of_a_batch_leave_one_by_one_and_all_files_stay() {
    let server = Server::with(cramped(), engine::faulty(engine::Fault::None, 0), Duration::ZERO);
    let scene = server.upload();
    let params = |seed: usize| json!({ "width": 16, "height": 8, "max_samples": 4, "seed": seed });
    let lines: Vec<String> = (0..4).map(|n| line(&scene, &format!("n{n}"), &params(n))).collect();
    let batch = begin(&server, &lines);
    let batch = finished(&server, &batch["id"]);
    let jobs: Vec<&str> = batch["items"].as_array().unwrap().iter().map(|item| item["job"].as_str().unwrap()).collect();
    std::thread::sleep(Duration::from_millis(300));
    let result = |job: &str, query: &str, accept: &str| {
        server.send("GET", &format!("/v1/jobs/{job}/result{query}"), &[("accept", accept)], &[])
    };
    let (gone, kept): (Vec<&str>, Vec<&str>) =
        jobs.iter().partition(|job| server.job(job)["linear_picture"] == json!(false));
    assert!(!gone.is_empty() && !kept.is_empty(), "{gone:?} {kept:?}");
    for job in &gone {
        assert_eq!(result(job, "", "image/png").status, 200);
        assert_eq!(result(job, "", "image/webp, image/*;q=0.1").header("content-type"), Some("image/png"));
        for (query, accept) in [("", "image/x-exr"), ("?aov=samples", "*/*")] {
            let problem = result(job, query, accept).problem(410, "linear_picture_gone");
            assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("no-cache")), "{problem}");
        }
    }
    for job in kept {
        assert_eq!(result(job, "", "image/x-exr").status, 200);
    }
    let files = entries(&server.get(batch["links"]["results"].as_str().expect("a link")));
    assert_eq!(files.len(), 5, "all pictures and the index");
    // Who waits for another format of what has left gets it, rendered anew to the same picture.
    let number = jobs.iter().position(|job| *job == gone[0]).expect("one of them");
    let body = json!({ "scene": scene, "params": params(number) }).to_string();
    let post = |accept: &str| {
        let headers = [("content-type", "application/json"), ("prefer", "wait=30"), ("accept", accept)];
        server.send("POST", "/v1/jobs", &headers, body.as_bytes())
    };
    let exr = post("image/x-exr");
    assert_eq!((exr.status, exr.header("content-type")), (200, Some("image/x-exr")), "{exr:?}");
    assert!(post("image/png").body == files[number].1);
}

#[test]
fn a_lost_linear_picture_stays_lost_over_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let start =
        || Server::in_folder(Some(folder.path()), cramped(), engine::faulty(engine::Fault::None, 0), Duration::ZERO);
    let mut id = String::new();
    {
        let server = start();
        let scene = server.upload();
        for seed in 1..=2 {
            let next = server.begin(&scene, &json!({ "width": 16, "height": 8, "max_samples": 4, "seed": seed }));
            server.wait_for(&next, &["succeeded"]);
            if seed == 1 {
                id = next;
            }
        }
        std::thread::sleep(Duration::from_millis(300));
    }
    let server = start();
    assert_eq!(server.job(&id)["linear_picture"], json!(false));
    assert_eq!(server.get(&format!("/v1/jobs/{id}/result")).status, 200);
    server
        .send("GET", &format!("/v1/jobs/{id}/result"), &[("accept", "image/x-exr")], &[])
        .problem(410, "linear_picture_gone");
}

#[test]
fn a_batch_tells_of_its_items_in_order_and_resumes() {
    let server = Server::with(Limits::default(), engine::faulty(engine::Fault::TooLarge, 0), Duration::ZERO);
    let scene = server.upload();
    let failing = json!({ "width": 16, "height": 8, "max_samples": 4, "seed": engine::FAULTY_SEED });
    let lines = [line(&scene, "one", &tiny()), line(&scene, "two", &failing), line(&scene, "three", &tiny())];
    let batch = begin(&server, &lines);
    let path = batch["links"]["events"].as_str().expect("a link").to_owned();
    let heard = listen_at(&server, &path, None, |_| false);
    let seen: Vec<_> = heard.iter().map(|event| (event.id, event.kind.as_str())).collect();
    assert_eq!(seen, [(1, "item"), (2, "item"), (3, "item"), (4, "finished")]);
    assert_eq!((&heard[1].data["name"], &heard[1].data["state"]), (&json!("two"), &json!("failed")));
    assert_eq!((&heard[3].data["state"], &heard[3].data["counts"]["succeeded"]), (&json!("finished"), &json!(2)));
    let rest = listen_at(&server, &path, Some(2), |_| false);
    assert_eq!(rest.iter().map(|event| event.id).collect::<Vec<_>>(), [3, 4]);
    assert_eq!(server.send("GET", &path, &[("last-event-id", "4")], &[]).status, 204);
    for odd in ["x", "+1", "-1", "1.0", "99999999999999999999"] {
        server.send("GET", &path, &[("last-event-id", odd)], &[]).problem(400, "bad_request");
    }
}
