//! The page, the contract and the health routes.

use crate::support::Server;

#[test]
fn every_reply_is_guarded() {
    let server = Server::start();
    for path in ["/", "/healthz", "/nothing", "/docs/errors"] {
        let reply = server.get(path);
        let policy = reply.header("content-security-policy").unwrap_or_default();
        assert!(policy.contains("default-src 'none'") && policy.contains("script-src 'self'"), "{path}: {policy}");
        assert!(!policy.contains("unsafe"), "{policy}");
        assert_eq!(reply.header("x-content-type-options"), Some("nosniff"));
        assert!(reply.header("x-request-id").is_some());
    }
}

#[test]
fn every_file_of_the_page_is_served_with_its_type() {
    let server = Server::start();
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("web");
    if !root.is_dir() {
        eprintln!("SKIPPED: there is no page in web/");
        return;
    }
    let index = server.get("/");
    assert_eq!((index.status, index.header("content-type")), (200, Some("text/html; charset=utf-8")));
    let script = server.get("/main.js");
    assert_eq!((script.status, script.header("content-type")), (200, Some("text/javascript; charset=utf-8")));
    assert_eq!(script.body, std::fs::read(root.join("main.js")).unwrap());
    let tag = script.header("etag").unwrap();
    assert_eq!(server.send("GET", "/main.js", &[("if-none-match", tag)], &[]).status, 304);
    server.delete("/main.js").problem(405, "method_not_allowed");
    server.get("/../Cargo.toml").problem(404, "not_found");
}

#[test]
fn health_and_limits() {
    let server = Server::start();
    assert_eq!(server.get("/healthz").status, 200);
    assert_eq!(server.get("/readyz").status, 200);
    let limits = server.get("/v1/limits").json();
    assert!(limits["upload_bytes"].as_u64() > Some(0));
    assert!(limits["scene"]["nodes"].as_u64() > Some(0));
    assert!(limits["params"]["pixels"].as_u64() > Some(0));
}

#[test]
fn the_contract_comes_as_json_and_yaml() {
    let server = Server::start();
    let json = server.get("/openapi.json");
    assert_eq!(
        (json.header("content-type"), json.json()["openapi"].as_str()),
        (Some("application/json"), Some("3.1.0"))
    );
    assert!(server.get("/openapi.yaml").body.starts_with(b"openapi: 3.1.0"));
}
