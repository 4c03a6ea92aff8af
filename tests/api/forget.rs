//! Jobs and batches that clients want forgotten.

use crate::engine;
use crate::support::{Server, endless, tiny};
use candela::config::Limits;
use serde_json::json;
use std::time::Duration;

fn server() -> Server {
    Server::with(Limits::default(), engine::faulty(engine::Fault::None, 0), Duration::ZERO)
}

#[test]
fn a_deleted_job_is_gone_with_its_result() {
    let server = server();
    let scene = server.upload();
    let id = server.begin(&scene, &tiny());
    server.wait_for(&id, &["succeeded"]);
    assert_eq!(server.delete(&format!("/v1/jobs/{id}")).status, 204);
    for part in ["", "/result", "/events"] {
        server.get(&format!("/v1/jobs/{id}{part}")).problem(404, "job_not_found");
    }
    server.delete(&format!("/v1/jobs/{id}")).problem(404, "job_not_found");
    // Nothing is left of it that could serve another.
    let again = server.begin(&scene, &tiny());
    server.wait_for(&again, &["succeeded"]);
    let events = crate::events::listen(&server, &again, None, |_| false);
    assert_eq!(events.last().expect("an end").data["cached"], false);
}

#[test]
fn a_shared_result_stays_with_the_other_job() {
    let server = server();
    let scene = server.upload();
    let first = server.begin(&scene, &tiny());
    server.wait_for(&first, &["succeeded"]);
    let second = server.begin(&scene, &tiny());
    server.wait_for(&second, &["succeeded"]);
    assert_eq!(server.delete(&format!("/v1/jobs/{first}")).status, 204);
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(server.get(&format!("/v1/jobs/{second}/result")).status, 200);
}

#[test]
fn a_job_under_way_is_ended_first_and_its_id_is_free() {
    let server = server();
    let scene = server.upload();
    let body = json!({ "scene": scene, "params": endless() }).to_string();
    let put = || server.send("PUT", "/v1/jobs/mine", &[("content-type", "application/json")], body.as_bytes()).status;
    assert_eq!(put(), 202);
    server.wait_for("mine", &["running"]);
    assert_eq!(server.delete("/v1/jobs/mine").status, 204);
    assert_eq!(put(), 202);
    server.wait_for("mine", &["running"]);
}

#[test]
fn the_jobs_of_a_batch_are_forgotten_together() {
    let server = server();
    let scene = server.upload();
    let reply =
        server.post_json("/v1/batches", &json!({ "scenes": [scene], "params": endless(), "cameras": [null, null] }));
    let batch = reply.json();
    let (id, job) = (batch["id"].as_str().expect("an id"), batch["items"][0]["job"].as_str().expect("an id"));
    server.delete(&format!("/v1/jobs/{job}")).problem(409, "job_conflict");
    assert_eq!(server.delete(&format!("/v1/batches/{id}")).status, 204);
    server.get(&format!("/v1/batches/{id}")).problem(404, "batch_not_found");
    server.get(&format!("/v1/jobs/{job}")).problem(404, "job_not_found");
}

#[test]
fn what_was_deleted_stays_so_after_a_restart() {
    let folder = tempfile::tempdir().expect("a folder");
    let start = || {
        let factory = engine::faulty(engine::Fault::None, 0);
        Server::in_folder(Some(folder.path()), Limits::default(), factory, Duration::ZERO)
    };
    let first = start();
    let scene = first.upload();
    let (gone, kept) =
        (first.begin(&scene, &tiny()), first.begin(&scene, &json!({ "width": 16, "height": 8, "max_samples": 5 })));
    first.wait_for(&gone, &["succeeded"]);
    first.wait_for(&kept, &["succeeded"]);
    assert_eq!(first.delete(&format!("/v1/jobs/{gone}")).status, 204);
    drop(first);
    let second = start();
    second.get(&format!("/v1/jobs/{gone}")).problem(404, "job_not_found");
    assert_eq!(second.job(&kept)["state"], "succeeded");
}
