//! Damaged scenes: an error that says something or a sound scene, never a panic or a hang; here and by a server.

use super::server::Server;
use super::targets::sound_or_refused;
use crate::damage::{Random, Victim};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

/// Longest time that a scene may take.
const PATIENCE: Duration = Duration::from_secs(2);

/// Memory that a server may have, whatever it was sent.
const MEMORY: u64 = 2 << 30;

/// Runs one case; whether it was accepted.
fn run(bytes: &[u8], what: &str) -> bool {
    let start = Instant::now();
    let result = catch_unwind(AssertUnwindSafe(|| sound_or_refused(bytes)));
    assert!(start.elapsed() < PATIENCE, "{what}: {:?}", start.elapsed());
    result.unwrap_or_else(|_| panic!("{what}: {}", String::from_utf8_lossy(bytes)))
}

/// How many of the cases are accepted.
fn accepted(cases: usize, seed: u64, damage: fn(&Victim, &mut Random) -> Vec<u8>) -> usize {
    let (victim, mut random) = (Victim::new(), Random(seed));
    (0..cases).filter(|case| run(&damage(&victim, &mut random), &format!("case {case}"))).count()
}

#[test]
fn the_seed_is_valid() {
    assert!(run(&Victim::new().whole(), "the scene itself"));
}

#[test]
fn damaged_values() {
    let accepted = accepted(6000, 7, Victim::with_odd_values);
    eprintln!("{accepted} of 6000 damaged in their values are accepted");
    assert!((120..3000).contains(&accepted), "{accepted}");
}

#[test]
fn damaged_bytes() {
    let accepted = accepted(6000, 11, Victim::with_odd_bytes);
    eprintln!("{accepted} of 6000 damaged in their bytes are accepted");
    assert!(accepted > 120, "{accepted}");
}

/// `CANDELA_SCENES=5000` is the long run.
#[test]
fn a_server_answers_whatever_it_is_sent() {
    let cases = std::env::var("CANDELA_SCENES").ok().and_then(|text| text.parse().ok()).unwrap_or(100);
    let server = Server::start_with(None, &["--triangles", "100000"]);
    let (victim, mut random) = (Victim::new(), Random(23));
    let (mut rendered, mut slowest, mut memory) = (0, Duration::ZERO, 0);
    for case in 0..cases {
        let bytes =
            if random.below(2) == 0 { victim.with_odd_values(&mut random) } else { victim.with_odd_bytes(&mut random) };
        let begun = Instant::now();
        let status = server.render("/v1/render?width=8&height=8&max_samples=1&engine=cpu", &bytes);
        let took = begun.elapsed();
        assert!(
            status == 200 || (400..500).contains(&status),
            "case {case}: {status} {}",
            String::from_utf8_lossy(&bytes)
        );
        assert!(took < PATIENCE, "case {case}: {took:?}");
        rendered += usize::from(status == 200);
        slowest = slowest.max(took);
        memory = memory.max(server.memory().unwrap_or_default());
    }
    eprintln!(
        "{cases} damaged scenes: {rendered} rendered, the others refused; at most {slowest:.1?} and {} MiB",
        memory >> 20
    );
    assert_eq!(server.get("/healthz").0, 200);
    assert!(rendered > 0 && memory < MEMORY, "{rendered} {memory}");
}
