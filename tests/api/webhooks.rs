//! The end of a job is told, signed, until it is taken.

use crate::engine;
use crate::support::{Reply, Server, Setup, tiny};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use candela::jobs::Webhooks;
use hmac::{Hmac, KeyInit, Mac};
use serde_json::{Value, json};
use sha2::Sha256;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::time::{Duration, Instant};

const SECRET: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

fn serve(folder: Option<&Path>, allowed: &[&str]) -> Server {
    let allowed: Vec<String> = allowed.iter().map(|host| (*host).to_owned()).collect();
    let webhooks = Some(Webhooks::new(SECRET, &allowed).unwrap());
    let setup = Setup { folder: folder.map(Path::to_owned), webhooks, ..Setup::default() };
    Server::set_up(setup, engine::faulty(engine::Fault::TooLarge, 0))
}

fn begin(server: &Server, scene: &str, url: &str, params: &Value) -> Reply {
    server.post_json("/v1/jobs", &json!({ "scene": scene, "params": params, "webhook": { "url": url } }))
}

/// A message as it came.
struct Message {
    headers: Vec<(String, String)>,
    body: Vec<u8>,
}

impl Message {
    fn header(&self, name: &str) -> &str {
        self.headers.iter().find(|(known, _)| known == name).map_or("", |(_, value)| value)
    }

    /// As its receiver has to read it: signature first.
    fn verified(&self) -> Value {
        let key = STANDARD.decode(SECRET.trim_start_matches("whsec_")).unwrap();
        let mut mac = Hmac::<Sha256>::new_from_slice(&key).unwrap();
        mac.update(format!("{}.{}.", self.header("webhook-id"), self.header("webhook-timestamp")).as_bytes());
        mac.update(&self.body);
        let expected = format!("v1,{}", STANDARD.encode(mac.finalize().into_bytes()));
        assert_eq!(self.header("webhook-signature"), expected);
        serde_json::from_slice(&self.body).unwrap()
    }
}

/// Takes one message, which has to come soon, and answers it.
fn receive(listener: &TcpListener, answer: &str) -> Message {
    listener.set_nonblocking(true).unwrap();
    let begun = Instant::now();
    let stream = loop {
        match listener.accept() {
            Ok((stream, _)) => break stream,
            Err(_) => assert!(begun.elapsed() < Duration::from_secs(40), "no message has come"),
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    stream.set_nonblocking(false).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let mut reader = BufReader::new(stream);
    let mut headers = Vec::new();
    let mut line = String::new();
    while reader.read_line(&mut line).unwrap() > 2 {
        if let Some((name, value)) = line.split_once(':') {
            headers.push((name.to_ascii_lowercase(), value.trim().to_owned()));
        }
        line.clear();
    }
    let length =
        headers.iter().find(|(name, _)| name == "content-length").map_or(0, |(_, value)| value.parse().unwrap());
    let mut body = vec![0; length];
    reader.read_exact(&mut body).unwrap();
    write!(reader.get_mut(), "HTTP/1.1 {answer}\r\ncontent-length: 0\r\nconnection: close\r\n\r\n").unwrap();
    Message { headers, body }
}

#[test]
fn ends_are_told_and_signed() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let server = serve(None, &["127.0.0.1"]);
    let scene = server.upload();
    let url = format!("http://{}/hook", listener.local_addr().unwrap());
    let good = begin(&server, &scene, &url, &tiny()).json();
    let message = receive(&listener, "204 No Content");
    let told = message.verified();
    assert_eq!((&told["type"], &told["data"]["job"]), (&json!("job.succeeded"), &good["id"]));
    assert_eq!((&told["data"]["state"], &told["data"]["report"]["samples"]), (&json!("succeeded"), &json!(4)));
    assert_eq!(message.header("webhook-id"), format!("msg_{}", good["id"].as_str().unwrap()));
    assert!(told["timestamp"].as_str().is_some_and(|time| time.len() == 24 && time.ends_with('Z')), "{told}");
    let faulty = json!({ "width": 8, "height": 8, "max_samples": 4, "seed": engine::FAULTY_SEED });
    begin(&server, &scene, &url, &faulty);
    let told = receive(&listener, "200 OK").verified();
    assert_eq!((&told["type"], &told["data"]["problem"]["code"]), (&json!("job.failed"), &json!("render_too_large")));
    // Taken is taken.
    listener.set_nonblocking(true).unwrap();
    std::thread::sleep(Duration::from_secs(2));
    assert!(listener.accept().is_err(), "told twice");
}

#[test]
fn items_of_a_batch_are_told_one_by_one() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let server = serve(None, &["127.0.0.1"]);
    let scene = server.upload();
    let url = format!("http://{}/hook", listener.local_addr().unwrap());
    let faulty = json!({ "width": 8, "height": 8, "max_samples": 4, "seed": engine::FAULTY_SEED });
    let line = |name: &str, params: &Value, webhook: Value| {
        let item = json!({ "scene": scene, "name": name, "params": params, "webhook": webhook });
        format!("{item}\n")
    };
    let hook = || json!({ "url": url });
    let lines = [line("good", &tiny(), hook()), line("silent", &tiny(), Value::Null), line("bad", &faulty, hook())];
    let batch = server.post("/v1/batches", "application/x-ndjson", lines.concat().as_bytes());
    assert_eq!(batch.status, 202, "{batch:?}");
    let items = batch.json()["items"].clone();
    let mut told: Vec<Value> = (0..2).map(|_| receive(&listener, "204 No Content").verified()).collect();
    told.sort_by_key(|message| message["type"].as_str().unwrap().to_owned());
    let facts: Vec<_> = told.iter().map(|message| (message["type"].clone(), message["data"]["job"].clone())).collect();
    let expected = [(json!("job.failed"), items[2]["job"].clone()), (json!("job.succeeded"), items[0]["job"].clone())];
    assert_eq!(facts, expected);
    // A matrix has one for all.
    let matrix =
        json!({ "scenes": [scene], "params": tiny(), "lights": [[], [{ "type": "ambient" }]], "webhook": hook() });
    let jobs = server.post_json("/v1/batches", &matrix).json()["items"].clone();
    let mut told: Vec<String> =
        (0..2).map(|_| receive(&listener, "200 OK").verified()["data"]["job"].to_string()).collect();
    let mut expected: Vec<String> = jobs.as_array().unwrap().iter().map(|item| item["job"].to_string()).collect();
    told.sort_unstable();
    expected.sort_unstable();
    assert_eq!(told, expected);
    // An address that is not allowed is one of the item.
    let line = line("a", &tiny(), json!({ "url": "http://127.0.0.2/" }));
    let problem = server.post("/v1/batches", "application/x-ndjson", line.as_bytes()).problem(422, "invalid_params");
    assert_eq!(problem["errors"][0]["pointer"], "/items/0/webhook/url");
}

#[test]
fn what_was_not_taken_is_sent_again_after_a_restart_too() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let first = {
        let server = serve(Some(folder.path()), &["127.0.0.1"]);
        let scene = server.upload();
        begin(&server, &scene, &format!("http://{address}/"), &tiny());
        receive(&listener, "500 Internal Server Error")
    };
    let _server = serve(Some(folder.path()), &["127.0.0.1"]);
    // A redirect is not followed.
    let second = receive(&listener, "302 Found\r\nlocation: http://127.0.0.1:1/");
    assert_eq!((second.header("webhook-id"), &second.body), (first.header("webhook-id"), &first.body));
    assert_eq!(second.verified()["type"], "job.succeeded");
}

#[test]
fn only_allowed_addresses_are_taken() {
    let server = serve(None, &[]);
    let scene = server.upload();
    for url in [
        "http://example.com/",
        "https://127.0.0.1/",
        "https://[::1]/",
        "https://192.168.0.1/",
        "https://a:b@example.com/",
        "example",
    ] {
        let problem = begin(&server, &scene, url, &tiny()).problem(422, "invalid_params");
        assert_eq!(problem["errors"][0]["pointer"], "/webhook/url", "{url}");
    }
    let silent = Server::start();
    let scene = silent.upload();
    let problem = begin(&silent, &scene, "https://example.com/", &tiny()).problem(422, "invalid_params");
    assert_eq!(problem["errors"][0]["pointer"], "/webhook");
}
