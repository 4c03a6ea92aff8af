//! Every sample scene imports, but those that require what is not supported.

use super::{assert_sound, load, scenes_below, shared};
use candela::scene::{SceneErrorKind, describe};

/// Files that require an extension that is not supported, and which.
const REFUSED: &[(&str, &str)] = &[
    ("assets/scenes/BoxTextured_meshopt.glb", "EXT_meshopt_compression"),
    ("assets/scenes/Box_Draco.glb", "KHR_draco_mesh_compression"),
];

#[test]
fn sample_scenes_import() {
    let Some(shared) = shared() else { return };
    let mut faults = Vec::new();
    let mut refused = Vec::new();
    let folders = ["assets/scenes", "assets/asset-generator", "fidelity/models"];
    let scenes: Vec<_> = folders.iter().flat_map(|folder| scenes_below(&shared.join(folder))).collect();
    assert!(scenes.len() > 100, "only {} scenes found", scenes.len());
    for path in scenes {
        let name = path.strip_prefix(&shared).unwrap_or(&path).display().to_string();
        let start = std::time::Instant::now();
        match load(&path) {
            Ok(scene) => {
                assert_sound(&scene);
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
            Err(error) if error.code == "extension_required" => {
                assert_eq!(error.kind, SceneErrorKind::Invalid);
                refused.push((name, error.detail));
            }
            Err(error) => faults.push(format!("{name}: {error}")),
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
    assert_eq!(refused.len(), REFUSED.len(), "{refused:#?}");
    for ((name, detail), (expected, extension)) in refused.iter().zip(REFUSED) {
        assert!(name == expected && detail.contains(extension), "{name}: {detail}");
    }
}
