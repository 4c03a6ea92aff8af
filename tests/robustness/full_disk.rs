//! A disk that fills up under a server: whoever asks is told so soon, and what was accepted is done once there is room.
//!
//! Only where a small file system can be mounted (Linux, as root).

use crate::server::Server;
use candela::demo;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A file system of its own, in memory. Dropping it unmounts it.
struct Disk(TempDir);

impl Disk {
    fn mount() -> Option<Self> {
        let folder = tempfile::tempdir().expect("a folder");
        let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=24m", "tmpfs"]).arg(folder.path()).output();
        if mount.is_ok_and(|done| done.status.success()) {
            return Some(Self(folder));
        }
        eprintln!("SKIPPED: no file system can be mounted here");
        None
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    /// Takes all the room that is left.
    fn fill(&self) {
        let mut filler = fs::File::create(self.path().join("filler")).expect("a file");
        while std::io::Write::write_all(&mut filler, &[0; 4096]).is_ok() {}
    }

    fn free(&self) {
        fs::remove_file(self.path().join("filler")).expect("it is there");
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(self.path()).status();
    }
}

/// Status and body of a reply, which must not take long.
fn soon(server: &Server, method: &str, path: &str, body: &Value) -> (u16, Value) {
    let begun = Instant::now();
    let reply = server.send(method, path, body, true, None).expect("a reply");
    assert!(begun.elapsed() < Duration::from_secs(5), "{method} {path} took {:?}", begun.elapsed());
    reply
}

fn picture(scene: &str, samples: u32, seed: u32) -> Value {
    json!({ "scene": scene, "params": {
        "engine": "cpu", "width": 96, "height": 96, "max_samples": samples, "seed": seed,
    } })
}

#[test]
fn a_full_disk_refuses_soon_and_loses_nothing() {
    let Some(disk) = Disk::mount() else { return };
    let data = disk.path().join("data");
    let server = Server::start(Some(&data));
    let scene = server.upload(&demo::by_name("grid").expect("the demo")).expect("an upload");
    assert_eq!(soon(&server, "PUT", "/v1/jobs/early", &picture(&scene, 64, 1)).0, 202);
    disk.fill();
    // Its film, its events and its result find no room.
    let begun = Instant::now();
    while server.get("/readyz").0 != 503 {
        assert!(begun.elapsed() < Duration::from_secs(60), "nothing was written");
        std::thread::sleep(Duration::from_millis(50));
    }
    for (method, path, body) in [
        ("PUT", "/v1/jobs/late", picture(&scene, 4, 2)),
        ("GET", "/v1/jobs", Value::Null),
        ("GET", "/v1/scenes", Value::Null),
    ] {
        let (status, said) = soon(&server, method, path, &body);
        assert_eq!((status, &said["code"]), (503, &json!("storage_unavailable")), "{method} {path}: {said}");
    }
    assert_eq!(server.get("/healthz").0, 200);
    std::thread::sleep(Duration::from_secs(3));
    disk.free();
    // What was refused left nothing behind: the same again is taken.
    let begun = Instant::now();
    while soon(&server, "PUT", "/v1/jobs/late", &picture(&scene, 4, 2)).0 != 202 {
        assert!(begun.elapsed() < Duration::from_secs(20), "still refused");
        std::thread::sleep(Duration::from_millis(200));
    }
    for id in ["early", "late"] {
        assert!(!server.result(id).is_empty());
    }
    // It ends in time, too.
    assert_eq!(soon(&server, "PUT", "/v1/jobs/left", &picture(&scene, 100_000, 3)).0, 202);
    disk.fill();
    let begun = Instant::now();
    server.stop();
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
    disk.free();
    let server = Server::start(Some(&data));
    assert_ne!(server.get("/v1/jobs/left").1["state"], "failed");
}
