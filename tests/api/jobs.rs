//! `/v1/jobs`: states, results, cancelling, pages.

use crate::support::{Server, endless, tiny, triangle};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

#[test]
fn a_job_goes_from_accepted_to_result() {
    let server = Server::start();
    let scene = server.upload();
    let reply = server.post_json("/v1/jobs", &json!({ "scene": scene, "params": tiny(), "priority": 5 }));
    assert_eq!(reply.status, 202, "{reply:?}");
    let id = reply.json()["id"].as_str().unwrap().to_owned();
    assert_eq!(reply.header("location"), Some(format!("/v1/jobs/{id}").as_str()));

    let job = server.wait_for(&id, &["succeeded"]);
    assert_eq!((&job["priority"], &job["params"]["width"]), (&json!(5), &json!(16)));
    assert_eq!(job["report"]["samples"], 4);
    assert_eq!(job["report"]["stop_reason"], "max_samples");
    assert!(job["report"]["error_bound_95"].as_f64() >= job["report"]["error"].as_f64());
    assert!(job["report"]["seconds"]["trace"].as_f64() > Some(0.0));

    let result = server.get(&format!("/v1/jobs/{id}/result"));
    assert_eq!((result.status, result.header("content-type")), (200, Some("image/png")));
    let tag = result.header("etag").unwrap();
    let again = server.send("GET", &format!("/v1/jobs/{id}/result"), &[("if-none-match", tag)], &[]);
    assert_eq!((again.status, again.body.len()), (304, 0));
    let headers = [("accept", "image/x-exr")];
    let exr = server.send("GET", &format!("/v1/jobs/{id}/result"), &headers, &[]);
    assert_eq!(exr.header("content-type"), Some("image/x-exr"));
    assert_eq!(exr.body[..4], [0x76, 0x2f, 0x31, 0x01]);
    let other = server.send("GET", &format!("/v1/jobs/{id}/result"), &[("accept", "text/plain")], &[]);
    other.problem(406, "not_acceptable");
}

#[test]
fn a_client_may_prefer_to_wait() {
    let server = Server::start();
    let scene = server.upload();
    let post = |params, wait| {
        let body = json!({ "scene": scene, "params": params }).to_string();
        let headers = [("content-type", "application/json"), ("prefer", wait)];
        server.send("POST", "/v1/jobs", &headers, body.as_bytes())
    };
    let done = post(tiny(), "wait=30");
    assert_eq!((done.status, done.header("content-type")), (200, Some("image/png")), "{done:?}");
    assert!(done.header("candela-job").is_some());
    let begun = Instant::now();
    assert_eq!(post(endless(), "wait=1").status, 202);
    assert!((1.0..5.0).contains(&begun.elapsed().as_secs_f64()));
}

#[test]
fn cancelling_is_felt_at_once_and_idempotent() {
    let server = Server::start();
    let scene = server.upload();
    let id = server.begin(&scene, &endless());
    server.wait_for(&id, &["running"]);
    server.get(&format!("/v1/jobs/{id}/result")).problem(409, "not_finished");

    let begun = Instant::now();
    let cancel = || server.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], &[]);
    assert_eq!((cancel().status, cancel().json()["state"].clone()), (200, json!("cancelled")));
    // The device is free again: another job is done at once.
    let next = server.begin(&scene, &tiny());
    server.wait_for(&next, &["succeeded"]);
    assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());

    server.get(&format!("/v1/jobs/{id}/result")).problem(409, "job_cancelled");
    let late = server.send("POST", &format!("/v1/jobs/{next}/cancel"), &[], &[]);
    assert_eq!((late.status, late.json()["state"].clone()), (200, json!("succeeded")), "over is over");
}

#[test]
fn a_client_that_goes_away_ends_its_render() {
    let server = Server::start();
    let path = "/v1/render?width=64&height=64&max_samples=4000000";
    let mut stream = std::net::TcpStream::connect(server.address).unwrap();
    let body = triangle();
    let head = format!(
        "POST {path} HTTP/1.1\r\nhost: localhost\r\ncontent-type: model/gltf-binary\r\ncontent-length: {}\r\n\r\n",
        body.len()
    );
    std::io::Write::write_all(&mut stream, &[head.as_bytes(), &body].concat()).unwrap();
    let job = loop {
        let jobs = server.get("/v1/jobs").json();
        if jobs["items"][0]["state"] == "running" {
            break jobs["items"][0]["id"].as_str().unwrap().to_owned();
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    drop(stream);
    server.wait_for(&job, &["cancelled"]);
}

#[test]
fn jobs_come_in_pages_newest_first() {
    let server = Server::start();
    let scene = server.upload();
    let ids: Vec<_> = (0..3).map(|_| server.begin(&scene, &tiny())).collect();
    let first = server.get("/v1/jobs?limit=2").json();
    assert_eq!((&first["items"][0]["id"], &first["items"][1]["id"]), (&json!(ids[2]), &json!(ids[1])));
    let next = first["next"].as_str().expect("a cursor");
    let last = server.get(&format!("/v1/jobs?limit=2&cursor={next}")).json();
    assert_eq!((&last["items"][0]["id"], last["next"].is_null()), (&json!(ids[0]), true));
}

#[test]
fn who_asks_for_a_preview_gets_one() {
    let server = Server::start();
    let id = server.begin(&server.upload(), &endless());
    let path = format!("/v1/jobs/{id}/preview");
    let begun = Instant::now();
    let preview = loop {
        let reply = server.get(&path);
        if reply.status == 200 {
            break reply;
        }
        reply.problem(404, "no_preview");
        assert!(begun.elapsed() < Duration::from_secs(5));
        std::thread::sleep(Duration::from_millis(20));
    };
    assert_eq!(preview.header("content-type"), Some("image/jpeg"));
    assert!(preview.header("candela-preview").is_some());
}

#[test]
fn the_standard_error_of_each_pixel_is_an_exr() {
    let server = Server::start();
    let id = server.begin(&server.upload(), &json!({ "width": 24, "height": 16, "max_samples": 64 }));
    let job = server.wait_for(&id, &["succeeded"]);
    let of = |query: &str, accept: &str| {
        server.send("GET", &format!("/v1/jobs/{id}/result{query}"), &[("accept", accept)], &[])
    };
    let pixels = |query: &str| {
        let reply = of(query, "*/*");
        assert_eq!((reply.status, reply.header("content-type")), (200, Some("image/x-exr")), "{reply:?}");
        let picture = image::load_from_memory_with_format(&reply.body, image::ImageFormat::OpenExr).expect("an EXR");
        let picture = picture.into_rgb32f();
        assert_eq!(picture.dimensions(), (24, 16));
        picture.into_raw()
    };
    let standard_error = pixels("?aov=standard_error");
    assert!(standard_error.iter().all(|value| *value >= 0.0) && standard_error.iter().any(|value| *value > 0.0));
    let samples = pixels("?aov=samples");
    let mean = samples.iter().sum::<f32>() / samples.len() as f32;
    assert!((mean - 64.0).abs() < 0.5, "{mean} samples");
    let (least, most) = samples.iter().fold((f32::MAX, 0.0f32), |(l, m), &value| (l.min(value), m.max(value)));
    assert_eq!(job["report"]["samples_min"], least as u32);
    assert_eq!(job["report"]["samples_max"], most as u32);
    assert_eq!(job["report"]["adaptive"], true);

    let refused = of("?aov=standard_error", "image/png").problem(406, "not_acceptable");
    assert!(refused["detail"].as_str().is_some_and(|detail| detail.contains("image/x-exr")), "{refused}");
    let unknown = of("?aov=depth", "*/*").problem(422, "invalid_params");
    assert!(unknown["detail"].as_str().is_some_and(|detail| detail.contains("standard_error or samples")), "{unknown}");
}

#[test]
fn one_sample_has_no_standard_error() {
    let server = Server::start();
    let id = server.begin(&server.upload(), &json!({ "width": 16, "height": 8, "max_samples": 1 }));
    server.wait_for(&id, &["succeeded"]);
    server.get(&format!("/v1/jobs/{id}/result?aov=standard_error")).problem(406, "not_acceptable");
}

#[test]
fn light_groups_are_layers_of_an_exr() {
    let server = Server::start();
    let scene = server.upload();
    let request = |groups: Value| {
        json!({"width": 16, "height": 8, "max_samples": 4, "light_groups": groups,
        "lights": [{"type": "directional", "direction": [0, -1, -1]}]})
    };
    let id = server.begin(&scene, &request(json!({"key": [0]})));
    server.wait_for(&id, &["succeeded"]);
    let result =
        |query: &str| server.send("GET", &format!("/v1/jobs/{id}/result{query}"), &[("accept", "image/x-exr")], &[]);
    let layers = result("?aov=light_groups");
    assert_eq!((layers.status, layers.header("content-type")), (200, Some("image/x-exr")), "{layers:?}");
    for name in ["environment.R", "surfaces.G", "lights.B", "key.R"] {
        assert!(layers.body.windows(name.len()).any(|bytes| bytes == name.as_bytes()), "no channel {name}");
    }
    let pixels = |bytes: &[u8]| {
        let picture = image::load_from_memory_with_format(bytes, image::ImageFormat::OpenExr).expect("an EXR");
        picture.into_rgb32f().into_raw()
    };
    let (sum, picture) = (pixels(&layers.body), pixels(&result("").body));
    assert!(sum.iter().zip(&picture).all(|(sum, whole)| (sum - whole).abs() <= 1e-5 * whole.abs().max(1.0)));

    let id = server.begin(&scene, &request(Value::Null));
    server.wait_for(&id, &["succeeded"]);
    let refused = server.get(&format!("/v1/jobs/{id}/result?aov=light_groups")).problem(406, "not_acceptable");
    assert!(refused["detail"].as_str().is_some_and(|detail| detail.contains("light_groups")), "{refused}");
    let params = json!({"scene": scene, "params": request(json!({"key": [1]}))});
    let refused =
        server.post("/v1/jobs", "application/json", params.to_string().as_bytes()).problem(422, "invalid_params");
    assert_eq!(refused["errors"][0]["pointer"], "/params/light_groups", "{refused}");
}
