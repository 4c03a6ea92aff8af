//! `candela serve` as a process of its own, and as much of a client as it takes.

use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use ureq::Agent;

/// A server on a free port of this machine. Dropping it kills it.
pub struct Server {
    pub address: String,
    process: Child,
}

impl Server {
    /// With a data folder or without; ready when this returns.
    pub fn start(folder: Option<&Path>) -> Self {
        let usual =
            ["--save-film-ms", "40", "--queue-length", "100000", "--kept-jobs", "100000", "--drain-seconds", "0"];
        Self::start_with(folder, &usual)
    }

    /// With arguments of `candela serve` besides.
    pub fn start_with(folder: Option<&Path>, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_candela"));
        command.args(["serve", "--listen", "127.0.0.1:0"]).args(arguments).env("NODEVICE_SELECT", "1");
        if let Some(folder) = folder {
            command.arg("--data").arg(folder);
        }
        let mut process = command.stderr(Stdio::piped()).stdin(Stdio::null()).spawn().expect("candela runs");
        let mut lines = BufReader::new(process.stderr.take().expect("a pipe")).lines().map_while(Result::ok);
        let mut said = Vec::new();
        let address = loop {
            let line = lines.next().unwrap_or_else(|| panic!("the server has ended: {said:#?}"));
            if let Some((_, rest)) = line.split_once("http://") {
                break rest.trim_end_matches('/').to_owned();
            }
            said.push(line);
        };
        // What nobody reads would block the server one day.
        std::thread::spawn(move || {
            for line in lines.filter(|line| line.contains("ERROR") || line.contains("panicked")) {
                eprintln!("server: {line}");
            }
        });
        Self { address, process }
    }

    /// `kill -9`.
    pub fn kill(mut self) {
        self.process.kill().expect("it runs");
        self.process.wait().expect("it ends");
    }

    /// SIGTERM; the server must end well.
    pub fn stop(mut self) {
        let id = self.process.id().to_string();
        assert!(Command::new("kill").arg(id).status().expect("kill runs").success());
        assert!(self.process.wait().expect("it ends").success());
    }

    /// Memory of the process and of those that it has started, bytes; none where the system does not say (Linux does).
    pub fn memory(&self) -> Option<u64> {
        let of = |id: &str| {
            let status = std::fs::read_to_string(format!("/proc/{id}/status")).ok()?;
            let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
            line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib << 10)
        };
        let own = of(&self.process.id().to_string())?;
        Some(own + self.children().iter().filter_map(|(id, _)| of(id)).sum::<u64>())
    }

    /// Id and command line of the processes that the server has started; none where the system does not say.
    pub fn children(&self) -> Vec<(String, String)> {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.process.id()));
        let mut found = Vec::new();
        for task in tasks.into_iter().flatten().flatten() {
            // A thread may end while its list is read.
            let ids = std::fs::read_to_string(task.path().join("children")).unwrap_or_default();
            for id in ids.split_whitespace() {
                let arguments = std::fs::read_to_string(format!("/proc/{id}/cmdline")).unwrap_or_default();
                found.push((id.to_owned(), arguments.replace('\0', " ").trim().to_owned()));
            }
        }
        found
    }

    /// Uploads a scene; its id, unless the server is gone.
    pub fn upload(&self, glb: &[u8]) -> Option<String> {
        Some(self.try_post("/v1/scenes", "model/gltf-binary", glb)?.1["id"].as_str()?.to_owned())
    }

    /// Status and JSON of the reply to a file.
    pub fn post(&self, path: &str, kind: &str, body: &[u8]) -> (u16, Value) {
        self.try_post(path, kind, body).expect("a reply")
    }

    fn try_post(&self, path: &str, kind: &str, body: &[u8]) -> Option<(u16, Value)> {
        let url = format!("http://{}{path}", self.address);
        let mut reply = agent(Duration::from_secs(60)).post(&url).header("content-type", kind).send(body).ok()?;
        Some((reply.status().as_u16(), reply.body_mut().read_json().ok()?))
    }

    /// Sends JSON (null: nothing) and answers status and JSON; none if the server is gone.
    pub fn send(&self, method: &str, path: &str, body: &Value, anew: bool, key: Option<&str>) -> Option<(u16, Value)> {
        let text = if body.is_null() { String::new() } else { body.to_string() };
        let mut request = ureq::http::Request::builder().method(method).uri(format!("http://{}{path}", self.address));
        if !body.is_null() {
            request = request.header("content-type", "application/json");
        }
        if anew {
            request = request.header("cache-control", "no-cache");
        }
        if let Some(key) = key {
            request = request.header("idempotency-key", key);
        }
        let mut reply = agent(Duration::from_secs(60)).run(request.body(text).ok()?).ok()?;
        Some((reply.status().as_u16(), reply.body_mut().read_json().ok()?))
    }

    /// Status of the reply to a scene that is rendered at once.
    pub fn render(&self, path: &str, glb: &[u8]) -> u16 {
        let url = format!("http://{}{path}", self.address);
        let request = agent(Duration::from_secs(60)).post(&url).header("content-type", "model/gltf-binary");
        request.send(glb).expect("a reply").status().as_u16()
    }

    /// `GET` of JSON.
    pub fn get(&self, path: &str) -> (u16, Value) {
        let reply = agent(Duration::from_secs(60)).get(format!("http://{}{path}", self.address)).call();
        let mut reply = reply.expect("a reply");
        (reply.status().as_u16(), reply.body_mut().read_json().expect("JSON"))
    }

    /// The picture of a job, once it is there.
    pub fn result(&self, id: &str) -> Vec<u8> {
        let begun = Instant::now();
        loop {
            let reply =
                agent(Duration::from_secs(60)).get(format!("http://{}/v1/jobs/{id}/result", self.address)).call();
            let mut reply = reply.expect("a reply");
            let status = reply.status().as_u16();
            let bytes = reply.body_mut().read_to_vec().expect("a body");
            match status {
                200 => return bytes,
                409 if begun.elapsed() < Duration::from_secs(120) => std::thread::sleep(Duration::from_millis(20)),
                _ => panic!("{id}: {status} {}", String::from_utf8_lossy(&bytes)),
            }
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Listens to a job after an event, until the stream ends; tells id and name of each event.
pub fn follow(address: &str, job: &str, last: u64, mut tell: impl FnMut(u64, &str)) {
    let request = agent(Duration::from_secs(600)).get(format!("http://{address}/v1/jobs/{job}/events"));
    let Ok(reply) = request.header("last-event-id", last.to_string()).call() else { return };
    let (mut id, mut kind) = (0, String::new());
    for line in BufReader::new(reply.into_body().into_reader()).lines().map_while(Result::ok) {
        match line.split_once(':').map(|(name, value)| (name, value.trim())) {
            Some(("id", value)) => id = value.parse().unwrap_or(0),
            Some(("event", value)) => value.clone_into(&mut kind),
            // An event that was cut off has no empty line at its end, and has not been heard.
            None if line.is_empty() && !kind.is_empty() => {
                tell(id, &kind);
                kind.clear();
            }
            _ => {}
        }
    }
}

fn agent(patience: Duration) -> Agent {
    Agent::config_builder().http_status_as_error(false).timeout_global(Some(patience)).build().into()
}
