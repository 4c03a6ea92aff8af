//! Makes at build time what the program embeds: one function per job.

use std::fmt::Write;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::{env, fs};
use wesl::{ManglerKind, Wesl};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    link_shader("package::pathtrace::pathtrace", "pathtrace");
    for name in ["draw", "tiles", "finish"] {
        link_shader(&format!("package::preview::{name}"), &format!("preview_{name}"));
    }
    // Kernels that tests alone run; no program embeds them.
    link_shader("package::proof::parts", "parts");
    contract(&out);
    page(&out);
    source_hash();
}

/// What pictures depend on besides their scenes and parameters, as `CANDELA_SOURCE_HASH`.
fn source_hash() {
    let mut files = vec![PathBuf::from("Cargo.lock")];
    for folder in ["shaders", "src/compile", "src/film", "src/params", "src/render", "src/scene"] {
        println!("cargo::rerun-if-changed={folder}");
        files_below(Path::new(folder), &mut files);
    }
    files.sort();
    let mut hash = DefaultHasher::new();
    for file in files {
        (&file, fs::read(&file).expect("a file of this package")).hash(&mut hash);
    }
    println!("cargo::rustc-env=CANDELA_SOURCE_HASH={:016x}", hash.finish());
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

/// `openapi.yaml` -> `openapi.json`.
fn contract(out: &Path) {
    println!("cargo::rerun-if-changed=openapi.yaml");
    let yaml = fs::read_to_string("openapi.yaml").expect("openapi.yaml is beside Cargo.toml");
    let contract: serde_json::Value = serde_saphyr::from_str(&yaml).expect("openapi.yaml is YAML");
    fs::write(out.join("openapi.json"), contract.to_string()).expect("OUT_DIR can be written");
}

/// `web/` -> `page.rs`: a slice of (path, content), one entry per file.
fn page(out: &Path) {
    println!("cargo::rerun-if-changed=web");
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    files_below(&root.join("web"), &mut files);
    files.sort();
    let mut list = "&[\n".to_owned();
    for file in files {
        let path = file.strip_prefix(root.join("web")).expect("files lie in web").to_str().expect("names are UTF-8");
        let path = path.replace('\\', "/");
        writeln!(list, "(\"/{path}\", include_bytes!({:?}).as_slice()),", file.display().to_string()).expect("memory");
    }
    fs::write(out.join("page.rs"), list + "]\n").expect("OUT_DIR can be written");
}

/// All files of a folder and of those in it; none if there is no such folder.
fn files_below(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { files_below(&path, files) } else { files.push(path) }
    }
}
