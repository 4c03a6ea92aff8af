//! Links the WGSL modules of `shaders/` into one source per entry file.

use wesl::{ManglerKind, Wesl};

fn main() {
    link_shader("package::pathtrace::pathtrace", "pathtrace");
}

/// Links an entry module with what it imports. Names are kept as written (they are unique over all modules), so that
/// pipeline constants and reflection can use them.
fn link_shader(entry: &str, name: &str) {
    println!("cargo::rerun-if-changed=shaders");
    let mut compiler = Wesl::new("shaders");
    compiler.set_mangler(ManglerKind::None);
    let path = entry.parse().expect("a module path");
    match compiler.compile(&path) {
        Ok(module) => module.write_artifact(name),
        Err(error) => panic!("shader {entry}: {error}"),
    }
}
