//! As much of an HTTP client as it takes: one request a connection, in HTTP/1.0, whose replies end with the connection.

use anyhow::{Context, Result, bail, ensure};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Longest silence of the server.
const PATIENCE: Duration = Duration::from_secs(180);

/// A client of one server.
#[derive(Debug, Clone, Copy)]
pub struct Client(pub SocketAddr);

/// The head of a reply; the rest can be read.
pub struct Reply {
    /// Status code.
    pub status: u16,
    headers: Vec<(String, String)>,
    body: BufReader<TcpStream>,
}

impl Client {
    /// Sends a request and reads the reply's head.
    pub fn send(self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Result<Reply> {
        let mut stream = TcpStream::connect(self.0)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        let headers: String = headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
        let (host, length) = (self.0, body.len());
        write!(stream, "{method} {path} HTTP/1.0\r\nhost: {host}\r\ncontent-length: {length}\r\n{headers}\r\n")?;
        stream.write_all(body)?;
        Reply::read(BufReader::new(stream))
    }

    /// `GET`.
    pub fn get(self, path: &str) -> Result<Reply> {
        self.send("GET", path, &[], &[])
    }

    /// `POST` of JSON; the answer's body must be JSON too.
    pub fn post(self, path: &str, body: &Value) -> Result<Value> {
        let reply = self.send("POST", path, &[("content-type", "application/json")], body.to_string().as_bytes())?;
        reply.expect(200..300)?.json()
    }

    /// Uploads a scene; its id.
    pub fn upload(self, glb: &[u8]) -> Result<String> {
        let reply = self.send("POST", "/v1/scenes", &[("content-type", "model/gltf-binary")], glb)?;
        text(&reply.expect(200..300)?.json()?, "id")
    }

    /// Begins a job; its id.
    pub fn begin(self, scene: &str, params: &Value) -> Result<String> {
        text(&self.post("/v1/jobs", &json!({"scene": scene, "params": params}))?, "id")
    }

    /// Follows the events of a job until its last; tells of each by name and data.
    pub fn follow(self, job: &str, mut tell: impl FnMut(&str, &Value)) -> Result<()> {
        let reply = self.get(&format!("/v1/jobs/{job}/events"))?.expect(200..201)?;
        let mut name = String::new();
        for line in reply.body.lines() {
            let line = line?;
            if let Some(event) = line.strip_prefix("event: ") {
                event.clone_into(&mut name);
            } else if let Some(data) = line.strip_prefix("data: ") {
                tell(&name, &serde_json::from_str(data)?);
                match name.as_str() {
                    "completed" => return Ok(()),
                    "failed" | "cancelled" => bail!("the job has {name}: {data}"),
                    _ => {}
                }
            }
        }
        bail!("the events of {job} ended before the job")
    }
}

impl Reply {
    fn read(mut body: BufReader<TcpStream>) -> Result<Self> {
        let mut line = String::new();
        body.read_line(&mut line)?;
        let status = line.split_whitespace().nth(1).and_then(|code| code.parse().ok());
        let status = status.with_context(|| format!("not a status line: {line:?}"))?;
        let mut headers = Vec::new();
        loop {
            line.clear();
            body.read_line(&mut line)?;
            let Some((name, value)) = line.trim_end().split_once(':') else { break };
            headers.push((name.to_ascii_lowercase(), value.trim().to_owned()));
        }
        Ok(Self { status, headers, body })
    }

    /// The value of a header, by its name in lower case.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// The rest of the reply.
    pub fn bytes(mut self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.body.read_to_end(&mut bytes)?;
        let length = self.header("content-length").and_then(|length| length.parse().ok());
        ensure!(length.is_none_or(|length: usize| length == bytes.len()), "a reply was cut off");
        Ok(bytes)
    }

    /// The rest of the reply, which must be JSON.
    pub fn json(self) -> Result<Value> {
        Ok(serde_json::from_slice(&self.bytes()?)?)
    }

    /// The reply, if its status is one of these.
    pub fn expect(self, statuses: std::ops::Range<u16>) -> Result<Self> {
        if statuses.contains(&self.status) {
            return Ok(self);
        }
        let status = self.status;
        bail!("status {status}: {}", String::from_utf8_lossy(&self.bytes()?))
    }
}

fn text(value: &Value, field: &str) -> Result<String> {
    Ok(value[field].as_str().with_context(|| format!("no {field} in {value}"))?.to_owned())
}
