//! Who may do what: keys, their rights and their rates. Without a file of keys everybody may do everything.

use super::keys::{Key, KeyError, KeyFile, Scope, hash};
use super::{Caller, Client, revoked};
use crate::jobs::{Code, Problem};
use axum::Extension;
use axum::extract::Request;
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::{AppendHeaders, IntoResponse, Response};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Time after which a change of the file is seen, at the latest.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// What a client without a key is asked for: programs send the first, browsers ask their users for the second (any name, the key as
/// the password). A header each: Chromium looks at the first challenge of one alone.
const CHALLENGES: [&str; 2] = ["Bearer realm=\"candela\"", "Basic realm=\"candela\", charset=\"UTF-8\""];

/// What a server asks of its clients.
#[derive(Debug, Clone, Default)]
pub struct Access {
    /// Names by which the server may be called.
    pub hosts: Vec<String>,
    ring: Option<Arc<Mutex<Ring>>>,
}

/// The keys of a file, as it was when it was looked at last.
#[derive(Debug)]
struct Ring {
    path: PathBuf,
    /// By hash.
    keys: HashMap<String, Held>,
    seen: Option<(SystemTime, u64)>,
    looked: Instant,
}

/// A key that may do what it asks for.
struct Admitted {
    caller: Caller,
    /// Of the key.
    hash: String,
}

/// Why a request is refused, and to whom, if that is known.
struct Refusal {
    problem: Problem,
    client: Option<Client>,
}

impl From<Problem> for Box<Refusal> {
    fn from(problem: Problem) -> Self {
        Self::new(Refusal { problem, client: None })
    }
}

/// A key and how much it may ask for at present.
#[derive(Debug, Clone)]
struct Held {
    key: Key,
    /// Requests that it has in hand.
    tokens: f64,
    since: Instant,
}

impl Access {
    /// With a file of keys, or without.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn new(keys: Option<&Path>, hosts: Vec<String>) -> Result<Self, KeyError> {
        let ring = match keys {
            Some(path) => Some(Arc::new(Mutex::new(Ring::read(path)?))),
            None => None,
        };
        Ok(Self { hosts, ring })
    }

    /// Whether keys are asked for.
    pub fn has_keys(&self) -> bool {
        self.ring.is_some()
    }

    /// Who asks, if that key may do what `scope` says now; none: no key is asked for.
    fn admit(&self, headers: &HeaderMap, scope: Scope) -> Result<Option<Admitted>, Box<Refusal>> {
        let Some(ring) = &self.ring else { return Ok(None) };
        let given = given(headers).ok_or_else(|| unauthorized("send a key: `Authorization: Bearer candela_...`"))?;
        let hash = hash(&given);
        let mut ring = lock(ring);
        ring.look_again();
        let held = ring.keys.get_mut(&hash).ok_or_else(|| unauthorized("this key is not known, or was revoked"))?;
        let client = format!("key:{}", held.key.name);
        match held.take().and_then(|()| held.key.allows(scope)) {
            Ok(()) => {
                let caller = Caller { client, has_key: true, renders_per_day: held.key.renders_per_day };
                Ok(Some(Admitted { caller, hash }))
            }
            Err(problem) => Err(Box::new(Refusal { problem, client: Some(Client(client)) })),
        }
    }

    /// Waits until a key may not do any more what `scope` says.
    async fn revoked(self, hash: String, scope: Scope) {
        let Some(ring) = &self.ring else { return std::future::pending().await };
        loop {
            tokio::time::sleep(LOOK_AGAIN).await;
            let mut ring = lock(ring);
            ring.look_again();
            if ring.keys.get(&hash).is_none_or(|held| held.key.allows(scope).is_err()) {
                return;
            }
        }
    }
}

/// Middleware of the routes that need a scope. What is under way for a key ends when it is revoked.
pub async fn check(access: Access, scope: Scope, mut request: Request, next: Next) -> Response {
    let (response, client) = match access.admit(request.headers(), scope) {
        Ok(None) => return next.run(request).await,
        Ok(Some(Admitted { caller, hash })) => {
            let client = Some(Client(caller.client.clone()));
            request.extensions_mut().insert(caller);
            let answered = revoked::unless(access.revoked(hash, scope), next.run(request)).await;
            let late = || refuse(unauthorized("this key was revoked while the request was under way"));
            (answered.unwrap_or_else(late), client)
        }
        Err(refusal) => (refuse(refusal.problem), refusal.client),
    };
    match client {
        Some(client) => (Extension(client), response).into_response(),
        None => response,
    }
}

fn refuse(problem: Problem) -> Response {
    if problem.status != 401 {
        return problem.into_response();
    }
    let challenges = CHALLENGES.map(|challenge| (header::WWW_AUTHENTICATE, challenge));
    (AppendHeaders(challenges), problem).into_response()
}

fn unauthorized(detail: &str) -> Problem {
    Problem::new(Code::Unauthorized, detail)
}

fn lock(ring: &Mutex<Ring>) -> MutexGuard<'_, Ring> {
    ring.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The key of a request: a bearer token, or the password of Basic.
fn given(headers: &HeaderMap) -> Option<String> {
    let (scheme, value) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    if scheme.eq_ignore_ascii_case("bearer") {
        return Some(value.trim().to_owned());
    }
    let decoded = scheme.eq_ignore_ascii_case("basic").then(|| STANDARD.decode(value.trim()).ok()).flatten()?;
    Some(String::from_utf8(decoded).ok()?.split_once(':')?.1.to_owned())
}

impl Ring {
    fn read(path: &Path) -> Result<Self, KeyError> {
        let mut ring = Self { path: path.to_owned(), keys: HashMap::new(), seen: stamp(path), looked: Instant::now() };
        ring.fill(KeyFile::read(path)?);
        Ok(ring)
    }

    fn fill(&mut self, file: KeyFile) {
        let mut before = std::mem::take(&mut self.keys);
        self.keys = file
            .keys
            .into_iter()
            .map(|key| {
                let hash = key.sha256.to_ascii_lowercase();
                let held = match before.remove(&hash) {
                    Some(held) => Held { key, ..held },
                    None => Held::new(key),
                };
                (hash, held)
            })
            .collect();
    }

    /// Reads the file if it has changed. A file that cannot be read leaves the keys as they were.
    fn look_again(&mut self) {
        if self.looked.elapsed() < LOOK_AGAIN {
            return;
        }
        self.looked = Instant::now();
        let stamp = stamp(&self.path);
        if stamp == self.seen {
            return;
        }
        match KeyFile::read(&self.path) {
            Ok(file) => {
                self.seen = stamp;
                tracing::info!(keys = file.keys.len(), "the file of keys has changed");
                self.fill(file);
            }
            Err(error) => tracing::error!(%error, "the file of keys cannot be read; the keys stay as they were"),
        }
    }
}

/// Time of the last change and length, which tell whether a file is another one.
fn stamp(path: &Path) -> Option<(SystemTime, u64)> {
    let meta = std::fs::metadata(path).ok()?;
    Some((meta.modified().ok()?, meta.len()))
}

impl Held {
    fn new(key: Key) -> Self {
        Self { tokens: f64::from(key.requests_per_minute.unwrap_or_default()), key, since: Instant::now() }
    }

    /// A token bucket: filled at the key's rate, up to the requests of a minute.
    fn take(&mut self) -> Result<(), Problem> {
        let Some(rate) = self.key.requests_per_minute else { return Ok(()) };
        let (rate, now) = (f64::from(rate.max(1)), Instant::now());
        let gained = (now - self.since).as_secs_f64() * rate / 60.0;
        self.tokens = (self.tokens + gained).min(rate);
        self.since = now;
        if self.tokens >= 1.0 {
            self.tokens -= 1.0;
            return Ok(());
        }
        let wait = ((1.0 - self.tokens) * 60.0 / rate).ceil() as u32;
        let detail = format!("the key `{}` may send {rate} requests a minute", self.key.name);
        Err(Problem::new(Code::RateLimited, detail).retry_after(wait.max(1)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(value: &str) -> HeaderMap {
        HeaderMap::from_iter([(header::AUTHORIZATION, value.parse().unwrap())])
    }

    #[test]
    fn keys_are_read_from_either_scheme() {
        assert_eq!(given(&headers("bearer abc")).as_deref(), Some("abc"));
        let basic = format!("Basic {}", STANDARD.encode("anyone:a:b"));
        assert_eq!(given(&headers(&basic)).as_deref(), Some("a:b"));
        for odd in ["abc", "Basic !", "Digest abc", "Basic YWJj"] {
            assert_eq!(given(&headers(odd)), None, "{odd}");
        }
    }

    #[test]
    fn a_bucket_empties_and_fills() {
        let mut file = KeyFile::default();
        file.add("a", Scope::Read, Some(120), None).unwrap();
        let mut held = Held::new(file.keys.remove(0));
        for _ in 0..120 {
            held.take().unwrap();
        }
        assert_eq!(held.take().unwrap_err().retry_after, Some(1));
        held.since = held.since.checked_sub(Duration::from_secs(1)).unwrap();
        held.take().unwrap();
        held.take().unwrap();
        assert!(held.take().is_err());
    }
}
