//! Names the shared library: without a name a program asks for it by the path at which it was linked.

fn main() {
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libmluc_capi.so");
}
