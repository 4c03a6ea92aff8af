//! `kill -9` at any moment, over a mixed load: whatever was accepted comes to a truthful end, with the bytes of a server that
//! was left alone, and no listener misses or unlearns anything.
//!
//! `CANDELA_KILLS=200 cargo test --test robustness kills -- --nocapture` is the long run; `CANDELA_KILL_SEED` another one.

use crate::server::{Server, follow};
use candela::demo;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Kills of a run of `script/test`.
const KILLS: u32 = 5;

/// Time in which everything must have come to its end after the last kill.
const PATIENCE: Duration = Duration::from_secs(1800);

/// Parameters that the load is made of: from done at once to a second or two.
fn kinds() -> Vec<Value> {
    let kind = |width: u32, samples: u32, format: &str| json!({ "engine": "cpu", "width": width, "height": width / 2, "max_samples": samples, "output": { "format": format } });
    vec![
        kind(16, 4, "png"),
        kind(32, 64, "exr"),
        kind(64, 16, "jpeg"),
        kind(64, 48, "png"),
        kind(96, 40, "webp"),
        json!({ "engine": "cpu", "width": 48, "height": 48, "max_samples": 100, "target_error": 0.1, "seed": 3 }),
    ]
}

/// A job that the server has accepted.
#[derive(Clone)]
struct Accepted {
    id: String,
    kind: usize,
    /// A cancel was asked for: cancelled is a truthful end, and so is any other that came before.
    cancelled: bool,
}

/// What a listener has heard: ids and names of events, in the order of arrival.
type Heard = Arc<Mutex<Vec<(u64, String)>>>;

/// A small generator (SplitMix64), so that a run can be repeated.
struct Dice(u64);

impl Dice {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % bound
    }
}

fn number(name: &str, usual: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

#[test]
fn whatever_was_accepted_comes_to_a_truthful_end() {
    let (kills, seed) = (number("CANDELA_KILLS", u64::from(KILLS)), number("CANDELA_KILL_SEED", 1));
    let folder = tempfile::tempdir().expect("a folder");
    let mut run = Run {
        dice: Dice(seed),
        scene: demo::by_name("grid").expect("the demo"),
        accepted: Vec::new(),
        heard: BTreeMap::new(),
        over: Arc::default(),
        address: Arc::default(),
    };
    let begun = Instant::now();
    for kill in 0..kills {
        let server = Server::start(Some(folder.path()));
        run.meet(&server);
        let until = Instant::now() + Duration::from_millis(run.dice.below(900));
        let load = run.load(&server, kill, until);
        server.kill();
        run.accepted.extend(load);
        audit(folder.path());
    }
    let server = Server::start(Some(folder.path()));
    run.meet(&server);
    let ends = run.wait_for_all(&server);
    let killing = begun.elapsed();
    run.compare_results(&server);
    run.compare_events(&server);
    server.stop();
    audit(folder.path());
    eprintln!(
        "{kills} kills with seed {seed} in {killing:.1?}: {} jobs accepted, all ended: {ends:?}; results as those of a server \
         left alone, {} streams without gaps, every audit clean",
        run.accepted.len(),
        run.heard.len(),
    );
}

/// Every rule of the ledger holds, and every blob that it names is there.
fn audit(folder: &Path) {
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    let faults = runtime.block_on(candela::jobs::audit_folder(folder)).expect("a ledger");
    assert!(faults.is_empty(), "{faults:#?}");
}

struct Run {
    dice: Dice,
    scene: Vec<u8>,
    accepted: Vec<Accepted>,
    heard: BTreeMap<String, Heard>,
    over: Arc<AtomicBool>,
    /// Where the present server listens.
    address: Arc<Mutex<String>>,
}

impl Run {
    /// Tells the listeners where the server is now.
    fn meet(&mut self, server: &Server) {
        *self.address.lock().expect("unpoisoned") = server.address.clone();
    }

    /// Sends jobs until the time is up. The server dies while the last request is on its way: what that was is not known.
    fn load(&mut self, server: &Server, kill: u64, until: Instant) -> Vec<Accepted> {
        let mut accepted = Vec::new();
        let Some(scene) = server.upload(&self.scene) else { return accepted };
        let kinds = kinds();
        for n in 0.. {
            let kind = self.dice.below(kinds.len() as u64) as usize;
            let body = json!({ "scene": scene, "params": kinds[kind], "priority": self.dice.below(50) as i64 - 25 });
            let anew = self.dice.below(4) > 0;
            let reply = match self.dice.below(5) {
                0 => {
                    accepted.extend(self.batch(server, &scene, kind, anew));
                    None
                }
                1 | 2 => server.send("PUT", &format!("/v1/jobs/kill-{kill}-{n}"), &body, anew, None),
                _ => server.send("POST", "/v1/jobs", &body, anew, Some(&format!("key-{kill}-{n}"))),
            };
            if let Some((202, job)) = &reply {
                let id = job["id"].as_str().expect("an id").to_owned();
                let cancelled = self.dice.below(8) == 0;
                if cancelled {
                    server.send("POST", &format!("/v1/jobs/{id}/cancel"), &Value::Null, false, None);
                }
                self.listen(&id);
                accepted.push(Accepted { id, kind, cancelled });
            }
            let pause = Duration::from_millis(self.dice.below(200));
            if Instant::now() + pause >= until {
                break;
            }
            std::thread::sleep(pause);
        }
        accepted
    }

    /// Sends three of a kind as a batch.
    fn batch(&mut self, server: &Server, scene: &str, kind: usize, anew: bool) -> Vec<Accepted> {
        let body = json!({ "scenes": [scene], "params": kinds()[kind], "variants": [null, null, null] });
        let Some((202, batch)) = server.send("POST", "/v1/batches", &body, anew, None) else { return Vec::new() };
        let items = batch["items"].as_array().expect("items");
        let ids: Vec<String> = items.iter().map(|item| item["job"].as_str().expect("an id").to_owned()).collect();
        assert_eq!(ids.len(), 3);
        ids.iter().for_each(|id| self.listen(id));
        ids.into_iter().map(|id| Accepted { id, kind, cancelled: false }).collect()
    }

    /// Follows a job over all restarts, resuming where it was.
    fn listen(&mut self, id: &str) {
        // Each is a thread and a connection: some will do.
        if self.heard.len() >= 60 {
            return;
        }
        let heard = Heard::default();
        self.heard.insert(id.to_owned(), Arc::clone(&heard));
        let (id, address, over) = (id.to_owned(), Arc::clone(&self.address), Arc::clone(&self.over));
        std::thread::spawn(move || {
            while !over.load(Ordering::Acquire) {
                let last = heard.lock().expect("unpoisoned").last().map_or(0, |(id, _)| *id);
                let address = address.lock().expect("unpoisoned").clone();
                follow(&address, &id, last, |id, kind| heard.lock().expect("unpoisoned").push((id, kind.to_owned())));
                if heard.lock().expect("unpoisoned").last().is_some_and(|(_, kind)| is_last(kind)) {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
        });
    }

    /// Waits for the end of every job that was accepted; counts the ends by state.
    fn wait_for_all(&self, server: &Server) -> BTreeMap<String, usize> {
        let begun = Instant::now();
        let mut ends = BTreeMap::new();
        for job in &self.accepted {
            let state = loop {
                let (status, found) = server.get(&format!("/v1/jobs/{}", job.id));
                assert_eq!(status, 200, "{} was accepted and is lost", job.id);
                let state = found["state"].as_str().expect("a state").to_owned();
                if !["queued", "running"].contains(&state.as_str()) {
                    break state;
                }
                assert!(begun.elapsed() < PATIENCE, "{} is still {state}", job.id);
                std::thread::sleep(Duration::from_millis(20));
            };
            assert!(state == "succeeded" || (state == "cancelled" && job.cancelled), "{} has {state}", job.id);
            *ends.entry(state).or_default() += 1;
        }
        ends
    }

    /// Against a server that nobody disturbs, kind by kind.
    fn compare_results(&self, server: &Server) {
        let other = Server::start(None);
        let scene = other.upload(&self.scene).expect("an upload");
        for (kind, params) in kinds().iter().enumerate() {
            let of_kind: Vec<_> = self.accepted.iter().filter(|job| job.kind == kind).collect();
            let body = json!({ "scene": scene, "params": params });
            let (_, job) = other.send("PUT", &format!("/v1/jobs/kind-{kind}"), &body, true, None).expect("a reply");
            let expected = other.result(job["id"].as_str().expect("an id"));
            for job in of_kind {
                let (status, found) = server.get(&format!("/v1/jobs/{}", job.id));
                assert_eq!(status, 200);
                if found["state"] == "succeeded" {
                    assert!(server.result(&job.id) == expected, "{} has other bytes than an undisturbed one", job.id);
                }
            }
        }
        other.stop();
    }

    /// All that was heard is in the log, and all states of the log were heard, once and in order.
    fn compare_events(&self, server: &Server) {
        let begun = Instant::now();
        for (id, heard) in &self.heard {
            while !heard.lock().expect("unpoisoned").last().is_some_and(|(_, kind)| is_last(kind)) {
                assert!(begun.elapsed() < Duration::from_secs(30), "{id}: its listener has not heard the end");
                std::thread::sleep(Duration::from_millis(20));
            }
            let heard = heard.lock().expect("unpoisoned").clone();
            assert!(heard.is_sorted_by(|a, b| a.0 < b.0), "{id}: {heard:?}");
            let mut log = Vec::new();
            follow(&server.address, id, 0, |id, kind| log.push((id, kind.to_owned())));
            let states = |events: &[(u64, String)]| -> Vec<(u64, String)> {
                events.iter().filter(|(_, kind)| kind != "progress" && kind != "preview").cloned().collect()
            };
            assert_eq!(states(&heard), states(&log), "{id}");
        }
        self.over.store(true, Ordering::Release);
    }
}

fn is_last(kind: &str) -> bool {
    matches!(kind, "completed" | "failed" | "cancelled")
}
