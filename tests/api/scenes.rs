//! `/v1/scenes` and `/v1/images`.

use crate::support::{Server, endless, radiance, tiny, triangle, triangle_text, vertices};
use serde_json::json;

#[test]
fn the_same_scene_is_created_once() {
    let server = Server::start();
    let first = server.post("/v1/scenes", "model/gltf-binary", &triangle());
    assert_eq!(first.status, 201, "{first:?}");
    let id = first.json()["id"].as_str().unwrap().to_owned();
    assert!(id.starts_with("sha256-"));
    assert_eq!(first.header("location"), Some(format!("/v1/scenes/{id}").as_str()));
    let second = server.post_form("/v1/scenes", &[("scene", Some("any.glb"), &triangle())]);
    assert_eq!((second.status, second.json()["id"].as_str()), (200, Some(id.as_str())));
    let list = server.get("/v1/scenes").json();
    assert_eq!(list["items"].as_array().map(Vec::len), Some(1));
    assert_eq!(list["items"][0]["id"], id);
}

#[test]
fn a_scene_is_described() {
    let server = Server::start();
    let id = server.upload();
    let scene = server.get(&format!("/v1/scenes/{id}")).json();
    assert_eq!(scene["counts"]["triangles"], 1);
    assert_eq!(scene["bounds"]["min"], json!([-1.0, -1.0, 0.0]));
    assert_eq!(scene["bounds"]["max"], json!([1.0, 1.0, 0.0]));
    assert_eq!(scene["cameras"], json!([]));
    assert_eq!(server.send("HEAD", &format!("/v1/scenes/{id}"), &[], &[]).status, 200);
}

#[test]
fn parts_are_one_scene() {
    let server = Server::start();
    let text = triangle_text("a.bin");
    let files = [("scene", Some("a.gltf"), text.as_bytes()), ("scene", Some("a.bin"), &vertices())];
    assert_eq!(server.post_form("/v1/scenes", &files).status, 201);
    let alone = server.post("/v1/scenes", "model/gltf+json", text.as_bytes());
    assert!((400..500).contains(&alone.status), "{alone:?}");
    assert!(alone.json()["errors"][0]["pointer"].as_str().is_some_and(|p| p.starts_with("/scene")), "{alone:?}");
}

#[test]
fn a_deleted_scene_is_gone_but_its_job_goes_on() {
    let server = Server::start();
    let id = server.upload();
    let job = server.begin(&id, &endless());
    server.wait_for(&job, &["running"]);
    assert_eq!(server.delete(&format!("/v1/scenes/{id}")).status, 204);
    server.get(&format!("/v1/scenes/{id}")).problem(404, "scene_not_found");
    server.delete(&format!("/v1/scenes/{id}")).problem(404, "scene_not_found");
    let samples = server.job(&job)["progress"]["samples"].as_u64();
    std::thread::sleep(std::time::Duration::from_millis(800));
    assert!(server.job(&job)["progress"]["samples"].as_u64() > samples);
    server.post_json("/v1/jobs", &json!({ "scene": id })).problem(404, "scene_not_found");
}

#[test]
fn an_image_serves_as_environment_by_its_id() {
    let server = Server::start();
    let image = server.post_form("/v1/images", &[("image", Some("sky.hdr"), &radiance())]);
    assert_eq!(image.status, 201, "{image:?}");
    let id = image.json()["id"].as_str().unwrap().to_owned();
    assert_eq!((&image.json()["width"], &image.json()["height"]), (&json!(16), &json!(8)));
    assert_eq!(server.get(&format!("/v1/images/{id}")).status, 200);
    assert_eq!(server.send("HEAD", &format!("/v1/images/{id}"), &[], &[]).status, 200);
    assert_eq!(server.post("/v1/images", "image/vnd.radiance", &radiance()).status, 200);

    let mut params = tiny();
    params["environment"] = json!({ "hdri": id });
    let job = server.begin(&server.upload(), &params);
    server.wait_for(&job, &["succeeded"]);

    assert_eq!(server.delete(&format!("/v1/images/{id}")).status, 204);
    server.get(&format!("/v1/images/{id}")).problem(404, "image_not_found");
    let reply = server.post_json("/v1/jobs", &json!({ "scene": server.upload(), "params": params }));
    assert_eq!(reply.problem(422, "invalid_params")["errors"][0]["pointer"], "/params/environment/hdri");
}

#[test]
fn a_broken_image_is_named() {
    let server = Server::start();
    let reply = server.post("/v1/images", "image/x-exr", b"not a picture at all");
    assert_eq!(reply.problem(422, "invalid_image")["errors"][0]["pointer"], "/image");
}

#[test]
fn lists_come_in_pages() {
    let server = Server::start();
    for n in 0..3 {
        let text = triangle_text("a.bin").replace("\"2.0\"", &format!("\"2.0\", \"generator\": \"{n}\""));
        let files = [("scene", Some("a.gltf"), text.as_bytes()), ("scene", Some("a.bin"), &vertices()[..])];
        assert_eq!(server.post_form("/v1/scenes", &files).status, 201);
    }
    let first = server.get("/v1/scenes?limit=2").json();
    assert_eq!(first["items"].as_array().map(Vec::len), Some(2));
    let next = first["next"].as_str().expect("a cursor");
    let last = server.get(&format!("/v1/scenes?limit=2&cursor={next}")).json();
    assert_eq!((last["items"].as_array().map(Vec::len), last["next"].is_null()), (Some(1), true));
    server.get("/v1/scenes?limit=0").problem(422, "invalid_params");
    server.get("/v1/scenes?page=2").problem(422, "invalid_params");
}
