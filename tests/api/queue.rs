//! Many clients and one device.

use crate::engine;
use crate::support::{Server, endless, tiny, triangle};
use candela::config::Limits;
use serde_json::json;
use std::time::{Duration, Instant};

#[test]
fn a_full_queue_answers_at_once_and_every_accepted_job_ends_well() {
    let limits = Limits { queue_length: 3, active_renders: 1, ..Limits::default() };
    let server = Server::with(limits, engine::any(), Duration::ZERO);
    server.upload();
    let path = "/v1/render?width=64&height=64&max_samples=200";
    let replies: Vec<_> = std::thread::scope(|scope| {
        let post = || server.post(path, "model/gltf-binary", &triangle());
        let clients: Vec<_> = (0..20).map(|_| scope.spawn(post)).collect();
        clients.into_iter().map(|client| client.join().expect("a client")).collect()
    });
    let (good, refused): (Vec<_>, Vec<_>) = replies.iter().partition(|reply| reply.status == 200);
    assert!(good.len() >= 3, "{} accepted", good.len());
    assert!(!refused.is_empty(), "the queue was never full");
    assert!(good.iter().all(|reply| reply.body == good[0].body));
    for reply in refused {
        reply.problem(503, "queue_full");
        assert!(reply.header("retry-after").is_some_and(|seconds| seconds.parse::<u64>().is_ok()));
    }
}

#[test]
fn a_preview_overtakes_long_renders() {
    let server = Server::start();
    let scene = server.upload();
    let count = Limits::default().active_renders + 2;
    let long: Vec<_> = (0..count).map(|_| server.begin(&scene, &endless())).collect();
    server.wait_for(&long[0], &["running"]);
    let begun = Instant::now();
    let id = server.begin(&scene, &json!({ "width": 64, "height": 64, "max_samples": 8 }));
    server.wait_for(&id, &["succeeded"]);
    assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
    assert_eq!(server.job(&long[0])["state"], "running");
}

#[test]
fn long_renders_share_the_device() {
    let server = Server::start();
    let scene = server.upload();
    let jobs = [server.begin(&scene, &endless()), server.begin(&scene, &endless())];
    std::thread::sleep(Duration::from_secs(3));
    let samples = jobs.map(|id| server.job(&id)["progress"]["samples"].as_f64().unwrap_or(0.0));
    assert!(samples[0].min(samples[1]) > 0.6 * samples[0].max(samples[1]), "{samples:?}");
}

#[test]
fn a_queued_job_tells_its_place_and_can_be_cancelled() {
    let limits = Limits { active_renders: 1, ..Limits::default() };
    let server = Server::with(limits, engine::any(), Duration::ZERO);
    let scene = server.upload();
    let running = server.begin(&scene, &endless());
    server.wait_for(&running, &["running"]);
    // Two places are taken at most: the second only by short jobs.
    let queued: Vec<_> = (0..2).map(|_| server.begin(&scene, &endless())).collect();
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(server.job(&queued[1])["state"], "queued");
    assert_eq!(server.job(&queued[1])["queue_position"], 1);
    assert_eq!(server.send("POST", &format!("/v1/jobs/{}/cancel", queued[0]), &[], &[]).status, 200);
    assert_eq!(server.job(&queued[1])["queue_position"], 0);
}

#[test]
fn finished_jobs_are_kept_up_to_a_bound() {
    let limits = Limits { kept_jobs: 2, ..Limits::default() };
    let server = Server::with(limits, engine::any(), Duration::ZERO);
    let scene = server.upload();
    let ids: Vec<_> = (0..3)
        .map(|_| {
            let id = server.begin(&scene, &tiny());
            server.wait_for(&id, &["succeeded"]);
            id
        })
        .collect();
    // The job says so before the table has forgotten the oldest.
    std::thread::sleep(Duration::from_millis(100));
    server.get(&format!("/v1/jobs/{}", ids[0])).problem(404, "job_not_found");
    assert_eq!(server.get(&format!("/v1/jobs/{}", ids[2])).status, 200);
}

#[test]
fn renders_wait_for_memory() {
    // One picture of 64 x 64 fits, two do not.
    let limits = Limits { render_memory_bytes: 64 * 64 * 200, ..Limits::default() };
    let server = Server::with(limits, engine::any(), Duration::ZERO);
    let scene = server.upload();
    let first = server.begin(&scene, &endless());
    server.wait_for(&first, &["running"]);
    let second = server.begin(&scene, &endless());
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(server.job(&second)["state"], "queued");
    server.send("POST", &format!("/v1/jobs/{first}/cancel"), &[], &[]);
    server.wait_for(&second, &["running"]);
}
