//! Packs a KITTI `.bin` scan for `services/mluc/assets/`:
//! `cargo run --release -p mluc-ingest --example pack -- IN.bin OUT.scan`

use std::error::Error;

use mluc_ingest::{decode_bin, inspect_bin, pack};
use mluc_ipc_types::Point;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output] = &arguments[..] else {
        return Err("usage: pack IN.bin OUT.scan".into());
    };
    let bytes = std::fs::read(input)?;
    let mut points = vec![Point::default(); inspect_bin(&bytes).points_out as usize];
    decode_bin(&bytes, &mut points);
    std::fs::write(output, pack(&points))?;
    eprintln!("{} points", points.len());
    Ok(())
}
