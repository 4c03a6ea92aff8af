//! How a server ends.

use crate::engine;
use crate::events::listen;
use crate::support::{Server, endless, triangle};
use candela::config::Limits;
use serde_json::json;
use std::time::{Duration, Instant};

#[test]
fn running_jobs_finish_and_new_ones_are_refused() {
    let mut server = Server::with(Limits::default(), engine::any(), Duration::from_secs(30));
    let scene = server.upload();
    let id = server.begin(&scene, &json!({ "width": 64, "height": 64, "max_samples": 600 }));
    server.wait_for(&id, &["running"]);
    server.stop();
    std::thread::sleep(Duration::from_millis(100));
    server.get("/readyz").problem(503, "shutting_down");
    assert_eq!(server.get("/healthz").status, 200);
    let refused = server.post("/v1/render", "model/gltf-binary", &triangle());
    refused.problem(503, "shutting_down");
    assert!(refused.header("retry-after").is_some());
    let heard = listen(&server, &id, None, |_| false);
    assert_eq!(heard.last().map(|event| event.kind.as_str()), Some("completed"));
    assert_eq!(server.get(&format!("/v1/jobs/{id}/result")).status, 200);
    server.join();
}

#[test]
fn streams_end_when_patience_does() {
    let mut server = Server::with(Limits::default(), engine::any(), Duration::from_secs(1));
    let id = server.begin(&server.upload(), &endless());
    server.wait_for(&id, &["running"]);
    let begun = Instant::now();
    let heard = std::thread::scope(|scope| {
        let asked = &server;
        let listener = scope.spawn(move || listen(asked, &id, None, |_| false));
        std::thread::sleep(Duration::from_millis(200));
        server.stop();
        listener.join().expect("a listener")
    });
    assert_eq!(heard.last().map(|event| event.data["code"].clone()), Some(json!("shutting_down")));
    server.join();
    assert!(begun.elapsed() < Duration::from_secs(8), "{:?}", begun.elapsed());
}
