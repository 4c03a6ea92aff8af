//! The broken files of other projects' test suites, sent as a person would send them: `INVALID.tsv` of the shared
//! assets says which must be refused.

use crate::support::Server;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

#[test]
fn broken_files_get_an_answer_that_names_the_place() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/assets/invalid");
    let Ok(table) = std::fs::read_to_string(folder.join("INVALID.tsv")) else {
        eprintln!("SKIPPED: ../shared/assets/invalid is not here");
        return;
    };
    let server = Server::start();
    let mut faults = Vec::new();
    for row in table.lines().skip(1) {
        let columns: Vec<&str> = row.split('\t').collect();
        let [path, _, _, class, ..] = columns.as_slice() else { panic!("odd row: {row}") };
        let files = files_beside(&folder.join(path));
        let parts: Vec<(&str, Option<&str>, &[u8])> =
            files.iter().map(|(name, bytes)| ("scene", Some(name.as_str()), bytes.as_slice())).collect();
        let begun = Instant::now();
        let reply = server.post_form("/v1/render?width=32&height=32&max_samples=1", &parts);
        let time = begun.elapsed();
        let text = String::from_utf8_lossy(&reply.body);
        let fault = match reply.status {
            200 => *class == "reject",
            400..=499 => !names_a_place(&text),
            _ => true,
        };
        // A picture's kernel may have to be compiled first, on a busy machine; a refusal needs no device.
        let patience = Duration::from_secs(if reply.status == 200 { 60 } else { 2 });
        if fault || time > patience {
            faults.push(format!("{path} ({class}): {} after {time:?} {text:.300}", reply.status));
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

/// The file first, then what lies in its folder, if it has one of its own.
fn files_beside(file: &Path) -> Vec<(String, Vec<u8>)> {
    let folder = file.parent().unwrap_or(file);
    let mut paths: Vec<PathBuf> = vec![file.to_owned()];
    if !folder.ends_with("invalid") {
        let others = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        paths.extend(others.filter(|path| path.is_file() && path != file));
    }
    let named = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        (name, std::fs::read(path).unwrap_or_default())
    };
    paths.iter().map(named).collect()
}

/// A JSON pointer into the scene, or a byte, a line or the container that is at fault.
fn names_a_place(problem: &str) -> bool {
    ["\"/scene/", "byte", "line", "GLB", "zip"].iter().any(|place| problem.contains(place))
}
