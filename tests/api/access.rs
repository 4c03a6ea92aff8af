//! Keys, their rights, rates and quotas; hosts that the server answers for.

use crate::engine;
use crate::support::{Reply, Server, Setup, agent, endless, tiny, triangle};
use candela::http::Access;
use candela::http::keys::{KeyFile, Scope};
use candela::http::router::routes;
use serde_json::json;
use std::io::Read;
use std::path::Path;
use std::time::{Duration, Instant};

struct Guarded {
    server: Server,
    file: KeyFile,
    folder: tempfile::TempDir,
}

impl Guarded {
    /// A server with a file of these keys: name, scope, requests a minute, renders a day.
    fn start(keys: &[(&str, Scope, Option<u32>, Option<u64>)]) -> (Self, Vec<String>) {
        let folder = tempfile::tempdir().unwrap();
        let mut file = KeyFile::default();
        let keys =
            keys.iter().map(|(name, scope, rate, quota)| file.add(name, *scope, *rate, *quota).unwrap()).collect();
        file.write(&folder.path().join("keys.json")).unwrap();
        let server = serve(folder.path());
        (Self { server, file, folder }, keys)
    }
}

fn serve(folder: &Path) -> Server {
    let access = Access::new(Some(&folder.join("keys.json")), Vec::new()).unwrap();
    let setup = Setup { access, folder: Some(folder.join("data")), ..Setup::default() };
    Server::set_up(setup, engine::faulty(engine::Fault::None, 0))
}

fn ask(server: &Server, key: &str, method: &str, path: &str) -> Reply {
    server.send(method, path, &[("authorization", &format!("Bearer {key}"))], &[])
}

fn render(server: &Server, key: &str) -> Reply {
    let headers = [("authorization", format!("Bearer {key}")), ("content-type", "model/gltf-binary".to_owned())];
    let headers = headers.each_ref().map(|(name, value)| (*name, value.as_str()));
    server.send("POST", "/v1/render?width=8&height=8&max_samples=2", &headers, &triangle())
}

#[test]
fn every_route_asks_for_the_scope_that_it_names() {
    let (guarded, keys) = Guarded::start(&[
        ("r", Scope::Read, None, None),
        ("w", Scope::Render, None, None),
        ("a", Scope::Admin, None, None),
    ]);
    let server = &guarded.server;
    for (method, path, scope) in routes() {
        let path = path.replace("{id}", "none");
        let nobody = server.send(method, &path, &[], &[]);
        assert_eq!(nobody.status == 401, scope.is_some(), "{method} {path}: {nobody:?}");
        if scope.is_some() {
            nobody.problem(401, "unauthorized");
            assert!(nobody.header("www-authenticate").is_some_and(|challenge| challenge.starts_with("Bearer")));
            ask(server, "candela_wrong", method, &path).problem(401, "unauthorized");
        }
        for (key, held) in keys.iter().zip([Scope::Read, Scope::Render, Scope::Admin]) {
            let reply = ask(server, key, method, &path);
            let may = scope.is_none_or(|scope| held >= scope);
            assert_eq!(reply.status != 403 && reply.status != 401, may, "{method} {path} with {held:?}: {reply:?}");
            if !may {
                reply.problem(403, "forbidden");
            }
        }
    }
    // A browser sends what its user has typed: the key as a password.
    let basic = format!("Basic {}", base64_of(&format!("me:{}", keys[0])));
    assert_eq!(server.send("GET", "/v1/jobs", &[("authorization", &basic)], &[]).status, 200);
}

fn base64_of(text: &str) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |bytes: &[u8]| {
        let value = bytes.iter().fold(0_u32, |value, byte| value << 8 | u32::from(*byte)) << (8 * (3 - bytes.len()));
        (0..4)
            .map(move |n| if n <= bytes.len() { DIGITS[(value >> (18 - 6 * n) & 63) as usize] as char } else { '=' })
            .collect::<String>()
    };
    text.as_bytes().chunks(3).map(group).collect()
}

#[test]
fn a_revoked_key_is_refused_without_a_restart() {
    let (mut guarded, keys) = Guarded::start(&[("old", Scope::Read, None, None)]);
    assert_eq!(ask(&guarded.server, &keys[0], "GET", "/v1/jobs").status, 200);
    let path = guarded.folder.path().join("keys.json");
    guarded.file.revoke("old").unwrap();
    let new = guarded.file.add("new", Scope::Read, None, None).unwrap();
    guarded.file.write(&path).unwrap();
    std::thread::sleep(Duration::from_millis(1200));
    ask(&guarded.server, &keys[0], "GET", "/v1/jobs").problem(401, "unauthorized");
    assert_eq!(ask(&guarded.server, &new, "GET", "/v1/jobs").status, 200);
    // A file that cannot be read takes nobody's key away, and gives nobody a right.
    std::fs::write(&path, "{").unwrap();
    std::thread::sleep(Duration::from_millis(1200));
    assert_eq!(ask(&guarded.server, &new, "GET", "/v1/jobs").status, 200);
    ask(&guarded.server, &keys[0], "GET", "/v1/jobs").problem(401, "unauthorized");
}

#[test]
fn a_key_has_a_rate() {
    let (guarded, keys) = Guarded::start(&[("slow", Scope::Read, Some(3), None), ("other", Scope::Read, None, None)]);
    for _ in 0..3 {
        assert_eq!(ask(&guarded.server, &keys[0], "GET", "/v1/jobs").status, 200);
    }
    let refused = ask(&guarded.server, &keys[0], "GET", "/v1/jobs");
    refused.problem(429, "rate_limited");
    let wait: u32 = refused.header("retry-after").expect("a time").parse().expect("seconds");
    assert!((1..=20).contains(&wait), "{wait}");
    assert_eq!(ask(&guarded.server, &keys[1], "GET", "/v1/jobs").status, 200, "others are not held up");
}

#[test]
fn a_key_has_a_quota_that_outlives_the_server() {
    let (guarded, keys) = Guarded::start(&[("few", Scope::Render, None, Some(3))]);
    let key = &keys[0];
    assert_eq!(render(&guarded.server, key).status, 200);
    let scene = guarded.server.send(
        "POST",
        "/v1/scenes",
        &[("authorization", &format!("Bearer {key}")), ("content-type", "model/gltf-binary")],
        &triangle(),
    );
    let scene = scene.json()["id"].as_str().expect("an id").to_owned();
    let batch = |server: &Server, count: usize| {
        let line = |n| format!("{}\n", json!({ "scene": scene, "name": format!("n{n}"), "params": tiny() }));
        let body: String = (0..count).map(line).collect();
        let headers = [("authorization", format!("Bearer {key}")), ("content-type", "application/x-ndjson".to_owned())];
        let headers = headers.each_ref().map(|(name, value)| (*name, value.as_str()));
        server.send("POST", "/v1/batches", &headers, body.as_bytes())
    };
    batch(&guarded.server, 3).problem(429, "quota_exceeded");
    assert_eq!(batch(&guarded.server, 2).status, 202);
    let Guarded { server, folder, .. } = guarded;
    drop(server);
    let server = serve(folder.path());
    let refused = render(&server, key);
    refused.problem(429, "quota_exceeded");
    let wait: u64 = refused.header("retry-after").expect("a time").parse().expect("seconds");
    assert!((1..=86_401).contains(&wait), "{wait}");
    assert_eq!(ask(&server, key, "GET", "/v1/jobs").status, 200, "looking is free");
}

/// Sends with a key and, if it is not empty, an `Idempotency-Key`.
fn send(server: &Server, key: &str, again: &str, (method, path): (&str, &str), kind: &str, body: &[u8]) -> Reply {
    let bearer = format!("Bearer {key}");
    let mut headers = vec![("authorization", bearer.as_str()), ("content-type", kind)];
    headers.extend((!again.is_empty()).then_some(("idempotency-key", again)));
    server.send(method, path, &headers, body)
}

fn upload(server: &Server, key: &str) -> String {
    let reply = send(server, key, "", ("POST", "/v1/scenes"), "model/gltf-binary", &triangle());
    reply.json()["id"].as_str().expect("an id").to_owned()
}

#[test]
fn asking_again_for_what_was_accepted_costs_no_quota() {
    let (guarded, keys) = Guarded::start(&[("few", Scope::Render, None, Some(3))]);
    let (server, key) = (&guarded.server, keys[0].as_str());
    let scene = upload(server, key);
    let job = json!({ "scene": scene, "params": tiny() }).to_string();
    let line = format!("{}\n", json!({ "scene": scene, "params": tiny() }));
    let ask = || {
        [
            send(server, key, "k", ("POST", "/v1/jobs"), "application/json", job.as_bytes()),
            send(server, key, "", ("PUT", "/v1/jobs/mine"), "application/json", job.as_bytes()),
            send(server, key, "k", ("POST", "/v1/batches"), "application/x-ndjson", line.as_bytes()),
        ]
    };
    let first = ask();
    assert_eq!(first.each_ref().map(|reply| reply.status), [202; 3], "{first:?}");
    // The quota is used up, and by nothing else than these.
    render(server, key).problem(429, "quota_exceeded");
    for (first, again) in first.iter().zip(ask()) {
        assert_eq!((again.status, &again.json()["id"]), (202, &first.json()["id"]), "{again:?}");
    }
}

#[test]
fn an_idempotency_key_is_that_of_one_api_key() {
    let (guarded, keys) = Guarded::start(&[("a", Scope::Render, None, None), ("b", Scope::Render, None, None)]);
    let (server, scene) = (&guarded.server, upload(&guarded.server, &keys[0]));
    let job = |seed| json!({ "scene": scene, "params": { "width": 8, "height": 8, "max_samples": 2, "seed": seed } });
    let post = |server: &Server, key: &str, seed: u32| {
        send(server, key, "x", ("POST", "/v1/jobs"), "application/json", job(seed).to_string().as_bytes())
    };
    let [first, same, other] = [(0, 1), (1, 1), (0, 2)].map(|(key, seed)| post(server, &keys[key], seed));
    assert_eq!((first.status, same.status), (202, 202), "{same:?}");
    assert_ne!(first.json()["id"], same.json()["id"], "a job of its own");
    other.problem(422, "idempotency_mismatch");
    let Guarded { server, folder, .. } = guarded;
    drop(server);
    let server = serve(folder.path());
    for (key, before) in keys.iter().zip([first, same]) {
        assert_eq!(post(&server, key, 1).json()["id"], before.json()["id"], "after a restart, too");
    }
}

#[test]
fn what_is_under_way_for_a_revoked_key_ends() {
    let (mut guarded, keys) = Guarded::start(&[("old", Scope::Render, None, None)]);
    let (scene, key) = (upload(&guarded.server, &keys[0]), keys[0].as_str());
    let body = json!({ "scene": scene, "params": endless() }).to_string();
    let job = send(&guarded.server, key, "", ("POST", "/v1/jobs"), "application/json", body.as_bytes()).json();
    let events = guarded.server.url(job["links"]["events"].as_str().expect("a link"));
    let stream = agent().get(events).header("authorization", format!("Bearer {key}")).call().expect("a stream");
    let begun = Instant::now();
    std::thread::scope(|scope| {
        let server = &guarded.server;
        // One hears, one waits for its picture.
        let heard = scope.spawn(|| {
            let mut text = Vec::new();
            let whole = stream.into_body().into_reader().read_to_end(&mut text);
            (whole.is_ok(), text.len())
        });
        let waited = scope.spawn(|| {
            let headers =
                [("authorization", format!("Bearer {key}")), ("content-type", "model/gltf-binary".to_owned())];
            let headers = headers.each_ref().map(|(name, value)| (*name, value.as_str()));
            server.send("POST", "/v1/render?width=64&height=64&max_samples=4000000", &headers, &triangle())
        });
        std::thread::sleep(Duration::from_millis(300));
        guarded.file.revoke("old").unwrap();
        guarded.file.write(&guarded.folder.path().join("keys.json")).unwrap();
        let (whole, bytes) = heard.join().expect("a listener");
        assert!(!whole && bytes > 0, "nobody takes a part for the whole: {bytes} bytes");
        waited.join().expect("a client").problem(401, "unauthorized");
    });
    assert!(begun.elapsed() < Duration::from_secs(6), "{:?}", begun.elapsed());
}

#[test]
fn a_file_that_is_none_is_said_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("keys.json");
    assert!(Access::new(Some(&path), Vec::new()).is_err());
    std::fs::write(&path, "[]").unwrap();
    assert!(Access::new(Some(&path), Vec::new()).unwrap_err().to_string().contains("keys.json"));
}

#[test]
fn names_of_other_sites_are_not_answered() {
    let server = Server::start();
    for path in ["/", "/v1/jobs", "/healthz"] {
        server.send("GET", path, &[("host", "evil.example")], &[]).problem(421, "host_not_allowed");
        assert_eq!(server.send("GET", path, &[("host", "localhost:1")], &[]).status, 200);
    }
    let access = Access::new(None, vec!["render.example".to_owned()]).unwrap();
    let server = Server::set_up(Setup { access, ..Setup::default() }, engine::any());
    assert_eq!(server.send("GET", "/healthz", &[("host", "render.example")], &[]).status, 200);
    server.send("GET", "/healthz", &[("host", "evil.example")], &[]).problem(421, "host_not_allowed");
}
