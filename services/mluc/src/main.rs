//! mluc
fn main() {}
