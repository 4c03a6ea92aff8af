//! A manifest rendered by a server: scenes and images are uploaded once each, the batch is followed, results come as they are ready.

use super::Failure;
use super::render::package;
use crate::jobs::Item;
use crate::params::EnvironmentChoice;
use crate::scene::Limits;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::time::{Duration, Instant};
use ureq::Agent;
use ureq::http::{Request, Response};

/// Time for which a server that is busy is asked again.
const PATIENCE: Duration = Duration::from_secs(600);

/// Longest time of one request.
const REQUEST: Duration = Duration::from_secs(600);

/// Seconds between two looks at the batch, which the server lets pass.
const LOOK: u32 = 2;

/// Longest manifest of a server that does not say what it reads.
const MANIFEST_BYTES: u64 = 4 << 20;

/// Largest result.
const LARGEST: u64 = 4 << 30;

/// Boundary of forms; no file begins a line with it.
const BOUNDARY: &str = "candela-d1f0a2b75c4e49f2a6c0";

/// How the server knows its client.
#[derive(Debug, Clone, Default)]
pub struct Auth {
    /// An API key.
    pub key: Option<String>,
}

/// A server.
pub struct Remote {
    agent: Agent,
    root: String,
    auth: Auth,
}

impl Remote {
    /// A server by its address: `http://127.0.0.1:8080`.
    pub fn new(root: &str, auth: Auth) -> Result<Self, Failure> {
        if !root.starts_with("http://") && !root.starts_with("https://") {
            return Err(Failure::Request(format!("--server {root}: write an address like http://127.0.0.1:8080")));
        }
        let agent = Agent::config_builder().http_status_as_error(false).timeout_global(Some(REQUEST)).build().into();
        Ok(Self { agent, root: root.trim_end_matches('/').to_owned(), auth })
    }

    /// Renders items; each is told of once, in the order in which they are ready.
    pub fn render(
        &self,
        items: &[Item],
        mut tell: impl FnMut(&Item, Result<Vec<u8>, Failure>) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let limits = self.json("GET", "/v1/limits", &[], &[])?;
        let limit =
            |name: &str, usual: u64| usize::try_from(limits[name].as_u64().unwrap_or(usual)).unwrap_or(usize::MAX);
        let (most_items, most_bytes) = (limit("batch_items", 1).max(1), limit("manifest_bytes", MANIFEST_BYTES));
        let mut uploads = Uploads { remote: self, scenes: HashMap::new(), images: HashMap::new() };
        let (mut begin, mut lines) = (0, String::new());
        for (index, item) in items.iter().enumerate() {
            let line = uploads.line(item)?;
            if index - begin == most_items || (index > begin && lines.len() + line.len() > most_bytes) {
                self.batch(&items[begin..index], &std::mem::take(&mut lines), &mut tell)?;
                begin = index;
            }
            lines += &line;
        }
        if lines.is_empty() { Ok(()) } else { self.batch(&items[begin..], &lines, &mut tell) }
    }

    fn batch(
        &self,
        items: &[Item],
        lines: &str,
        tell: &mut impl FnMut(&Item, Result<Vec<u8>, Failure>) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let headers = [("content-type", "application/x-ndjson")];
        let batch = self.json("POST", "/v1/batches", &headers, lines.as_bytes())?;
        let id = text(&batch, "id")?;
        let mut told = vec![false; items.len()];
        while told.iter().any(|told| !told) {
            let wait = format!("wait={LOOK}");
            let batch = self.json("GET", &format!("/v1/batches/{id}"), &[("prefer", &wait)], &[])?;
            let rows = batch["items"].as_array().map(Vec::as_slice).unwrap_or_default();
            for ((item, row), told) in items.iter().zip(rows).zip(&mut told) {
                let result = match row["state"].as_str() {
                    _ if *told => continue,
                    Some("succeeded") => self.result(row),
                    Some("failed") => Err(Failure::Request(text(&row["problem"], "detail").unwrap_or_default())),
                    Some("cancelled") => Err(Failure::Request("somebody cancelled it".to_owned())),
                    _ => continue,
                };
                *told = true;
                tell(item, result)?;
            }
        }
        Ok(())
    }

    fn result(&self, row: &Value) -> Result<Vec<u8>, Failure> {
        let reply = self.send("GET", &format!("/v1/jobs/{}/result", text(row, "job")?), &[], &[])?;
        bytes(checked(reply)?)
    }

    fn json(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Result<Value, Failure> {
        let reply = checked(self.send(method, path, headers, body)?)?;
        serde_json::from_slice(&bytes(reply)?).map_err(|error| machine(&format!("{path}: {error}")))
    }

    /// Sends, and sends again while the server is busy.
    fn send(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &[u8],
    ) -> Result<Response<ureq::Body>, Failure> {
        let begun = Instant::now();
        loop {
            let mut request = Request::builder().method(method).uri(format!("{}{path}", self.root));
            for (name, value) in headers {
                request = request.header(*name, *value);
            }
            if let Some(key) = &self.auth.key {
                request = request.header("authorization", format!("Bearer {key}"));
            }
            let request = request.body(body).map_err(|error| Failure::Request(error.to_string()))?;
            let reply = self.agent.run(request).map_err(|error| machine(&format!("{}{path}: {error}", self.root)))?;
            let retry = reply.headers().get("retry-after").and_then(|value| value.to_str().ok()?.parse().ok());
            let retry = retry.map(Duration::from_secs).filter(|_| matches!(reply.status().as_u16(), 429 | 503));
            match retry {
                Some(pause) if begun.elapsed() + pause < PATIENCE => std::thread::sleep(pause),
                _ => return Ok(reply),
            }
        }
    }
}

/// What the server has been given.
struct Uploads<'a> {
    remote: &'a Remote,
    scenes: HashMap<String, String>,
    images: HashMap<String, String>,
}

impl Uploads<'_> {
    /// The line of an item as the server reads it: with ids in the place of files.
    fn line(&mut self, item: &Item) -> Result<String, Failure> {
        let scene = self.scene(&item.scene)?;
        let mut params = item.params.clone();
        if let Some(file) = item.params.hdri_name() {
            let id = self.image(file)?;
            if let EnvironmentChoice::Given(environment) = &mut params.environment {
                environment.hdri = Some(id);
            }
        }
        for (_, file) in params.map_names_mut() {
            *file = self.image(file)?;
        }
        let Item { name, priority, webhook, .. } = item;
        let webhook = webhook.as_ref().map(|url| json!({ "url": url }));
        let line = json!({ "scene": scene, "name": name, "params": params, "priority": priority, "webhook": webhook });
        Ok(format!("{line}\n"))
    }

    fn scene(&mut self, scene: &str) -> Result<String, Failure> {
        if let Some(id) = self.scenes.get(scene) {
            return Ok(id.clone());
        }
        let package = package(scene, &Limits::default())?;
        let kind = format!("multipart/form-data; boundary={BOUNDARY}");
        let reply = self.remote.json("POST", "/v1/scenes", &[("content-type", &kind)], &form(package.files())?);
        let reply = reply.map_err(|failure| Failure::Request(format!("{scene}: {failure}")))?;
        let id = text(&reply, "id")?;
        self.scenes.insert(scene.to_owned(), id.clone());
        Ok(id)
    }

    fn image(&mut self, file: &str) -> Result<String, Failure> {
        if let Some(id) = self.images.get(file) {
            return Ok(id.clone());
        }
        let bytes = std::fs::read(file).map_err(|error| Failure::Request(format!("image {file}: {error}")))?;
        let headers = [("content-type", "application/octet-stream")];
        let id = text(&self.remote.json("POST", "/v1/images", &headers, &bytes)?, "id")?;
        self.images.insert(file.to_owned(), id.clone());
        Ok(id)
    }
}

/// A form of files by name.
fn form<'a>(files: impl Iterator<Item = (&'a str, &'a std::sync::Arc<[u8]>)>) -> Result<Vec<u8>, Failure> {
    let mut body = Vec::new();
    for (name, bytes) in files {
        if name.contains(['"', '\\']) || name.chars().any(char::is_control) {
            return Err(Failure::Request(format!("the file name {name:?} cannot be sent: rename it")));
        }
        let file = if name.is_empty() { String::new() } else { format!("; filename=\"{name}\"") };
        body.extend(format!("--{BOUNDARY}\r\ncontent-disposition: form-data; name=\"scene\"{file}\r\n\r\n").bytes());
        body.extend_from_slice(bytes);
        body.extend(b"\r\n");
    }
    body.extend(format!("--{BOUNDARY}--\r\n").bytes());
    Ok(body)
}

/// The reply, unless it is a fault.
fn checked(reply: Response<ureq::Body>) -> Result<Response<ureq::Body>, Failure> {
    let status = reply.status();
    if status.is_success() {
        return Ok(reply);
    }
    let problem: Value = serde_json::from_slice(&bytes(reply)?).unwrap_or_default();
    let detail = problem["detail"].as_str().unwrap_or("no more is known");
    let text = format!("the server answered {status}: {detail}");
    Err(if status.is_client_error() { Failure::Request(text) } else { machine(&text) })
}

fn bytes(reply: Response<ureq::Body>) -> Result<Vec<u8>, Failure> {
    reply.into_body().into_with_config().limit(LARGEST).read_to_vec().map_err(|error| machine(&error.to_string()))
}

fn text(value: &Value, field: &str) -> Result<String, Failure> {
    let found = value[field].as_str().map(str::to_owned);
    found.ok_or_else(|| machine(&format!("the server's reply has no `{field}`: is this a Candela server?")))
}

fn machine(text: &str) -> Failure {
    Failure::Machine(text.to_owned())
}
