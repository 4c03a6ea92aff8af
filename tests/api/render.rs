//! `POST /v1/render`: one call from file to picture.

use crate::support::{Server, radiance, tiny, triangle, triangle_text, vertices};
use serde_json::json;

#[test]
fn a_form_gives_a_picture_with_its_facts() {
    let server = Server::start();
    let params = tiny().to_string();
    let reply =
        server.post_form("/v1/render", &[("scene", Some("a.glb"), &triangle()), ("params", None, params.as_bytes())]);
    assert_eq!(reply.status, 200, "{reply:?}");
    assert_eq!(reply.header("content-type"), Some("image/png"));
    assert!(reply.body.starts_with(b"\x89PNG"));
    assert_eq!(reply.header("candela-samples"), Some("4"));
    assert_eq!(reply.header("candela-seed"), Some("1"));
    assert_eq!(reply.header("candela-stop-reason"), Some("max_samples"));
    assert_eq!(reply.header("candela-biases"), Some("none"));
    let number = |name: &str| reply.header(name).and_then(|value| value.parse::<f64>().ok());
    assert!(number("candela-error").is_some_and(|error| error >= 0.0), "{reply:?}");
    assert!(number("candela-error-bound-95") >= number("candela-error"), "{reply:?}");
    let stages = ["upload", "import", "compile", "queue", "device_upload", "trace", "encode"];
    let seconds = reply.header("candela-seconds").unwrap_or_default();
    assert!(stages.iter().all(|stage| seconds.contains(&format!("{stage}="))), "{seconds}");
    assert!(reply.header("candela-defaults").is_some_and(|defaults| defaults.contains("camera")), "{reply:?}");

    let text = String::from_utf8_lossy(&reply.body);
    assert!(text.contains("Candela-Samples") && text.contains("Candela-Error-Bound-95"), "no text in the PNG");
}

#[test]
fn the_same_request_gives_the_same_bytes() {
    let server = Server::start();
    let render = |seed| {
        let path = format!("/v1/render?width=16&height=8&max_samples=4&seed={seed}");
        server.post(&path, "model/gltf-binary", &triangle())
    };
    let (first, second, other) = (render(1), render(1), render(2));
    assert_eq!(first.body, second.body);
    assert_eq!(first.header("etag"), second.header("etag"));
    assert_ne!(first.header("etag"), other.header("etag"));
}

#[test]
fn the_query_has_precedence_over_the_form() {
    let server = Server::start();
    let params = tiny().to_string();
    let fields = [("scene", Some("a.glb"), triangle()), ("params", None, params.into_bytes())];
    let fields = fields.each_ref().map(|(name, file, bytes)| (*name, *file, bytes.as_slice()));
    let reply = server.post_form("/v1/render?seed=77", &fields);
    assert_eq!(reply.header("candela-seed"), Some("77"), "{reply:?}");
}

#[test]
fn a_gltf_with_its_parts_and_an_environment() {
    let server = Server::start();
    let params = json!({ "width": 16, "height": 8, "max_samples": 2, "environment": { "hdri": "sky.hdr" } });
    let reply = server.post_form(
        "/v1/render",
        &[
            ("params", None, params.to_string().as_bytes()),
            ("scene", Some("a.gltf"), triangle_text("a.bin").as_bytes()),
            ("buffer", Some("a.bin"), &vertices()),
            ("sky", Some("sky.hdr"), &radiance()),
        ],
    );
    assert_eq!(reply.status, 200, "{reply:?}");
}

#[test]
fn the_format_follows_accept_and_parameters() {
    let server = Server::start();
    let render = |query: &str, accept: &str| {
        let headers = [("content-type", "model/gltf-binary"), ("accept", accept)];
        server.send("POST", &format!("/v1/render?width=16&height=8&max_samples=2{query}"), &headers, &triangle())
    };
    let kind = |query, accept| render(query, accept).header("content-type").map(str::to_owned);
    assert_eq!(kind("", "image/webp").as_deref(), Some("image/webp"));
    assert_eq!(kind("", "image/jpeg").as_deref(), Some("image/jpeg"));
    assert_eq!(kind("&output.format=exr", "*/*").as_deref(), Some("image/x-exr"));
    render("", "text/html").problem(406, "not_acceptable");
}

#[test]
fn biases_that_the_request_allows_are_named() {
    let server = Server::start();
    let path = "/v1/render?width=16&height=8&max_samples=2&max_bounces=3&multiple_scattering=false";
    let reply = server.post(path, "model/gltf-binary", &triangle());
    let biases = reply.header("candela-biases").unwrap_or_default();
    assert!(biases.contains("max_bounces") && biases.contains("multiple_scattering"), "{biases}");
}

#[test]
fn a_picture_that_must_be_black_says_why() {
    let server = Server::start();
    let warnings = |query: &str, kind: &str, body: &[u8]| {
        let reply = server.post(&format!("/v1/render?width=8&height=8&max_samples=2&{query}"), kind, body);
        assert_eq!(reply.status, 200, "{reply:?}");
        reply.header("candela-warnings").unwrap_or_default().to_owned()
    };
    let glb = "model/gltf-binary";
    assert!(!warnings("", glb, &triangle()).contains("no_light"));
    assert!(!warnings("", glb, &triangle()).contains("nothing_in_view"));
    for position in ["[0,0,1e38]", "[0,0,1e6]"] {
        let far = format!("camera.position={position}&camera.target=[0,0,0]");
        assert!(warnings(&far, glb, &triangle()).contains("nothing_in_view"), "{position}");
    }
    assert!(warnings("camera.position=[0,0,5]&camera.target=[0,0,9]", glb, &triangle()).contains("nothing_in_view"));
    assert!(warnings("environment=null", glb, &triangle()).contains("no_light"));
    assert!(warnings("environment.constant=[0,0,0]", glb, &triangle()).contains("no_light"));
    assert!(!warnings("environment=null&lights.0.type=ambient", glb, &triangle()).contains("no_light"));
    assert!(!warnings("environment=null&mode=direct&lights.0.type=ambient", glb, &triangle()).contains("no_light"));
    let shrunk = triangle_text("data:;base64,").replace("{\"mesh\": 0}", "{\"mesh\": 0, \"scale\": [0, 0, 0]}");
    let shrunk = crate::support::glb(&shrunk.replace(", \"uri\": \"data:;base64,\"", ""), &vertices());
    assert!(warnings("", glb, &shrunk).contains("nothing_drawn"));
    assert!(warnings("", "model/gltf+json", crate::support::with_camera().as_bytes()).contains("nothing_drawn"));
}
