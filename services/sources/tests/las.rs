//! LAS files that laspy wrote (`las/make.py`).

use std::path::Path;

use mluc_sources::Scan;
use mluc_sources::files::{Format, Layout};

const POINTS: [f32; 12] = [
    1.0, 2.0, 3.0, 0.5, -4.0, 5.5, -6.0, 0.25, 7.0, -8.0, 9.0, 1.0,
];

/// Where the sensor is.
const X: f64 = 500_000.0;

fn file(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/las");
    std::fs::read(folder.join(name)).unwrap()
}

fn points(file: Vec<u8>, x: f64) -> Result<(Vec<[f32; 4]>, bool), String> {
    let layout = Layout {
        origin: [x, 5_400_000.0, 100.0],
        ..Layout::default()
    };
    let mut scan = Scan::default();
    let is_cut = Format::Las.convert(&layout, file, &mut scan);
    let is_cut = is_cut.map_err(|error| error.to_string())?;
    let (bytes, _) = scan.bytes.as_chunks();
    let numbers: Vec<f32> = bytes.iter().map(|v| f32::from_le_bytes(*v)).collect();
    Ok((numbers.as_chunks().0.to_vec(), is_cut))
}

#[test]
fn the_same_points_come_from_every_version() {
    for name in ["1.las", "6.las", "7.las"] {
        let (found, is_cut) = points(file(name), X).unwrap();
        let found = found.as_flattened().iter().map(|v| (v * 1e3).round() / 1e3);
        assert!(found.eq(POINTS) && !is_cut, "{name}");
    }
}

#[test]
fn what_does_not_fit_is_named_and_damage_gives_what_is_whole() {
    let far = points(file("1.las"), 0.0).unwrap_err();
    let words = "(--origin X,Y,Z says where the sensor is in them), found none, the first one at 500001.0,5400002.0,103.0";
    assert!(far.contains(words), "{far}");
    let packed = points(file("3.laz"), X).unwrap_err();
    let words = "`pdal translate IN.laz OUT.las`";
    assert!(packed.contains(words), "{packed}");
    for name in ["1.las", "6.las", "7.las"] {
        let whole = file(name);
        // Cut anywhere, or with a byte changed anywhere: an error or points, and no panic.
        for at in 0..whole.len() {
            let cut = points(whole[..at].to_vec(), X);
            let is_part = cut.map_or(0, |(found, _)| found.len()) <= 3;
            assert!(is_part, "{name} {at}");
            for bits in [0xff, 0x80, 0x01] {
                let mut changed = whole.clone();
                changed[at] ^= bits;
                let _ = points(changed, X);
            }
        }
    }
    let mut cut = file("1.las");
    cut.truncate(cut.len() - 5);
    let (found, is_cut) = points(cut, X).unwrap();
    assert_eq!((found.len(), is_cut), (2, true));
}
