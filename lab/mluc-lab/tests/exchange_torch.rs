//! A checkpoint that PyTorch wrote, imported: our network must answer what PyTorch and spconv answered with it.
//!
//! `bench/peers/network/checkpoint.py FOLDER` writes the checkpoint, converts it with
//! `tools/checkpoint_to_safetensors.py`, and writes the answers; MLUC_PEERS_CHECKPOINT names the folder. Not set: skipped; set and not there: an error.

use std::path::{Path, PathBuf};

use mluc_backbone::Backbone;
use mluc_head::Head;
use mluc_lab::exchange::{ImportRequest, Imported, import};
use mluc_tests::skip;

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Of the values' spread about their mean.
const TOLERANCE: f64 = 1e-3;

fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("MLUC_PEERS_CHECKPOINT").map(PathBuf::from);
    if folder.is_none() {
        skip("answers of PyTorch", "MLUC_PEERS_CHECKPOINT is not set");
    }
    folder
}

fn imported(path: &Path) -> Fallible<Imported> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(import(&bytes, &ImportRequest::kitti())?)
}

fn numbers(path: &Path) -> Fallible<Vec<f32>> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let values = bytes.as_chunks::<4>().0.iter();
    Ok(values.map(|value| f32::from_le_bytes(*value)).collect())
}

#[test]
fn an_imported_checkpoint_answers_as_pytorch_does() -> Fallible {
    let Some(folder) = folder() else {
        return Ok(());
    };
    let imported = imported(&folder.join("checkpoint.safetensors"))?;
    let legacy = self::imported(&folder.join("legacy.safetensors"))?;
    assert!(
        imported.weights == legacy.weights,
        "both formats of PyTorch"
    );
    let points: Vec<[f32; 4]> = numbers(&folder.join("points.bin"))?
        .chunks_exact(4)
        .map(|p| [p[0], p[1], p[2], p[3]])
        .collect();
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

/// Every head on every cell: the rows of the frame laid over those of the empty scene.
fn answers(imported: &Imported, points: &[[f32; 4]]) -> Fallible<Vec<Vec<f32>>> {
    let mut backbone = Backbone::new(&imported.manifest, &imported.weights)?;
    let head = Head::new(&imported.manifest, &imported.weights)?;
    let mut values = backbone.empty_rows()?;
    let channels = backbone.feature_channels();
    let count = backbone.run(points).rows;
    assert!(count > 1000, "the scan fills the map: {count} rows");
    let (cells, rows) = backbone.last_rows()?;
    for (cell, row) in cells.iter().zip(rows.chunks_exact(channels)) {
        values[*cell as usize * channels..][..channels].copy_from_slice(row);
    }
    Ok(head.outputs(&values).into_iter().collect())
}

fn compare(name: &str, found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len(), "{name}");
    let count = expected.len() as f64;
    let mean = expected.iter().map(|v| f64::from(*v)).sum::<f64>() / count;
    let square = expected.iter().map(|v| (f64::from(*v) - mean).powi(2));
    let spread = (square.sum::<f64>() / count).sqrt();
    let off = found
        .iter()
        .zip(expected)
        .map(|(a, b)| f64::from((a - b).abs()));
    let worst = off.fold(0.0, f64::max);
    println!(
        "{name}: {count} values, spread {spread:.3}, worst difference {:.1e} of it",
        worst / spread
    );
    assert!(
        spread > 0.01 && worst < TOLERANCE * spread,
        "{name}: {worst}"
    );
}
