//! Processes that do not do what they should, in the place of the one that denoises. What the library itself does is tried in
//! `tests/api/denoise.rs`, where it is present.

use super::*;

/// What a process says that has a library of version 9.9.9.
const HELLO: &str = r"printf '\007\0\0\0\0\0\0\0\0\0059.9.9'; ";

/// Waits for the first byte of the task.
const TASK: &str = "head -c 1 >/dev/null; ";

fn found(script: &str, patience: Duration) -> Result<Denoiser, String> {
    let script = script.to_owned();
    let start = move || {
        let mut command = Command::new("sh");
        command.args(["-c", &script]);
        Ok(command)
    };
    Denoiser::find(Box::new(start), None, Bounds { patience, ..Bounds::default() })
}

fn picture() -> Picture {
    Picture { width: 3, height: 2, pixels: vec![[1.0, 2.0, 3.0, 1.0]; 6] }
}

/// What becomes of a picture that is given to such a process.
fn end(script: &str, patience: Duration) -> String {
    let denoiser = found(&format!("{HELLO}{TASK}{script}"), patience).unwrap();
    assert_eq!(denoiser.name(), "Open Image Denoise 9.9.9");
    denoiser.denoise(&picture(), None, Guidance::None, &|| true).unwrap_err()
}

#[test]
fn a_process_that_has_no_library_says_why() {
    let why = |script| found(script, LOADING).map(|denoiser| denoiser.name()).unwrap_err();
    assert!(why("exit 3").contains("exit status: 3"), "{}", why("exit 3"));
    let none = r"printf '\006\0\0\0\0\0\0\0\001\004none'";
    assert_eq!(why(none), "Open Image Denoise cannot be loaded: none");
    assert!(why(r"printf '\002\0\0\0\0\0\0\0\007\007'").contains("its answer is none"));
}

#[test]
fn a_process_that_crashes_hangs_or_lies_costs_its_picture_alone() {
    let second = Duration::from_secs(1);
    assert!(end("kill -SEGV $$", LOADING).contains("signal: 11"));
    assert!(end("exit 0", LOADING).contains("exit status: 0"));
    assert_eq!(end("exec sleep 1000", second), "no answer for 1 s");
    assert!(end("exec 1>&-; exec sleep 1000", LOADING).contains("closed its output"));
    assert_eq!(end(r"printf '\005\0\0\0\0\0\0\0\001\003no!'; cat", LOADING), "no!");
    // A picture of no pixel, and one that breaks off.
    assert!(end(r"printf '\002\0\0\0\0\0\0\0\0\0'; cat", LOADING).contains("values that are none"));
    assert!(end(r"printf '\377\0\0\0\0\0\0\0\0\0'", LOADING).contains("has ended"));
}

#[test]
fn a_picture_that_nobody_wants_is_given_up() {
    let denoiser = found(&format!("{HELLO}exec sleep 1000"), LOADING).unwrap();
    let begun = Instant::now();
    let why = denoiser.denoise(&picture(), None, Guidance::None, &|| begun.elapsed() < LOOK).unwrap_err();
    assert!(why.contains("nobody wants"), "{why}");
    assert!(begun.elapsed() < LOADING / 2);
}

#[test]
fn a_black_picture_starts_no_process() {
    let denoiser = found(HELLO, LOADING).unwrap();
    let black = Picture { pixels: vec![[0.0, 0.0, 0.0, 1.0]; 6], ..picture() };
    assert_eq!(denoiser.denoise(&black, None, Guidance::None, &|| true), Ok(black));
}
