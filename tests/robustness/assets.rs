//! Every sample scene imports, and can be posed.

use super::targets::{assert_poses, assert_sound};
use super::{load, scenes_below, shared};
use candela::scene::describe;

#[test]
fn sample_scenes_import() {
    let Some(shared) = shared() else { return };
    let mut faults = Vec::new();
    let folders = ["assets/scenes", "assets/asset-generator", "fidelity/models"];
    let scenes: Vec<_> = folders.iter().flat_map(|folder| scenes_below(&shared.join(folder))).collect();
    assert!(scenes.len() > 100, "only {} scenes found", scenes.len());
    for path in scenes {
        let name = path.strip_prefix(&shared).unwrap_or(&path).display().to_string();
        let start = std::time::Instant::now();
        match load(&path) {
            Ok(scene) => {
                assert_sound(&scene);
                assert_poses(&scene);
                let description = describe(&scene);
                let counts = &description.counts;
                let codes: Vec<&str> = scene.warnings.iter().map(|warning| warning.code).collect();
                let time = start.elapsed().as_secs_f64() * 1e3;
                eprintln!("{time:7.1} ms {:8} triangles  {name}  {codes:?}", counts.instanced_triangles);
                if counts.instanced_triangles == 0
                    && !scene.warnings.iter().any(|warning| warning.code == "primitive_skipped")
                {
                    faults.push(format!("{name}: nothing is drawn"));
                }
            }
            Err(error) => faults.push(format!("{name}: {error}")),
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}
