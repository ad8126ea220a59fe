//! Lists the files of `sensors/`: a product is a file, and nothing else names it.

use std::{env, fs, io, path::Path};

fn main() -> io::Result<()> {
    // Cargo runs this in the package's folder; a path from when this was compiled may be another checkout's.
    let folder = fs::canonicalize("../sensors")?;
    println!("cargo::rerun-if-changed={}", folder.display());
    let paths: io::Result<Vec<_>> = fs::read_dir(&folder)?.map(|e| Ok(e?.path())).collect();
    let mut paths = paths?;
    paths.retain(|path| path.extension().is_some_and(|e| e == "toml"));
    paths.sort();
    let product = |path: &Path| {
        let name = path.file_stem().unwrap_or_default();
        format!("({name:?}, include_str!({path:?})),\n")
    };
    let products: String = paths.iter().map(|path| product(path)).collect();
    let folder = env::var_os("OUT_DIR").unwrap_or_default();
    let out = Path::new(&folder).join("products.rs");
    fs::write(out, format!("&[{products}]"))
}
