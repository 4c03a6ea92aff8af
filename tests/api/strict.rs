//! Nothing that a client says is dropped or guessed in silence: queries, JSON, preferences, encodings.

use crate::support::{Server, endless, radiance, tiny, triangle};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;

/// Pointer of the first place at fault.
fn place(problem: &Value) -> &str {
    problem["errors"][0]["pointer"].as_str().unwrap_or("none")
}

fn detail(problem: &Value) -> &str {
    problem["detail"].as_str().unwrap_or_default()
}

#[test]
fn queries_name_the_field_at_fault() {
    let server = Server::start();
    for path in ["/v1/jobs", "/v1/scenes"] {
        for (query, pointer) in
            [("limit=x", "/limit"), ("limit=0", "/limit"), ("foo=1", "/foo"), ("limit=1&limit=2", "/limit")]
        {
            let problem = server.get(&format!("{path}?{query}")).problem(422, "invalid_params");
            assert_eq!(place(&problem), pointer, "{path}?{query}");
        }
        let problem = server.get(&format!("{path}?cursor=nonsense")).problem(400, "bad_cursor");
        assert_eq!(place(&problem), "/cursor");
        assert_eq!(server.get(&format!("{path}?limit=%33")).status, 200);
    }
    let scene = server.upload();
    let order = json!({ "scene": scene, "params": tiny() });
    let problem = server.post_json("/v1/jobs?width=640", &order).problem(422, "invalid_params");
    assert_eq!(place(&problem), "/width");
    let id = server.begin(&scene, &tiny());
    assert_eq!(server.get(&format!("/v1/jobs?cursor={id}")).status, 200);
    let problem = server.get(&format!("/v1/jobs/{id}/result?avo=samples")).problem(422, "invalid_params");
    assert_eq!(place(&problem), "/avo");
}

#[test]
fn jobs_are_read_in_plain_words() {
    let server = Server::start();
    let scene = server.upload();
    let fault = |body: &str| {
        let problem = server.post("/v1/jobs", "application/json", body.as_bytes()).problem(422, "invalid_params");
        for word in ["struct", "NewJob", "i32", "u32", "map", "sequence of"] {
            assert!(!detail(&problem).contains(word), "{body}: {problem}");
        }
        place(&problem).to_owned()
    };
    assert_eq!(fault("{}"), "/scene");
    assert_eq!(fault(&format!("[\"{scene}\", {{}}, 0]")), "none");
    assert_eq!(fault(&format!("{{\"scene\": \"{scene}\", \"priority\": \"high\"}}")), "/priority");
    assert_eq!(fault(&format!("{{\"scene\": \"{scene}\", \"wishes\": 1}}")), "/wishes");
    assert_eq!(fault(&format!("{{\"scene\": \"{scene}\", \"scene\": \"{scene}\"}}")), "/scene");
    let params = |params: &str| fault(&format!("{{\"scene\": \"{scene}\", \"params\": {params}}}"));
    assert_eq!(params("[1]"), "/params");
    assert_eq!(params("{\"width\": 1, \"width\": 2}"), "/params/width");
    assert_eq!(params("{\"output\": [\"exr\"]}"), "/params/output");
    assert_eq!(params("{\"lights\": [[\"ambient\"]]}"), "/params/lights/0");
    assert_eq!(params("{\"width\": -1}"), "/params/width");
}

#[test]
fn whole_numbers_are_read_in_any_writing() {
    let server = Server::start();
    for (query, params) in [
        ("?width=1.6e1&height=8.0&max_samples=4", "{}"),
        ("", "{\"width\": 16.0, \"height\": 80e-1, \"max_samples\": 4e0}"),
    ] {
        let fields: [(&str, Option<&str>, &[u8]); 2] =
            [("scene", Some("a.glb"), &triangle()), ("params", None, params.as_bytes())];
        let reply = server.post_form(&format!("/v1/render{query}"), &fields);
        assert_eq!(reply.status, 200, "{query}{params}: {reply:?}");
    }
    let problem = server.post("/v1/render?width=1.5", "model/gltf-binary", &triangle()).problem(422, "invalid_params");
    assert!(detail(&problem).contains("is the number 1.5; expected a whole number"), "{problem}");
}

#[test]
fn json_that_is_none_has_one_code() {
    let server = Server::start();
    let form = |params: &[u8]| {
        server.post_form("/v1/render", &[("scene", Some("a.glb"), &triangle()), ("params", None, params)])
    };
    assert_eq!(place(&form(b"{\"width\":").problem(400, "malformed_json")), "/params");
    assert_eq!(place(&form(b"{\"width\": 1, \"width\": 2}").problem(422, "invalid_params")), "/params/width");
    server.post("/v1/jobs", "application/json", b"{\"scene\":").problem(400, "malformed_json");
    server.post("/v1/jobs", "application/json", b"\"\xff\"").problem(400, "malformed_json");
}

#[test]
fn preferences_are_kept_to_or_refused_at_once() {
    let server = Server::start();
    let scene = server.upload();
    let post = |params: Value, accept: &str| {
        let headers = [("content-type", "application/json"), ("prefer", "Wait = 1"), ("accept", accept)];
        let body = json!({ "scene": scene, "params": params }).to_string();
        server.send("POST", "/v1/jobs", &headers, body.as_bytes())
    };
    post(endless(), "text/html").problem(406, "not_acceptable");
    assert_eq!(server.get("/v1/jobs").json()["items"], json!([]), "nothing was begun");
    let picture = post(tiny(), "image/png");
    assert_eq!((picture.status, picture.header("preference-applied")), (200, Some("wait=1")), "{picture:?}");
    let later = post(endless(), "image/png");
    assert_eq!((later.status, later.header("preference-applied")), (202, Some("wait=1")), "{later:?}");
}

#[test]
fn empty_files_are_called_empty() {
    let server = Server::start();
    for (path, field, kind) in [
        ("/v1/render", "scene", "model/gltf-binary"),
        ("/v1/scenes", "scene", "model/gltf-binary"),
        ("/v1/images", "image", "image/x-exr"),
    ] {
        let problem = server.post_form(path, &[(field, Some("a.bin"), b"")]).problem(400, "bad_request");
        assert!(
            detail(&problem).contains(&format!("part `{field}`")) && detail(&problem).contains("empty"),
            "{problem}"
        );
        let problem = server.post_form(path, &[]).problem(400, "bad_request");
        assert!(detail(&problem).contains(&format!("part `{field}`")), "{problem}");
        let problem = server.post(path, kind, b"").problem(400, "bad_request");
        assert!(detail(&problem).contains("empty"), "{problem}");
    }
}

#[test]
fn packed_bodies_are_refused() {
    let server = Server::start();
    for (path, kind) in
        [("/v1/render", "model/gltf-binary"), ("/v1/jobs", "application/json"), ("/v1/images", "image/x-exr")]
    {
        let headers = [("content-type", kind), ("content-encoding", "gzip")];
        let problem = server.send("POST", path, &headers, b"\x1f\x8b").problem(415, "unsupported_media_type");
        assert!(detail(&problem).contains("Content-Encoding"), "{problem}");
    }
    let plain = [("content-type", "image/vnd.radiance"), ("content-encoding", "identity")];
    assert_eq!(server.send("POST", "/v1/images", &plain, &radiance()).status, 201);
}

/// Status line and body of a reply to a request target that no client library would send.
fn raw_target(server: &Server, target: &str) -> String {
    let mut stream = TcpStream::connect(server.address).expect("a connection");
    let request = format!("GET {target} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).expect("sent");
    let mut reply = String::new();
    stream.read_to_string(&mut reply).expect("a reply");
    reply
}

#[test]
fn braces_in_a_query_are_read() {
    let server = Server::start();
    let reply = raw_target(&server, "/v1/jobs?limit={1}");
    assert!(reply.starts_with("HTTP/1.1 422") && reply.contains("\"/limit\""), "{reply}");
    // docs/errors.md says so: this is no HTTP, and never reaches the routes.
    let reply = raw_target(&server, "/v1/jobs?limit=\"1\"");
    assert!(reply.starts_with("HTTP/1.1 400") && reply.ends_with("\r\n\r\n"), "{reply}");
}
