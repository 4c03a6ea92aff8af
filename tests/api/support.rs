//! A server in this process, a client, and a small scene.

use crate::engine;
use candela::config::Limits;
use candela::denoise::Denoiser;
use candela::http::{self, Access};
use candela::jobs::{EngineFactory, Service, Webhooks};
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::oneshot;
use ureq::Agent;
use ureq::http::Response;

/// A server on a free port. Dropping it shuts it down and waits for its end.
pub struct Server {
    pub address: SocketAddr,
    stop: Mutex<Option<oneshot::Sender<()>>>,
    thread: Option<JoinHandle<()>>,
}

/// What a server may have.
#[derive(Default)]
pub struct Setup {
    pub folder: Option<PathBuf>,
    pub limits: Limits,
    pub patience: Duration,
    pub access: Access,
    pub webhooks: Option<Webhooks>,
    pub denoiser: Option<Denoiser>,
    /// Where it listens; none: on a free port.
    pub address: Option<SocketAddr>,
}

impl Server {
    /// With default limits and any engine.
    pub fn start() -> Self {
        Self::with(Limits::default(), engine::any(), Duration::ZERO)
    }

    /// `patience`: time that jobs get to finish at the end.
    pub fn with(limits: Limits, factory: EngineFactory, patience: Duration) -> Self {
        Self::in_folder(None, limits, factory, patience)
    }

    /// With a data folder.
    pub fn in_folder(folder: Option<&Path>, limits: Limits, factory: EngineFactory, patience: Duration) -> Self {
        Self::set_up(Setup { folder: folder.map(Path::to_owned), limits, patience, ..Setup::default() }, factory)
    }

    /// With whatever a server may have.
    pub fn set_up(setup: Setup, factory: EngineFactory) -> Self {
        let Setup { folder, limits, patience, access, webhooks, denoiser, address } = setup;
        let address = address.unwrap_or_else(|| SocketAddr::from(([127, 0, 0, 1], 0)));
        let (stop, stopped) = oneshot::channel();
        let (tell, told) = std::sync::mpsc::channel();
        let thread = std::thread::spawn(move || {
            let runtime = tokio::runtime::Runtime::new().expect("a runtime");
            runtime.block_on(async move {
                let listener = tokio::net::TcpListener::bind(address).await.expect("a free port");
                let service = Service::start_in(folder.as_deref(), limits, factory).await.expect("an engine");
                if let Some(webhooks) = webhooks {
                    service.tell_webhooks(webhooks);
                }
                if let Some(denoiser) = denoiser {
                    service.denoise_with(denoiser);
                }
                tell.send(listener.local_addr().expect("an address")).expect("the test waits");
                let shutdown = async {
                    let _ = stopped.await;
                };
                http::serve(listener, service, &access, shutdown, patience).await.expect("serving");
            });
        });
        let address = told.recv().expect("the server starts");
        Self { address, stop: Mutex::new(Some(stop)), thread: Some(thread) }
    }

    /// Asks the server to stop, as SIGTERM does.
    pub fn stop(&self) {
        if let Some(stop) = self.stop.lock().expect("unpoisoned").take() {
            let _ = stop.send(());
        }
    }

    /// Waits for the end of the server.
    pub fn join(&mut self) {
        if let Some(thread) = self.thread.take() {
            thread.join().expect("the server ends well");
        }
    }

    pub fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    pub fn get(&self, path: &str) -> Reply {
        self.send("GET", path, &[], &[])
    }

    pub fn delete(&self, path: &str) -> Reply {
        self.send("DELETE", path, &[], &[])
    }

    pub fn post(&self, path: &str, kind: &str, body: &[u8]) -> Reply {
        self.send("POST", path, &[("content-type", kind)], body)
    }

    pub fn post_json(&self, path: &str, body: &Value) -> Reply {
        self.post(path, "application/json", body.to_string().as_bytes())
    }

    /// Sends a form.
    pub fn post_form(&self, path: &str, fields: &[Field]) -> Reply {
        self.post(path, "multipart/form-data; boundary=limit", &form(fields))
    }

    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Reply {
        let mut request = ureq::http::Request::builder().method(method).uri(self.url(path));
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(body).expect("a request");
        Reply::read(agent().run(request).expect("a reply"))
    }

    /// Uploads the triangle and answers the scene's id.
    pub fn upload(&self) -> String {
        let reply = self.post("/v1/scenes", "model/gltf-binary", &triangle());
        assert!([200, 201].contains(&reply.status), "{reply:?}");
        reply.json()["id"].as_str().expect("an id").to_owned()
    }

    /// Begins a job and answers its id.
    pub fn begin(&self, scene: &str, params: &Value) -> String {
        let reply = self.post_json("/v1/jobs", &json!({ "scene": scene, "params": params }));
        assert_eq!(reply.status, 202, "{reply:?}");
        reply.json()["id"].as_str().expect("an id").to_owned()
    }

    pub fn job(&self, id: &str) -> Value {
        self.get(&format!("/v1/jobs/{id}")).json()
    }

    /// Waits until the job's state is one of these.
    pub fn wait_for(&self, id: &str, states: &[&str]) -> Value {
        let begun = Instant::now();
        loop {
            let job = self.job(id);
            if states.iter().any(|state| job["state"] == *state) {
                return job;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "still {}", job["state"]);
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop();
        if !std::thread::panicking() {
            self.join();
        }
    }
}

/// A client that does not take a status for an error, nor follows anything.
pub fn agent() -> Agent {
    Agent::config_builder().http_status_as_error(false).timeout_global(Some(Duration::from_secs(90))).build().into()
}

/// A reply, read to its end.
pub struct Reply {
    pub status: u16,
    pub headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}

impl Reply {
    fn read(response: Response<ureq::Body>) -> Self {
        let (parts, mut body) = response.into_parts();
        let headers = parts
            .headers
            .iter()
            .map(|(name, value)| (name.to_string(), String::from_utf8_lossy(value.as_bytes()).into_owned()));
        let headers = headers.collect();
        Self { status: parts.status.as_u16(), headers, body: body.read_to_vec().expect("a body") }
    }

    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("not JSON: {self:?}"))
    }

    /// Asserts that this is problem+json of a code, whole and consistent, and hands it out.
    pub fn problem(&self, status: u16, code: &str) -> Value {
        assert_eq!(self.status, status, "{self:?}");
        assert_eq!(self.header("content-type"), Some("application/problem+json"), "{self:?}");
        let problem = self.json();
        assert_eq!(problem["code"], code, "{problem}");
        assert_eq!(problem["status"], status, "{problem}");
        assert_eq!(problem["type"], format!("/docs/errors#{code}"), "{problem}");
        assert_eq!(problem["request_id"].as_str(), self.header("x-request-id"), "{problem}");
        assert!(problem["detail"].as_str().is_some_and(|detail| detail.len() > 10), "{problem}");
        problem
    }
}

impl std::fmt::Debug for Reply {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let text: String = String::from_utf8_lossy(&self.body).chars().take(2000).collect();
        write!(f, "{} {:?}\n{text}", self.status, self.headers)
    }
}

/// A field of a form: name, file name, content.
pub type Field<'a> = (&'a str, Option<&'a str>, &'a [u8]);

/// A form with the boundary `limit`.
pub fn form(fields: &[Field]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, file, content) in fields {
        let file = file.map_or_else(String::new, |file| format!("; filename=\"{file}\""));
        body.extend(format!("--limit\r\ncontent-disposition: form-data; name=\"{name}\"{file}\r\n\r\n").bytes());
        body.extend_from_slice(content);
        body.extend(b"\r\n");
    }
    body.extend(b"--limit--\r\n");
    body
}

/// Parameters of a picture that is done at once.
pub fn tiny() -> Value {
    json!({ "width": 16, "height": 8, "max_samples": 4 })
}

/// Parameters of a picture that takes minutes.
pub fn endless() -> Value {
    json!({ "width": 64, "height": 64, "max_samples": 4_000_000 })
}

/// A GLB with one triangle in the plane z = 0.
pub fn triangle() -> Vec<u8> {
    glb(&document("{\"byteLength\": 36}"), &vertices())
}

/// The same as `.gltf` text that names its buffer.
pub fn triangle_text(uri: &str) -> String {
    document(&format!("{{\"byteLength\": 36, \"uri\": \"{uri}\"}}"))
}

/// A `.gltf` of a camera and a light alone.
pub fn with_camera() -> String {
    json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } } }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.7, "znear": 0.1 } }],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point" }] } },
    })
    .to_string()
}

/// The buffer of [`triangle_text`].
pub fn vertices() -> Vec<u8> {
    let corners: [f32; 9] = [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0];
    corners.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn document(buffer: &str) -> String {
    format!(
        "{{\"asset\": {{\"version\": \"2.0\"}}, \"scene\": 0, \"scenes\": [{{\"nodes\": [0]}}], \
         \"nodes\": [{{\"mesh\": 0}}], \"meshes\": [{{\"primitives\": [{{\"attributes\": {{\"POSITION\": 0}}}}]}}], \
         \"accessors\": [{{\"bufferView\": 0, \"componentType\": 5126, \"count\": 3, \"type\": \"VEC3\", \
         \"min\": [-1, -1, 0], \"max\": [1, 1, 0]}}], \
         \"bufferViews\": [{{\"buffer\": 0, \"byteLength\": 36}}], \"buffers\": [{buffer}]}}"
    )
}

/// A binary glTF of a JSON text and a buffer.
pub fn glb(json: &str, buffer: &[u8]) -> Vec<u8> {
    let mut text = json.as_bytes().to_vec();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = |bytes: usize| u32::try_from(bytes).expect("a small file").to_le_bytes();
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend(length(12 + 8 + text.len() + 8 + buffer.len()));
    file.extend(length(text.len()));
    file.extend(b"JSON");
    file.extend(text);
    file.extend(length(buffer.len()));
    file.extend(b"BIN\0");
    file.extend_from_slice(buffer);
    file
}

/// A Radiance picture of one colour, flat scanlines, 16 x 8.
pub fn radiance() -> Vec<u8> {
    let mut file = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n".to_vec();
    file.extend([128_u8, 128, 128, 129].repeat(16 * 8));
    file
}
