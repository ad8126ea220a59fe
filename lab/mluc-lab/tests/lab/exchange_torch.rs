//! Imports a checkpoint that PyTorch wrote: our network must give the answers of PyTorch and spconv.
//!
//! `bench/peers/network/checkpoint.py FOLDER` writes the checkpoint, converts it with
//! `tools/checkpoint_to_safetensors.py`, and writes the answers; MLUC_PEERS_CHECKPOINT names the folder. Not set: skipped; a missing folder: an error.

use crate::exchange::on_kitti;
use anyhow::Context;
use mluc_backbone::Backbone;
use mluc_dataset::read_scan;
use mluc_geometry::mean_and_spread;
use mluc_head::Head;
use mluc_lab::exchange::{Imported, import};
use mluc_tests::{data_folder, feature_map};
use std::path::Path;

/// Tolerance as a share of the values' spread about their mean.
const TOLERANCE: f64 = 1e-3;

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    std::fs::read(path).with_context(|| path.display().to_string())
}

fn numbers(path: &Path) -> anyhow::Result<Vec<f32>> {
    let bytes = read(path)?;
    let values = bytes.as_chunks::<4>().0.iter();
    Ok(values.map(|value| f32::from_le_bytes(*value)).collect())
}

#[test]
fn an_imported_checkpoint_answers_as_pytorch_does() -> anyhow::Result<()> {
    let Some(folder) = data_folder("MLUC_PEERS_CHECKPOINT") else {
        return Ok(());
    };
    let imported = |name: &str| import(&read(&folder.join(name))?, on_kitti());
    let legacy = imported("legacy.safetensors")?;
    let imported = imported("checkpoint.safetensors")?;
    assert!(imported.weights == legacy.weights, "both formats of PyTorch");
    let points = read_scan(&folder.join("points.bin"))?;
    let found = answers(&imported, &points)?;
    let network = &imported.manifest.network;
    let names = ["conv_cls", "conv_box", "conv_dir_cls"];
    assert_eq!(found.len(), names.len());
    for ((name, values), (_, channels)) in names.iter().zip(&found).zip(network.heads()) {
        let expected = numbers(&folder.join(name).with_extension("bin"))?;
        let [rows, columns] = network.map_shape();
        assert_eq!(expected.len(), rows * columns * channels, "{name}");
        compare(name, values, &expected);
    }
    Ok(())
}

/// The output of every head on every cell of the map.
fn answers(imported: &Imported, points: &[[f32; 4]]) -> anyhow::Result<Vec<Vec<f32>>> {
    let mut backbone = Backbone::new(&imported.manifest, &imported.weights)?;
    let head = Head::new(&imported.manifest, &imported.weights)?;
    let empty = backbone.empty_rows()?;
    let count = backbone.run(points).rows;
    assert!(count > 1000, "the scan fills the map: {count} rows");
    Ok(head.outputs(&feature_map(&backbone, empty)?))
}

fn compare(name: &str, found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len(), "{name}");
    let wide: Vec<f64> = expected.iter().map(|v| f64::from(*v)).collect();
    let [_, spread] = mean_and_spread(&wide);
    let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
    let worst = f64::from(off.fold(0.0, f32::max)) / spread;
    let count = wide.len();
    println!("{name}: {count} values, spread {spread:.3}, worst difference {worst:.1e} of it");
    assert!(spread > 0.01 && worst < TOLERANCE, "{name}: {worst}");
}
