//! `mode: preview` over HTTP: one call, the same road as any other picture.

use crate::support::{Server, triangle};

const GLB: &str = "model/gltf-binary";

fn path(query: &str) -> String {
    format!("/v1/render?mode=preview&width=32&height=16&{query}")
}

#[test]
fn a_preview_is_a_picture_with_its_approximations_named() {
    let server = Server::start();
    let reply = server.post(&path("preview.samples=2&preview.shadows.algorithm=ray"), GLB, &triangle());
    assert_eq!(reply.status, 200, "{reply:?}");
    assert!(reply.body.starts_with(b"\x89PNG"));
    assert_eq!(reply.header("candela-samples"), Some("2"));
    let biases = reply.header("candela-biases").unwrap_or_default();
    assert!(biases.contains("mode preview") && biases.contains("preview.shadows ray"), "{biases}");
}

#[test]
fn the_same_preview_has_the_same_bytes() {
    let server = Server::start();
    let draw = || server.post(&path("preview.samples=3"), GLB, &triangle());
    assert_eq!(draw().body, draw().body);
}

#[test]
fn faults_of_a_preview_are_named() {
    let server = Server::start();
    for (query, pointer) in [
        ("preview.shadows.taps=0", "/params/preview/shadows/taps"),
        ("preview.shadows.algorithm=pfc", "/params/preview/shadows/algorithm"),
        ("preview.shading=toon", "/params/preview/shading"),
        ("preview.shadow=1", "/params/preview/shadow"),
        ("engine=cpu", "/params/engine"),
    ] {
        let reply = server.post(&path(query), GLB, &triangle());
        let text = String::from_utf8_lossy(&reply.body).into_owned();
        assert!(reply.status == 422 || reply.status == 400, "{query}: {reply:?}");
        assert!(text.contains(pointer), "{query}: {text}");
    }
}
