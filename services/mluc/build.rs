//! Lists what is embedded: each `weights/NAME.safetensors` becomes `--model NAME`, each `assets/NAME.scan` a frame of
//! `mluc demo`, each `assets/NAME.txt` its labels. A checkout without them builds too; then a model comes by its path.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    let root = env::var("CARGO_MANIFEST_DIR").expect("set by cargo");
    let root = Path::new(&root);
    let mut code = String::new();
    let (weights, assets) = (root.join("../../weights"), root.join("assets"));
    list(&mut code, "MODELS", &weights, "safetensors");
    list(&mut code, "SCANS", &assets, "scan");
    list(&mut code, "LABELS", &assets, "txt");
    let out = env::var("OUT_DIR").expect("set by cargo");
    fs::write(Path::new(&out).join("embedded.rs"), code).expect("cargo's own folder");
}

/// `pub(crate) const NAME: &[(file stem, bytes)]`, in the order of the names.
fn list(code: &mut String, name: &str, folder: &Path, kind: &str) {
    println!("cargo:rerun-if-changed={}", folder.display());
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let is_kind = |path: &PathBuf| path.extension().is_some_and(|found| found == kind);
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    files.retain(is_kind);
    files.sort();
    writeln!(code, "pub(crate) const {name}: &[(&str, &[u8])] = &[").expect("strings take all");
    for file in &files {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let path = fs::canonicalize(file).expect("was listed");
        let path = path.display().to_string();
        writeln!(code, "    ({stem:?}, include_bytes!({path:?})),").expect("strings take all");
    }
    code.push_str("];\n");
}
