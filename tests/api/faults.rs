//! An engine that goes wrong, on purpose.

use crate::engine::{self, COLD, FAULTY_SEED, Fault};
use crate::support::{Server, tiny};
use candela::config::Limits;
use candela::render::RenderError;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

fn server(fault: Fault, losses: u32) -> Server {
    Server::with(Limits::default(), engine::faulty(fault, losses), Duration::ZERO)
}

fn faulty() -> Value {
    json!({ "width": 16, "height": 8, "max_samples": 4, "seed": FAULTY_SEED })
}

#[test]
fn a_panic_ends_its_own_job_only() {
    let server = server(Fault::Panic, 0);
    let scene = server.upload();
    let (bad, good) = (server.begin(&scene, &faulty()), server.begin(&scene, &tiny()));
    assert_eq!(server.wait_for(&bad, &["failed"])["problem"]["code"], "internal");
    server.wait_for(&good, &["succeeded"]);
    server.get(&format!("/v1/jobs/{bad}/result")).problem(409, "job_failed");
    let again = server.begin(&scene, &tiny());
    server.wait_for(&again, &["succeeded"]);
}

#[test]
fn a_lost_device_comes_back_and_the_render_goes_on_from_its_film() {
    let picture = |losses| {
        let server = server(Fault::Lost, losses);
        let id = server.begin(&server.upload(), &faulty());
        assert_eq!(server.wait_for(&id, &["succeeded", "failed"])["state"], "succeeded");
        server.get(&format!("/v1/jobs/{id}/result")).body
    };
    assert_eq!(picture(1), picture(0));
}

#[test]
fn a_render_that_costs_one_device_after_the_other_fails_by_name_after_one_more_try() {
    let server = server(Fault::Lost, u32::MAX);
    let scene = server.upload();
    let id = server.begin(&scene, &faulty());
    let problem = &server.wait_for(&id, &["failed"])["problem"];
    assert_eq!((&problem["code"], &problem["status"]), (&json!("render_failed"), &json!(422)));
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("lost 2 times") && detail.contains("as the test wants it"), "{detail}");
    let metrics = String::from_utf8(server.get("/metrics").body).unwrap();
    assert!(metrics.contains("candela_devices_lost_total 2\n"), "one try more: {metrics}");
    let next = server.begin(&scene, &tiny());
    server.wait_for(&next, &["succeeded"]);
}

#[test]
fn a_device_that_does_not_come_back_fails_the_job() {
    let (engine, made) = (engine::faulty(Fault::Lost, 1), AtomicBool::new(false));
    let once = move || {
        if made.swap(true, Ordering::SeqCst) { Err(RenderError::NoAdapter("gone".to_owned())) } else { engine() }
    };
    let server = Server::with(Limits::default(), Box::new(once), Duration::ZERO);
    let id = server.begin(&server.upload(), &faulty());
    let problem = &server.wait_for(&id, &["failed"])["problem"];
    assert_eq!((&problem["code"], &problem["status"]), (&json!("device_unavailable"), &json!(503)));
}

/// A deadline counts from when it is ready, too: all its samples are taken.
#[test]
fn a_render_whose_kernel_is_in_the_making_holds_nobody_up() {
    let server = server(Fault::Cold, 0);
    let scene = server.upload();
    let mut params = faulty();
    params["deadline_ms"] = json!(COLD.as_millis() as u64);
    let cold = server.begin(&scene, &params);
    server.wait_for(&cold, &["running"]);
    let other = server.begin(&scene, &json!({ "width": 16, "height": 8, "max_samples": 50 }));
    server.wait_for(&other, &["succeeded"]);
    assert_eq!(server.job(&cold)["state"], "running");
    let report = &server.wait_for(&cold, &["succeeded"])["report"];
    assert_eq!((&report["stop_reason"], &report["samples"]), (&json!("max_samples"), &json!(4)), "{report}");
    let [upload, trace] = ["device_upload", "trace"].map(|stage| report["seconds"][stage].as_f64().expect("seconds"));
    assert!(upload >= COLD.as_secs_f64() - 0.1 && trace < COLD.as_secs_f64() / 2.0, "{report}");
}

#[test]
fn a_scene_that_does_not_fit_is_the_clients_fault() {
    let server = server(Fault::TooLarge, 0);
    let id = server.begin(&server.upload(), &faulty());
    let problem = &server.wait_for(&id, &["failed"])["problem"];
    assert_eq!((&problem["code"], &problem["status"]), (&json!("render_too_large"), &json!(422)));
}
