//! Keys, their rights, rates and quotas; hosts that the server answers for.

use crate::engine;
use crate::support::{Reply, Server, Setup, tiny, triangle};
use candela::http::Access;
use candela::http::keys::{KeyFile, Scope};
use candela::http::router::routes;
use serde_json::json;
use std::path::Path;
use std::time::Duration;

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
