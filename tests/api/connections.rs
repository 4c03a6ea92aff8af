//! Clients that are slow, many, or not what they seem; each limit from both sides.

use crate::engine;
use crate::support::{Server, tiny, triangle};
use candela::config::Limits;
use serde_json::json;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

const SECOND: Duration = Duration::from_secs(1);

fn limited(limits: Limits) -> Server {
    Server::with(limits, engine::any(), Duration::ZERO)
}

fn connect(server: &Server) -> TcpStream {
    let stream = TcpStream::connect(server.address).expect("a connection");
    stream.set_read_timeout(Some(Duration::from_secs(10))).expect("a socket");
    stream
}

/// All that the server still says until it closes the connection, and how long that took.
fn rest(mut stream: TcpStream) -> (String, Duration) {
    let (begun, mut text) = (Instant::now(), Vec::new());
    // A connection that is reset has ended, too.
    let _ = stream.read_to_end(&mut text);
    (String::from_utf8_lossy(&text).into_owned(), begun.elapsed())
}

fn post_head(path: &str, length: usize) -> String {
    format!(
        "POST {path} HTTP/1.1\r\nhost: localhost\r\ncontent-type: model/gltf-binary\r\ncontent-length: {length}\r\nconnection: close\r\n\r\n"
    )
}

#[test]
fn a_head_has_its_time() {
    let server = limited(Limits { header_seconds: 1, ..Limits::default() });
    let mut slow = connect(&server);
    slow.write_all(b"GET /healthz HTTP/1.1\r\nhost:").unwrap();
    let (said, time) = rest(slow);
    assert!(!said.contains("200") && time >= SECOND / 2 && time < 5 * SECOND, "{time:?}: {said}");
    let mut in_time = connect(&server);
    in_time.write_all(b"GET /healthz HTTP/1.1\r\nhost:").unwrap();
    std::thread::sleep(SECOND / 2);
    in_time.write_all(b" localhost\r\nconnection: close\r\n\r\n").unwrap();
    assert!(rest(in_time).0.starts_with("HTTP/1.1 200"));
}

#[test]
fn connections_are_bounded_and_idle_ones_make_room() {
    let served_after = |connections: usize| {
        let server = limited(Limits { connections, header_seconds: 1, ..Limits::default() });
        let _idle = [connect(&server), connect(&server)];
        std::thread::sleep(SECOND / 10);
        let begun = Instant::now();
        assert_eq!(server.get("/healthz").status, 200);
        begun.elapsed()
    };
    assert!(served_after(3) < SECOND / 2);
    let waited = served_after(2);
    assert!(waited > SECOND / 2 && waited < 5 * SECOND, "{waited:?}");
}

#[test]
fn silent_uploads_hold_nobody_up_and_are_given_up() {
    let server = limited(Limits { idle_seconds: 1, ..Limits::default() });
    let mut silent: Vec<_> = (0..40).map(|_| connect(&server)).collect();
    for stream in &mut silent {
        stream.write_all(post_head("/v1/scenes", 1000).as_bytes()).unwrap();
        stream.write_all(b"glTF").unwrap();
    }
    let begun = Instant::now();
    assert_eq!(server.post("/v1/scenes", "model/gltf-binary", &triangle()).status, 201);
    assert!(begun.elapsed() < SECOND, "{:?}", begun.elapsed());
    let (said, time) = rest(silent.pop().expect("one"));
    assert!(said.starts_with("HTTP/1.1 408") && said.contains("idle_seconds"), "{said}");
    assert!(time < 5 * SECOND, "{time:?}");
}

#[test]
fn a_slow_upload_that_goes_on_arrives() {
    let server = limited(Limits { idle_seconds: 1, ..Limits::default() });
    let body = triangle();
    let mut stream = connect(&server);
    stream.write_all(post_head("/v1/scenes", body.len()).as_bytes()).unwrap();
    for part in body.chunks(body.len().div_ceil(4)) {
        std::thread::sleep(SECOND / 2);
        stream.write_all(part).unwrap();
    }
    assert!(rest(stream).0.starts_with("HTTP/1.1 201"));
}

#[test]
fn bodies_share_a_bounded_memory() {
    let limits = Limits { upload_bytes: 2 << 20, upload_memory_bytes: 2 << 20, idle_seconds: 2, ..Limits::default() };
    let server = limited(limits);
    let mut holder = connect(&server);
    holder.write_all(post_head("/v1/scenes", 2 << 20).as_bytes()).unwrap();
    holder.write_all(&vec![7; (2 << 20) - 1000]).unwrap();
    std::thread::sleep(SECOND / 5);
    let mut second = connect(&server);
    second.write_all(post_head("/v1/scenes", 100_000).as_bytes()).unwrap();
    second.write_all(&vec![7; 100_000]).unwrap();
    let begun = Instant::now();
    let (said, _) = rest(second);
    // Either its time is up, or the one that held the memory was given up first.
    assert!(said.starts_with("HTTP/1.1 503") || said.starts_with("HTTP/1.1 400"), "{said}");
    assert!(begun.elapsed() > SECOND && begun.elapsed() < 8 * SECOND, "{:?}", begun.elapsed());
    drop(holder);
    assert_eq!(server.post("/v1/scenes", "model/gltf-binary", &triangle()).status, 201);
}

#[test]
fn pages_of_other_sites_change_nothing() {
    let server = Server::start();
    let send = |headers: &[(&str, &str)]| {
        let headers = [&[("content-type", "model/gltf-binary")], headers].concat();
        server.send("POST", "/v1/scenes", &headers, &triangle())
    };
    send(&[("origin", "https://elsewhere.example")]).problem(403, "cross_site");
    send(&[("sec-fetch-site", "cross-site")]).problem(403, "cross_site");
    send(&[("origin", "null")]).problem(403, "cross_site");
    assert_eq!(server.get("/v1/scenes").json()["items"], json!([]));
    let own = format!("http://{}", server.address);
    assert_eq!(send(&[("origin", &own), ("sec-fetch-site", "same-origin")]).status, 201);
    let read = server.send("GET", "/v1/scenes", &[("origin", "https://elsewhere.example")], &[]);
    assert_eq!((read.status, read.header("access-control-allow-origin")), (200, None), "read it may not");
}

#[test]
fn memory_of_a_job_is_bounded_before_it_starts() {
    let status = |job_memory_bytes: u64| {
        let server = limited(Limits { job_memory_bytes, ..Limits::default() });
        let scene = server.upload();
        server.post_json("/v1/jobs", &json!({ "scene": scene, "params": tiny() })).status
    };
    // Two tiles of 64 lanes at 128 bytes, and 128 pixels at 36.
    let picture = 2 * 64 * 128 + 128 * 36;
    assert_eq!(status(picture - 1), 422);
    assert_eq!(status(picture), 202);
}

#[test]
fn what_happens_is_counted() {
    let server = Server::start();
    let scene = server.upload();
    for _ in 0..2 {
        let id = server.begin(&scene, &tiny());
        server.wait_for(&id, &["succeeded"]);
    }
    server.get("/nothing");
    let reply = server.get("/metrics");
    let text = String::from_utf8(reply.body).expect("text");
    for line in [
        "candela_jobs_accepted_total 2",
        "candela_jobs_cached_total 1",
        "candela_jobs_ended_total{state=\"succeeded\"} 2",
        "candela_jobs{state=\"succeeded\"} 2",
        "candela_pixel_samples_total 512",
        "candela_stage_seconds_count{stage=\"trace\"} 1",
        "candela_http_replies_total{method=\"GET\",status=\"404\"} 1",
        "candela_upload_memory_bytes 0",
    ] {
        assert!(text.contains(&format!("{line}\n")), "{line}: {text}");
    }
    assert!(text.ends_with("# EOF\n"));
}
