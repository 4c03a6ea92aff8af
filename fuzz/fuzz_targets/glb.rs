//! `cargo +nightly fuzz run glb`.
#![no_main]

#[path = "../../tests/robustness/damage.rs"]
#[allow(dead_code, reason = "other targets and the tests use the rest")]
mod damage;
#[path = "../../tests/robustness/targets.rs"]
#[allow(dead_code, reason = "other targets and the tests use the rest")]
mod targets;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    targets::sound_or_refused(bytes);
});
