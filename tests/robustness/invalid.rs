//! The broken files of other projects' test suites: `INVALID.tsv` says which must be refused.

use super::targets::assert_sound;
use super::{load, shared};
use std::time::{Duration, Instant};

#[test]
fn broken_files_are_refused_with_their_place() {
    let Some(folder) = shared().map(|shared| shared.join("assets/invalid")) else { return };
    let table = std::fs::read_to_string(folder.join("INVALID.tsv")).expect("the table can be read");
    let mut faults = Vec::new();
    let mut rows = 0;
    for row in table.lines().skip(1) {
        let columns: Vec<&str> = row.split('\t').collect();
        let [path, _, _, class, codes, ..] = columns.as_slice() else { panic!("odd row: {row}") };
        rows += 1;
        let start = Instant::now();
        let result = std::panic::catch_unwind(|| load(&folder.join(path)));
        let time = start.elapsed();
        let (verdict, fault) = match &result {
            Err(_) => ("panic".to_owned(), true),
            Ok(Ok(scene)) => {
                assert_sound(scene);
                (format!("accepted, {} warnings", scene.warnings.len()), *class == "reject")
            }
            Ok(Err(error)) => {
                let names_place = !error.pointer.is_empty()
                    || ["byte", "line", "zip"].iter().any(|place| error.detail.contains(place));
                (format!("{:?} {} {error}", error.kind, error.code), !names_place || error.detail.len() < 15)
            }
        };
        eprintln!("{class:8} {:6.1} ms  {path}\n         {codes}\n         {verdict}", time.as_secs_f64() * 1e3);
        if fault || time > Duration::from_secs(2) {
            faults.push(format!("{path}: {verdict} ({time:?})"));
        }
    }
    assert!(rows > 50, "the table has {rows} rows");
    assert!(faults.is_empty(), "{faults:#?}");
}
