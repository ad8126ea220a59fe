//! The refiners in other languages, where `.ci/examples` has installed what they need.

use std::process::Command;

use crate::inputs::root;
use crate::skip::skip;

/// The Python example's command; `None`, said: Python or its packages are not there.
pub fn python_refiner() -> Option<Vec<String>> {
    let python = root().join("target/examples/venv/bin/python");
    let has_packages = Command::new(&python)
        .args(["-c", "import iceoryx2, numpy"])
        .output()
        .is_ok_and(|output| output.status.success());
    if !has_packages {
        skip(
            "the Python refiner",
            "no Python with iceoryx2 and numpy in target/examples/venv (run .ci/examples)",
        );
        return None;
    }
    let script = root().join("examples/refiner-python/refiner.py");
    let words = [python, script].map(|path| path.display().to_string());
    Some(words.to_vec())
}

/// The C++ example's command; `None`, said: it was not built.
pub fn cpp_refiner() -> Option<Vec<String>> {
    let program = root().join("target/examples/refiner-cpp/refiner");
    if !program.exists() {
        let why = format!("{} is not built (run .ci/examples)", program.display());
        skip("the C++ refiner", &why);
        return None;
    }
    Some(vec![program.display().to_string()])
}
