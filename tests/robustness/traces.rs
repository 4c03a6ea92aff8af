//! Traces that are told to a collector, as it gets them.

use crate::server::Server;
use candela::demo;
use serde_json::json;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Takes every message that comes and hands on its head and body.
fn collect(listener: TcpListener) -> mpsc::Receiver<(String, Vec<u8>)> {
    let (tell, told) = mpsc::channel();
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let mut reader = BufReader::new(stream);
            // A connection may bring several.
            loop {
                let (mut head, mut line) = (String::new(), String::new());
                while reader.read_line(&mut line).is_ok_and(|length| length > 2) {
                    head += &line.to_ascii_lowercase();
                    line.clear();
                }
                let length = head.lines().find_map(|line| line.strip_prefix("content-length:")?.trim().parse().ok());
                let mut body = vec![0; length.unwrap_or(0)];
                if head.is_empty() || reader.read_exact(&mut body).is_err() {
                    break;
                }
                let _ = tell.send((head, body));
                let _ = reader.get_mut().write_all(b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n");
            }
        }
    });
    told
}

fn has(body: &[u8], part: &[u8]) -> bool {
    body.windows(part.len()).any(|window| window == part)
}

#[test]
fn requests_and_jobs_are_told_to_a_collector_that_was_named() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let endpoint = format!("http://{}", listener.local_addr().expect("an address"));
    let told = collect(listener);
    let server = Server::start_with(None, &["--otlp-endpoint", &endpoint, "--apart", "false"]);
    let trace = "0af7651916cd43dd8448eb211c80319c";
    let scene = server.upload(&demo::by_name("plane").expect("the demo")).expect("an upload");
    let body = json!({ "scene": scene, "params": { "engine": "cpu", "width": 16, "height": 8, "max_samples": 4 } });
    let parent = format!("00-{trace}-b7ad6b7169203331-01");
    let job = ureq::post(format!("http://{}/v1/jobs", server.address)).header("traceparent", parent).send_json(body);
    let job: serde_json::Value = job.expect("a reply").body_mut().read_json().expect("a job");
    let id = job["id"].as_str().expect("an id");
    assert!(!server.result(id).is_empty());
    // What has gathered is told before the end.
    server.stop();
    let (begun, mut all) = (Instant::now(), Vec::new());
    let id_bytes: Vec<u8> =
        (0..16).map(|n| u8::from_str_radix(&trace[2 * n..2 * n + 2], 16).expect("two digits")).collect();
    let names: [&[u8]; 8] =
        [b"candela", b"request", b"/v1/jobs", b"job", b"compile", b"trace", b"encode", id.as_bytes()];
    while begun.elapsed() < Duration::from_secs(10) {
        let Ok((head, body)) = told.recv_timeout(Duration::from_millis(200)) else { continue };
        assert!(head.starts_with("post /v1/traces ") && head.contains("application/x-protobuf"), "{head}");
        all.extend(body);
        if names.iter().all(|name| has(&all, name)) && has(&all, &id_bytes) {
            // Request, job and its three parts are of the trace that the client named.
            let of_it = all.windows(16).filter(|window| **window == id_bytes[..]).count();
            assert!(of_it >= 5, "{of_it} spans");
            return;
        }
    }
    panic!("not all was told: {}", String::from_utf8_lossy(&all));
}

#[test]
fn a_collector_that_is_not_there_holds_nothing_up() {
    let server = Server::start_with(None, &["--otlp-endpoint", "http://127.0.0.1:1", "--apart", "false"]);
    assert_eq!(server.get("/v1/limits").0, 200);
    let begun = Instant::now();
    server.stop();
    assert!(begun.elapsed() < Duration::from_secs(15), "{:?}", begun.elapsed());
}
