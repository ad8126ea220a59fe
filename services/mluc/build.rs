//! Lists the models of `weights/` for embedding: each `weights/NAME.safetensors` becomes `--model NAME`. A checkout
//! without models builds too; then a model comes by its path.

use std::fmt::Write;
use std::path::Path;
use std::{env, fs};

fn main() {
    let root = env::var("CARGO_MANIFEST_DIR").expect("set by cargo");
    let folder = Path::new(&root).join("../../weights");
    println!("cargo:rerun-if-changed={}", folder.display());
    let mut files: Vec<_> = fs::read_dir(&folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|kind| kind == "safetensors"))
        .collect();
    files.sort();
    let mut code = String::from("pub(crate) const EMBEDDED: &[(&str, &[u8])] = &[\n");
    for file in &files {
        let name = file
            .file_stem()
            .expect("has an extension")
            .to_string_lossy();
        let path = fs::canonicalize(file).expect("was listed");
        writeln!(
            code,
            "    ({name:?}, include_bytes!({:?})),",
            path.display().to_string()
        )
        .expect("strings take all");
    }
    code.push_str("];\n");
    let out = env::var("OUT_DIR").expect("set by cargo");
    fs::write(Path::new(&out).join("embedded.rs"), code).expect("cargo's own folder");
}
