//! Spheres and overrides over HTTP: maps as parts of the form and by id, and what is told of faults.

use crate::support::{Server, radiance, tiny, triangle};
use serde_json::{Value, json};

/// A grey PNG of one texel.
fn png() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::GrayImage::from_pixel(1, 1, image::Luma([128]))
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("a PNG");
    bytes.into_inner()
}

fn pointers(problem: &Value) -> Vec<&str> {
    problem["errors"].as_array().into_iter().flatten().filter_map(|error| error["pointer"].as_str()).collect()
}

fn request(extra: &Value) -> Vec<u8> {
    let mut params = tiny();
    for (name, value) in extra.as_object().expect("an object") {
        params[name] = value.clone();
    }
    params.to_string().into_bytes()
}

fn sphere(fields: &Value) -> Value {
    let mut sphere = json!({"center": [0, 0, 0], "radius": 0.5});
    for (name, value) in fields.as_object().expect("an object") {
        sphere[name] = value.clone();
    }
    json!({ "spheres": [sphere] })
}

#[test]
fn a_sphere_has_its_texture_from_the_form_or_by_id() {
    let server = Server::start();
    let form = request(&sphere(&json!({"texture": {"image": "a.png"}, "height": {"image": "a.png", "scale": 0.1}})));
    let reply = server.post_form(
        "/v1/render",
        &[("scene", Some("a.glb"), &triangle()), ("map", Some("a.png"), &png()), ("params", None, &form)],
    );
    assert_eq!(reply.status, 200, "{reply:?}");
    let image = server.post("/v1/images", "application/octet-stream", &png());
    assert_eq!(image.status, 200, "the part was kept: {image:?}");
    let image = image.json();
    assert_eq!((&image["kind"], &image["width"]), (&json!("map"), &json!(1)));
    let scene = server.upload();
    let mut params = tiny();
    params["spheres"] = sphere(&json!({"normal": {"image": image["id"]}}))["spheres"].clone();
    let job = server.begin(&scene, &params);
    let done = server.wait_for(&job, &["succeeded", "failed"]);
    assert_eq!(done["state"], "succeeded", "{done}");
}

#[test]
fn faulty_surfaces_are_named_by_place() {
    let server = Server::start();
    let refuse = |extra: Value| {
        let files: [(&str, Option<&str>, &[u8]); 4] = [
            ("scene", Some("a.glb"), &triangle()),
            ("map", Some("a.png"), &png()),
            ("sky", Some("sky.hdr"), &radiance()),
            ("params", None, &request(&extra)),
        ];
        server.post_form("/v1/render", &files).problem(422, "invalid_params")
    };
    let at = |extra: Value| pointers(&refuse(extra)).into_iter().map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(at(sphere(&json!({"radius": 0}))), ["/params/spheres/0/radius"]);
    assert_eq!(at(sphere(&json!({"colour": [1, 1, 1]}))), ["/params/spheres/0/colour"]);
    assert_eq!(at(sphere(&json!({"texture": {"image": "b.png"}}))), ["/params/spheres/0/texture/image"]);
    assert_eq!(at(sphere(&json!({"texture": {"image": "sky.hdr"}}))), ["/params/spheres/0/texture/image"]);
    assert_eq!(at(json!({"environment": {"hdri": "a.png"}})), ["/params/environment/hdri"]);
    assert_eq!(at(json!({"overrides": [{"material": "none"}]})), ["/params/overrides/0/material"]);
    assert_eq!(
        at(json!({"overrides": [{"material": "a", "parallax": {"image": "a.png", "scale": 1, "method": "deep"}}]})),
        ["/params/overrides/0/parallax/method"]
    );
    let problem = refuse(json!({"overrides": [{"material": "none"}]}));
    assert!(problem["errors"][0]["detail"].as_str().is_some_and(|detail| detail.contains("none")), "{problem}");
}

/// A profile of 5 candela downwards.
const LAMP: &str = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 9\n0 90\n0\n5 0\n";

#[test]
fn a_light_has_its_profile_from_the_form_or_by_id() {
    let server = Server::start();
    let lights = json!({"lights": [{"type": "point", "position": [0, 2, 0], "ies": "lamp.ies"}]});
    let post = |file: &[u8], params: &Value| {
        let files: [(&str, Option<&str>, &[u8]); 3] = [
            ("scene", Some("a.glb"), &triangle()),
            ("lamp", Some("lamp.ies"), file),
            ("params", None, &request(params)),
        ];
        server.post_form("/v1/render", &files)
    };
    let reply = post(LAMP.as_bytes(), &lights);
    assert_eq!(reply.status, 200, "{reply:?}");
    let image = server.post("/v1/images", "application/x-ies-lm-63", LAMP.as_bytes());
    assert_eq!(image.status, 200, "the part was kept: {image:?}");
    let image = image.json();
    assert_eq!((&image["kind"], &image["width"], &image["height"]), (&json!("profile"), &json!(2), &json!(2)));
    let scene = server.upload();
    let mut params = tiny();
    params["lights"] = json!([{"type": "spot", "position": [0, 2, 0], "direction": [0, -1, 0], "ies": image["id"]}]);
    let job = server.begin(&scene, &params);
    let done = server.wait_for(&job, &["succeeded", "failed"]);
    assert_eq!(done["state"], "succeeded", "{done}");

    let problem = post(&LAMP.as_bytes()[..60], &lights).problem(422, "invalid_image");
    assert_eq!(pointers(&problem), ["/params/lights/0/ies"]);
    assert!(problem["errors"][0]["detail"].as_str().is_some_and(|detail| detail.contains("the file ends after line")));
    let problem = post(&png(), &lights).problem(422, "invalid_params");
    assert_eq!(pointers(&problem), ["/params/lights/0/ies"], "a picture is no profile");
    let as_sky = json!({"environment": {"hdri": "lamp.ies"}});
    assert_eq!(pointers(&post(LAMP.as_bytes(), &as_sky).problem(422, "invalid_params")), ["/params/environment/hdri"]);
    let other = json!({"lights": [{"type": "directional", "direction": [0, -1, 0], "ies": "lamp.ies"}]});
    assert_eq!(pointers(&post(LAMP.as_bytes(), &other).problem(422, "invalid_params")), ["/params/lights/0/ies"]);
}

#[test]
fn a_broken_map_is_told_from_its_place() {
    let server = Server::start();
    let broken = &png()[..24];
    let form = request(&sphere(&json!({"height": {"image": "a.png", "scale": 1}})));
    let files: [(&str, Option<&str>, &[u8]); 3] =
        [("scene", Some("a.glb"), &triangle()), ("map", Some("a.png"), broken), ("params", None, &form)];
    let problem = server.post_form("/v1/render", &files).problem(422, "invalid_image");
    assert_eq!(pointers(&problem), ["/params/spheres/0/height/image"]);
}
