//! What the log says of requests and jobs: enough to find out who did what.

use crate::engine;
use crate::support::{Server, Setup, endless, triangle};
use candela::http::Access;
use candela::http::keys::{KeyFile, Scope};
use serde_json::json;
use std::io::{self, Write};
use std::sync::{Arc, Mutex};

/// A log that can be read.
#[derive(Clone, Default)]
struct Lines(Arc<Mutex<Vec<u8>>>);

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Lines {
    /// The line that has all of these.
    fn with(&self, parts: &[&str]) -> String {
        let text = String::from_utf8(self.0.lock().unwrap().clone()).unwrap();
        let line = text.lines().find(|line| parts.iter().all(|part| line.contains(part)));
        line.unwrap_or_else(|| panic!("no line has {parts:?}")).to_owned()
    }
}

#[test]
fn the_log_says_who_did_what() {
    let lines = Lines::default();
    let writer = lines.clone();
    // Of all servers of this process: nobody else sets one.
    let subscriber = tracing_subscriber::fmt().with_ansi(false).with_writer(move || writer.clone()).finish();
    tracing::subscriber::set_global_default(subscriber).expect("the only one");

    let folder = tempfile::tempdir().unwrap();
    let (path, mut file) = (folder.path().join("keys.json"), KeyFile::default());
    let [a, b] = ["log-a", "log-b"].map(|name| file.add(name, Scope::Render, None, None).unwrap());
    let slow = file.add("log-slow", Scope::Read, Some(1), None).unwrap();
    file.write(&path).unwrap();
    let access = Access::new(Some(&path), Vec::new()).unwrap();
    let server = Server::set_up(Setup { access, ..Setup::default() }, engine::faulty(engine::Fault::None, 0));
    let trace = "0af7651916cd43dd8448eb211c80319c";
    let parent = format!("00-{trace}-b7ad6b7169203331-01");
    let ask = |key: &str, id: &str, method: &str, path: &str, kind: &str, body: &[u8]| {
        let bearer = format!("Bearer {key}");
        let headers = [
            ("authorization", bearer.as_str()),
            ("content-type", kind),
            ("x-request-id", id),
            ("traceparent", &parent),
        ];
        server.send(method, path, &headers, body)
    };

    let scene = ask(&a, "log-1", "POST", "/v1/scenes", "model/gltf-binary", &triangle()).json();
    let body = json!({ "scene": scene["id"], "params": endless() }).to_string();
    let job = ask(&a, "log-2", "POST", "/v1/jobs", "application/json", body.as_bytes()).json();
    let job = job["id"].as_str().expect("an id");
    assert_eq!(ask(&b, "log-3", "POST", &format!("/v1/jobs/{job}/cancel"), "", &[]).status, 200);
    assert_eq!(ask("candela_wrong", "log-4", "DELETE", &format!("/v1/jobs/{job}"), "", &[]).status, 401);
    for _ in 0..2 {
        ask(&slow, "log-5", "GET", "/v1/jobs", "", &[]);
    }
    assert_eq!(ask(&a, "log-6", "GET", "/healthz", "", &[]).status, 200);

    lines.with(&["request", "log-3", "cancel", "key:log-b", "status=200"]);
    lines.with(&["request", "log-4", "DELETE", "127.0.0.1", "status=401", "unauthorized"]);
    lines.with(&["request", "log-5", "key:log-slow", "status=429", "rate_limited"]);
    lines.with(&["request", "log-6", "127.0.0.1", "status=200"]);
    for part in ["job accepted", "job over"] {
        lines.with(&[part, job, "key:log-a", "log-2", trace]);
    }
    lines.with(&["request", "log-2", "path=\"/v1/jobs\"", trace]);
}
