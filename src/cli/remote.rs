//! A manifest rendered by a server: scenes and images are uploaded once each, the batch is followed, results come as they are ready.

use super::Failure;
use super::render::package;
use super::stop::on_stop;
use crate::jobs::Item;
use crate::params::EnvironmentChoice;
use crate::scene::Limits;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use ureq::Agent;
use ureq::http::{Request, StatusCode};

/// Time for which a server that is busy is asked again.
const PATIENCE: Duration = Duration::from_secs(600);

/// Time for which a server that was there and is not is waited for, as while it is restarted.
const OUTAGE: Duration = Duration::from_secs(120);

/// First pause while it is waited for; each is twice as long as the one before, up to the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(250);

/// Longest of these pauses.
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

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

/// A server. Cloning gives another handle to the same one.
#[derive(Clone)]
pub struct Remote {
    agent: Agent,
    root: String,
    auth: Auth,
    /// The batch that the server works on; locked while one is sent, and while one is told of.
    under_way: Arc<Mutex<Option<String>>>,
}

/// What is asked of a server.
struct Ask<'a> {
    method: &'a str,
    path: &'a str,
    headers: &'a [(&'a str, &'a str)],
    body: &'a [u8],
}

/// What it answers.
struct Reply {
    status: StatusCode,
    retry_after: Option<Duration>,
    body: Vec<u8>,
}

impl Remote {
    /// A server by its address: `http://127.0.0.1:8080`.
    pub fn new(root: &str, auth: Auth) -> Result<Self, Failure> {
        if !root.starts_with("http://") && !root.starts_with("https://") {
            return Err(Failure::Request(format!("--server {root}: write an address like http://127.0.0.1:8080")));
        }
        let agent = Agent::config_builder().http_status_as_error(false).timeout_global(Some(REQUEST)).build().into();
        Ok(Self { agent, root: root.trim_end_matches('/').to_owned(), auth, under_way: Arc::default() })
    }

    /// Renders items; each is told of once, in the order in which they are ready. What a signal or a fault ends here ends there, too.
    pub fn render(
        &self,
        items: &[Item],
        mut tell: impl FnMut(&Item, Result<Vec<u8>, Failure>) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        // A server that was never there is not waited for.
        let limits = Ask { method: "GET", path: "/v1/limits", headers: &[], body: &[] };
        let limits = read(&limits, &self.ask(&limits, Duration::ZERO)?)?;
        let remote = self.clone();
        on_stop(move || remote.stop());
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
        let id = self.begin(lines)?;
        let followed = self.follow(&id, items, tell);
        if self.lock().take().is_some() && followed.is_err() {
            // What failed is what is told.
            let _ = self.cancel(&id);
        }
        followed
    }

    /// Sends a batch, which is the same one however often it has to be sent.
    fn begin(&self, lines: &str) -> Result<String, Failure> {
        let mut under_way = self.lock();
        let mut noise = [0; 16];
        getrandom::fill(&mut noise).map_err(|error| machine(&format!("no random numbers: {error}")))?;
        let key = format!("{:032x}", u128::from_ne_bytes(noise));
        let headers = [("content-type", "application/x-ndjson"), ("idempotency-key", &key)];
        let id = text(&self.json("POST", "/v1/batches", &headers, lines.as_bytes())?, "id")?;
        *under_way = Some(id.clone());
        Ok(id)
    }

    fn follow(
        &self,
        id: &str,
        items: &[Item],
        tell: &mut impl FnMut(&Item, Result<Vec<u8>, Failure>) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
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
                // Whoever was told to stop tells of nothing more.
                let _under_way = self.lock();
                tell(item, result)?;
            }
        }
        Ok(())
    }

    /// Ends what is under way, before the process ends: nothing is begun or told any more.
    fn stop(&self) {
        let under_way = self.lock();
        if let Some(id) = under_way.as_deref() {
            match self.cancel(id) {
                Ok(()) => eprintln!("candela: stopped; {id} is cancelled"),
                Err(failure) => eprintln!("candela: stopped; {id} goes on: {failure}"),
            }
        }
        std::mem::forget(under_way);
    }

    fn cancel(&self, id: &str) -> Result<(), Failure> {
        let path = format!("/v1/batches/{id}/cancel");
        self.ask(&Ask { method: "POST", path: &path, headers: &[], body: &[] }, Duration::ZERO).map(drop)
    }

    fn lock(&self) -> MutexGuard<'_, Option<String>> {
        self.under_way.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn result(&self, row: &Value) -> Result<Vec<u8>, Failure> {
        let path = format!("/v1/jobs/{}/result", text(row, "job")?);
        self.ask(&Ask { method: "GET", path: &path, headers: &[], body: &[] }, OUTAGE)
    }

    fn json(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Result<Value, Failure> {
        let ask = Ask { method, path, headers, body };
        read(&ask, &self.ask(&ask, OUTAGE)?)
    }

    /// Asks, again while the server is busy, and for some time while it is not there. All that is asked for is the same if it is asked
    /// for twice.
    fn ask(&self, ask: &Ask, outage: Duration) -> Result<Vec<u8>, Failure> {
        let (begun, mut gone, mut pause) = (Instant::now(), None, FIRST_PAUSE);
        loop {
            let reply = self.send(ask)?;
            let wait = match &reply {
                Ok(Reply { status, retry_after: Some(wait), .. }) if matches!(status.as_u16(), 429 | 503) => {
                    gone = None;
                    Some(*wait).filter(|wait| begun.elapsed() + *wait < PATIENCE)
                }
                // A proxy says that it is not there.
                Ok(reply) if !matches!(reply.status.as_u16(), 502..=504) => None,
                _ => {
                    let since = *gone.get_or_insert_with(Instant::now);
                    let wait = pause;
                    pause = (2 * pause).min(LONGEST_PAUSE);
                    Some(wait).filter(|wait| since.elapsed() + *wait < outage)
                }
            };
            match wait {
                Some(wait) => std::thread::sleep(wait),
                None => return reply.map_err(|error| machine(&self.lost(ask, &error))).and_then(checked),
            }
        }
    }

    /// Asks once. The inner error is one that may pass.
    fn send(&self, ask: &Ask) -> Result<Result<Reply, ureq::Error>, Failure> {
        let mut request = Request::builder().method(ask.method).uri(format!("{}{}", self.root, ask.path));
        for (name, value) in ask.headers {
            request = request.header(*name, *value);
        }
        if let Some(key) = &self.auth.key {
            request = request.header("authorization", format!("Bearer {key}"));
        }
        let request = request.body(ask.body).map_err(|error| Failure::Request(error.to_string()))?;
        let reply = self.agent.run(request).and_then(|reply| {
            let (head, body) = reply.into_parts();
            let seconds = head.headers.get("retry-after").and_then(|value| value.to_str().ok()?.parse().ok());
            let body = body.into_with_config().limit(LARGEST).read_to_vec()?;
            Ok(Reply { status: head.status, retry_after: seconds.map(Duration::from_secs), body })
        });
        match reply {
            Err(error) if !may_pass(&error) => Err(machine(&self.lost(ask, &error))),
            reply => Ok(reply),
        }
    }

    fn lost(&self, ask: &Ask, error: &ureq::Error) -> String {
        format!("{}{}: {error}", self.root, ask.path)
    }
}

/// Whether an error is one of the connection, which another one may not meet.
fn may_pass(error: &ureq::Error) -> bool {
    use ureq::Error;
    matches!(
        error,
        Error::Io(_) | Error::Timeout(_) | Error::ConnectionFailed | Error::HostNotFound | Error::Protocol(_)
    )
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
        for (_, file) in params.profile_names_mut() {
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
fn form<'a>(files: impl Iterator<Item = (&'a str, &'a Arc<[u8]>)>) -> Result<Vec<u8>, Failure> {
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

/// What a reply holds, unless it is a fault.
fn checked(reply: Reply) -> Result<Vec<u8>, Failure> {
    let Reply { status, body, .. } = reply;
    if status.is_success() {
        return Ok(body);
    }
    let problem: Value = serde_json::from_slice(&body).unwrap_or_default();
    let detail = problem["detail"].as_str().unwrap_or("no more is known");
    let text = format!("the server answered {status}: {detail}");
    Err(if status.is_client_error() { Failure::Request(text) } else { machine(&text) })
}

fn read(ask: &Ask, body: &[u8]) -> Result<Value, Failure> {
    serde_json::from_slice(body).map_err(|error| machine(&format!("{}: {error}", ask.path)))
}

fn text(value: &Value, field: &str) -> Result<String, Failure> {
    let found = value[field].as_str().map(str::to_owned);
    found.ok_or_else(|| machine(&format!("the server's reply has no `{field}`: is this a Candela server?")))
}

fn machine(text: &str) -> Failure {
    Failure::Machine(text.to_owned())
}
