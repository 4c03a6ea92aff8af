//! What clients send wrong, and what they are told.

use crate::engine;
use crate::support::{Server, form, tiny, triangle};
use candela::config::Limits;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

fn limited(limits: Limits) -> Server {
    Server::with(limits, engine::any(), Duration::ZERO)
}

fn pointers(problem: &Value) -> Vec<&str> {
    problem["errors"].as_array().into_iter().flatten().filter_map(|error| error["pointer"].as_str()).collect()
}

#[test]
fn unknown_routes_and_methods() {
    let server = Server::start();
    server.get("/v2/nothing").problem(404, "not_found");
    let reply = server.delete("/v1/render");
    reply.problem(405, "method_not_allowed");
    assert_eq!(reply.header("allow"), Some("POST"));
    let reply = server.delete("/v1/jobs");
    assert!(reply.header("allow").is_some_and(|allow| allow.contains("GET") && allow.contains("POST")), "{reply:?}");
    server.get("/v1/jobs/nothing").problem(404, "job_not_found");
    server.get("/v1/jobs/%ff").problem(400, "bad_request");
}

#[test]
fn wrong_types_of_body() {
    let server = Server::start();
    for path in ["/v1/render", "/v1/scenes", "/v1/images", "/v1/jobs"] {
        server.post(path, "text/plain", b"hello").problem(415, "unsupported_media_type");
        server.send("POST", path, &[], b"hello").problem(415, "unsupported_media_type");
    }
}

#[test]
fn broken_forms() {
    let server = Server::start();
    let kind = "multipart/form-data; boundary=limit";
    server.post("/v1/render", "multipart/form-data", b"").problem(400, "malformed_multipart");
    server.post("/v1/render", kind, b"no form at all").problem(400, "malformed_multipart");
    let whole = form(&[("scene", Some("a.glb"), &triangle())]);
    server.post("/v1/render", kind, &whole[..whole.len() - 20]).problem(400, "malformed_multipart");
    server.post_form("/v1/render", &[("colour", None, b"red")]).problem(400, "malformed_multipart");
    server.post_form("/v1/render", &[]).problem(400, "bad_request");
    server.post_form("/v1/render", &[("params", None, b"{}")]).problem(400, "bad_request");
    for boundary in ["", "=", "=\"\"", "=; charset=x"] {
        let kind = format!("multipart/form-data; boundary{boundary}");
        let problem = server.post("/v1/render", &kind, &whole).problem(400, "malformed_multipart");
        assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("boundary")), "{problem}");
    }
    for (name, file) in [("sce\0ne", "a.glb"), ("scene", "a\0.glb"), ("scene", "a\t.glb")] {
        let problem =
            server.post_form("/v1/render", &[(name, Some(file), &triangle())]).problem(400, "malformed_multipart");
        assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("control character")), "{problem}");
    }
    let twice: [(&str, Option<&str>, &[u8]); 2] = [("params", None, b"{}"), ("params", None, b"{}")];
    server.post_form("/v1/render", &twice).problem(400, "malformed_multipart");
}

#[test]
fn broken_json() {
    let server = Server::start();
    let scene = server.upload();
    server.post("/v1/jobs", "application/json", b"{\"scene\":").problem(400, "malformed_json");
    let problem = server.post_json("/v1/jobs", &json!({})).problem(422, "invalid_params");
    assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("scene")), "{problem}");
    let problem = server.post_json("/v1/jobs", &json!({ "scene": scene, "wishes": 3 })).problem(422, "invalid_params");
    assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("wishes")), "{problem}");
    server.post_json("/v1/jobs", &json!({ "scene": 7 })).problem(422, "invalid_params");
    server.post_json("/v1/jobs", &json!({ "scene": scene, "priority": 101 })).problem(422, "invalid_params");
    server.post_json("/v1/jobs", &json!({ "scene": "sha256-0" })).problem(404, "scene_not_found");
}

#[test]
fn faulty_parameters_are_named_by_place() {
    let server = Server::start();
    let scene = server.upload();
    let refuse = |params: Value| {
        server.post_json("/v1/jobs", &json!({ "scene": scene, "params": params })).problem(422, "invalid_params")
    };
    assert_eq!(pointers(&refuse(json!({ "widht": 10 }))), ["/params/widht"]);
    assert_eq!(pointers(&refuse(json!({ "width": 0 }))), ["/params/width"]);
    assert_eq!(pointers(&refuse(json!({ "width": "wide" }))), ["/params/width"]);
    assert_eq!(pointers(&refuse(json!({ "environment": { "hdri": "none.hdr" } }))), ["/params/environment/hdri"]);
    let problem = server.post("/v1/render?width=no", "model/gltf-binary", &triangle()).problem(422, "invalid_params");
    assert_eq!(pointers(&problem), ["/params/width"]);
}

#[test]
fn null_is_no_object_on_any_route() {
    let server = Server::start();
    let scene = server.upload();
    let problem =
        server.post_json("/v1/jobs", &json!({ "scene": scene, "params": null })).problem(422, "invalid_params");
    assert_eq!(pointers(&problem), ["/params"]);
    let problem = server.post_form("/v1/render", &[("scene", Some("a.glb"), &triangle()), ("params", None, b"null")]);
    assert_eq!(pointers(&problem.problem(422, "invalid_params")), ["/params"]);
    let body = json!({ "scenes": [scene], "params": null });
    assert_eq!(pointers(&server.post_json("/v1/batches", &body).problem(422, "invalid_params")), ["/params"]);
    for (path, body, is) in
        [("/v1/jobs", "null", "null"), ("/v1/jobs", "[]", "an array"), ("/v1/batches", "null", "null")]
    {
        let problem = server.post(path, "application/json", body.as_bytes()).problem(422, "invalid_params");
        assert_eq!(problem["detail"], format!("the body must be a JSON object, and is {is}"));
        assert_eq!(problem["errors"], Value::Null, "the whole is no place");
    }
    let problem = server.post("/v1/batches", "application/x-ndjson", b"null").problem(422, "invalid_params");
    assert_eq!(pointers(&problem), ["/items/0"]);
    let line = json!({ "scene": scene, "params": null }).to_string();
    let problem = server.post("/v1/batches", "application/x-ndjson", line.as_bytes()).problem(422, "invalid_params");
    assert_eq!(pointers(&problem), ["/items/0/params"]);
}

#[test]
fn one_limit_is_told_of_one_number() {
    let server = Server::start();
    let scene = server.upload();
    let body = json!({ "scene": scene, "params": { "max_samples": 4_000_000_000_u32 } });
    assert_eq!(pointers(&server.post_json("/v1/jobs", &body).problem(422, "invalid_params")), ["/params/max_samples"]);
}

#[test]
fn an_image_that_was_cut_off_is_refused_at_once() {
    let server = Server::start();
    let picture = image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([x as u8 * 3, y as u8 * 2, (x * y) as u8]));
    let mut file = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut file, image::ImageFormat::Png).expect("a PNG");
    let mut png = file.into_inner();
    assert_eq!(server.post("/v1/images", "image/png", &png).status, 201);
    png.truncate(png.len() / 2);
    let problem = server.post("/v1/images", "image/png", &png).problem(422, "invalid_image");
    assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("cut off")), "{problem}");
}

#[test]
fn parameters_that_the_scene_cannot_meet() {
    let server = Server::start();
    let render = |query: &str| {
        let path = format!("/v1/render?width=16&height=8&max_samples=2&{query}");
        server.post(&path, "model/gltf-binary", &triangle()).problem(422, "invalid_params")
    };
    assert_eq!(pointers(&render("scene=7")), ["/params/scene"]);
    assert!(pointers(&render("camera.index=3"))[0].starts_with("/params/camera"));
}

#[test]
fn broken_scenes() {
    let server = Server::start();
    for (kind, bytes) in [
        ("model/gltf-binary", &b"glTF\x02\0\0\0 cut"[..]),
        ("model/gltf-binary", b"not a model"),
        ("model/gltf+json", b"{\"asset\": {\"version\": \"9.0\"}}"),
        ("application/zip", b"PK\x03\x04 cut"),
    ] {
        let reply = server.post("/v1/scenes", kind, bytes);
        assert!((400..500).contains(&reply.status), "{reply:?}");
        let problem = reply.problem(reply.status, reply.json()["code"].as_str().expect("a code"));
        assert!(pointers(&problem)[0].starts_with("/scene"), "{problem}");
    }
}

#[test]
fn pictures_beyond_the_limits() {
    let server = limited(Limits { picture_pixels: 1000, job_memory_bytes: 100_000, ..Limits::default() });
    let scene = server.upload();
    let post = |width: u32, height: u32| {
        let params = json!({ "width": width, "height": height, "max_samples": 1 });
        server.post_json("/v1/jobs", &json!({ "scene": scene, "params": params }))
    };
    assert!(pointers(&post(100, 100).problem(422, "invalid_params")).contains(&"/params/width"));
    assert_eq!(pointers(&post(30, 30).problem(422, "limit_exceeded")), ["/params/width"]);
    assert_eq!(post(10, 10).status, 202);
}

/// Sends bytes as they are, and answers the status and how long it took.
fn raw(server: &Server, bytes: &[u8]) -> (String, Duration) {
    let begun = Instant::now();
    let mut stream = TcpStream::connect(server.address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    stream.write_all(bytes).unwrap();
    let mut reply = [0; 12];
    stream.read_exact(&mut reply).unwrap();
    (String::from_utf8_lossy(&reply[9..]).into_owned(), begun.elapsed())
}

fn head(path: &str, kind: &str, more: &str) -> Vec<u8> {
    format!("POST {path} HTTP/1.1\r\nhost: localhost\r\ncontent-type: {kind}\r\n{more}\r\n\r\n").into_bytes()
}

#[test]
fn large_bodies_are_refused_before_they_are_read() {
    let server = limited(Limits { upload_bytes: 100_000, ..Limits::default() });
    let length = "content-length: 1000000000";
    assert_eq!(raw(&server, &head("/v1/scenes", "model/gltf-binary", length)).0, "413");
    assert_eq!(raw(&server, &head("/v1/render", "multipart/form-data; boundary=a", length)).0, "413");
    assert_eq!(raw(&server, &head("/v1/jobs", "application/json", "content-length: 3000000")).0, "413");
}

#[test]
fn large_bodies_of_unknown_length_are_cut_off() {
    let server = limited(Limits { upload_bytes: 10_000, ..Limits::default() });
    let chunk = [b"4000\r\n".as_slice(), &[7; 0x4000], b"\r\n"].concat();
    let head = head("/v1/scenes", "model/gltf-binary", "transfer-encoding: chunked");
    assert_eq!(raw(&server, &[head, chunk].concat()).0, "413");
}

#[test]
fn slow_bodies_are_given_up() {
    let server = limited(Limits { body_seconds: 1, ..Limits::default() });
    let (status, time) = raw(&server, &head("/v1/scenes", "model/gltf-binary", "content-length: 100"));
    assert_eq!(status, "408");
    assert!(time < Duration::from_secs(4), "{time:?}");
}

#[test]
fn the_number_of_parts_is_limited() {
    let server = limited(Limits { form_parts: 2, ..Limits::default() });
    let glb = triangle();
    let params = tiny().to_string();
    let fields =
        [("scene", Some("a.glb"), glb.as_slice()), ("b", Some("b"), b"1"), ("params", None, params.as_bytes())];
    server.post_form("/v1/render", &fields).problem(413, "payload_too_large");
}

#[test]
fn json_is_limited_in_a_body_and_in_a_form() {
    let server = limited(Limits { json_bytes: 100, ..Limits::default() });
    let glb = triangle();
    let long = format!("{{\"width\": 16{}}}", " ".repeat(100));
    let fields = [("scene", Some("a.glb"), glb.as_slice()), ("params", None, long.as_bytes())];
    for reply in [server.post("/v1/jobs", "application/json", long.as_bytes()), server.post_form("/v1/render", &fields)]
    {
        let problem = reply.problem(413, "payload_too_large");
        assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("100 bytes")), "{problem}");
    }
}

#[test]
fn a_request_keeps_its_id_if_it_is_plain() {
    let server = Server::start();
    let id = |given: &str| {
        let reply = server.send("GET", "/healthz", &[("x-request-id", given)], &[]);
        reply.header("x-request-id").map(str::to_owned)
    };
    assert_eq!(id("abc-123").as_deref(), Some("abc-123"));
    assert_ne!(id("<script>").as_deref(), Some("<script>"));
}

#[test]
fn vertices_that_no_file_holds_are_refused() {
    let claims = |count: u64| {
        let zeros = |kind: &str| json!({ "componentType": 5126, "count": count, "type": kind });
        let attributes = json!({ "POSITION": 0, "COLOR_0": 1, "TEXCOORD_0": 2 });
        let document = json!({
            "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": attributes }] }],
            "accessors": [zeros("VEC3"), zeros("VEC4"), zeros("VEC2")],
        });
        document.to_string()
    };
    // The least budget: imports take turns, however large.
    let server = limited(Limits { import_memory_bytes: 1, ..Limits::default() });
    let begun = Instant::now();
    let post = |count| server.post("/v1/scenes", "model/gltf+json", claims(count).as_bytes());
    for count in [59_999_000, 3_000_000] {
        let problem = post(count).problem(413, "decoded_bytes");
        assert!(pointers(&problem)[0].starts_with("/scene/"), "{problem}");
    }
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    std::thread::scope(|scope| {
        let posts: Vec<_> = [3000, 6000, 9000].map(|count| scope.spawn(move || post(count).status)).into();
        assert!(posts.into_iter().all(|status| status.join().unwrap() == 201));
    });
}

#[test]
fn one_limit_for_environments() {
    let server = limited(Limits { environment_pixels: 100, ..Limits::default() });
    assert_eq!(server.get("/v1/limits").json()["environment_pixels"], 100);
    let problem =
        server.post("/v1/images", "image/vnd.radiance", &crate::support::radiance()).problem(422, "invalid_image");
    assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("environment_pixels")), "{problem}");
}

#[test]
fn scenes_beyond_the_arithmetic_are_refused() {
    let server = Server::start();
    for (scale, code) in [("1e12", "extent_too_large"), ("1e-12", "extent_too_small")] {
        let scaled = crate::support::triangle_text("x")
            .replace("{\"mesh\": 0}", &format!("{{\"mesh\": 0, \"scale\": [{scale}, {scale}, {scale}]}}"));
        let scaled = crate::support::glb(&scaled.replace(", \"uri\": \"x\"", ""), &crate::support::vertices());
        let problem = server.post("/v1/render?width=8&height=8", "model/gltf-binary", &scaled).problem(422, code);
        let detail = problem["detail"].as_str().unwrap_or_default();
        assert!(detail.contains("scale it") && !detail.contains("inf"), "{problem}");
    }
}

/// The triangle below a chain of so many nodes; `back`: the last is the parent of the first.
fn chain(nodes: usize, back: bool) -> Vec<u8> {
    let text = crate::support::triangle_text("x").replace(", \"uri\": \"x\"", "");
    let mut document: Value = serde_json::from_str(&text).expect("JSON");
    let node = |index: usize| match index + 1 {
        next if next < nodes => json!({ "children": [next] }),
        _ if back => json!({ "mesh": 0, "children": [0] }),
        _ => json!({ "mesh": 0 }),
    };
    document["nodes"] = (0..nodes).map(node).collect();
    crate::support::glb(&document.to_string(), &crate::support::vertices())
}

#[test]
fn deep_and_cyclic_hierarchies() {
    let server = limited(Limits { node_depth: 50, nodes: 100, ..Limits::default() });
    let post = |glb: &[u8]| server.post("/v1/scenes", "model/gltf-binary", glb);
    assert_eq!(post(&chain(50, false)).status, 201);
    post(&chain(51, false)).problem(413, "node_depth");
    post(&chain(101, false)).problem(413, "nodes");
    let problem = post(&chain(20, true));
    assert!([400, 422].contains(&problem.status), "{problem:?}");
    // What the stack would not hold, if anything were recursive.
    let server = limited(Limits { node_depth: 100_000, nodes: 100_000, ..Limits::default() });
    let id = server.post("/v1/scenes", "model/gltf-binary", &chain(100_000, false)).json()["id"].clone();
    let job = server.begin(id.as_str().expect("an id"), &tiny());
    server.wait_for(&job, &["succeeded"]);
}

#[test]
fn archives_that_unpack_to_too_much() {
    let zip = |zeros: usize| {
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for (name, bytes) in [("a.glb", triangle()), ("zeros", vec![0; zeros])] {
            archive.start_file(name, zip::write::SimpleFileOptions::default()).expect("an entry");
            archive.write_all(&bytes).expect("memory");
        }
        archive.finish().expect("an archive").into_inner()
    };
    let server = limited(Limits { decompressed_bytes: 4 << 20, ..Limits::default() });
    let post = |zip: &[u8]| server.post("/v1/scenes", "application/zip", zip);
    // The first MiB is free of the ratio's limit.
    assert_eq!(post(&zip(1_000_000)).status, 201);
    post(&zip(2 << 20)).problem(413, "zip_inflated");
    let server = limited(Limits { decompressed_bytes: 4 << 20, decompression_ratio: 2000, ..Limits::default() });
    let post = |zip: &[u8]| server.post("/v1/scenes", "application/zip", zip);
    assert_eq!(post(&zip(2 << 20)).status, 201);
    post(&zip(5 << 20)).problem(413, "zip_inflated");
}
