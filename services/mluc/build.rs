//! Lists what is embedded: each `weights/NAME.safetensors` becomes `--model NAME`, each `assets/NAME.scan` a frame of
//! `mluc demo`, each `assets/NAME.txt` its labels. A checkout without them builds too; then a model comes by its path.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    let root = env::var("CARGO_MANIFEST_DIR").expect("set by cargo");
    let root = Path::new(&root);
    let mut code = String::new();
    list(
        &mut code,
        "MODELS",
        &root.join("../../weights"),
        "safetensors",
    );
    list(&mut code, "SCANS", &root.join("assets"), "scan");
    list(&mut code, "LABELS", &root.join("assets"), "txt");
    let out = env::var("OUT_DIR").expect("set by cargo");
    fs::write(Path::new(&out).join("embedded.rs"), code).expect("cargo's own folder");
}

/// `pub(crate) const NAME: &[(file stem, bytes)]`, in the order of the names.
fn list(code: &mut String, name: &str, folder: &Path, kind: &str) {
    println!("cargo:rerun-if-changed={}", folder.display());
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|found| found == kind))
        .collect();
    files.sort();
    writeln!(code, "pub(crate) const {name}: &[(&str, &[u8])] = &[").expect("strings take all");
    for file in &files {
        let stem = file
            .file_stem()
            .expect("has an extension")
            .to_string_lossy();
        let path = fs::canonicalize(file).expect("was listed");
        let path = path.display().to_string();
        writeln!(code, "    ({stem:?}, include_bytes!({path:?})),").expect("strings take all");
    }
    code.push_str("];\n");
}
