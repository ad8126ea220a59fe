//! Files that a user names: scans, captures, recordings, models, checkpoints, sensors, labels, objects; also messages of a page. The first byte
//! selects the kind, and whether points are corrected by the sensor's motion.
#![no_main]

use mluc_dataset::{read_calibration, read_labels};
use mluc_evaluate::input::read_json_lines;
use mluc_ingest::{decode_bin, inspect_bin};
use mluc_ipc_types::Point;
use mluc_model::{Model, SensorProfile, read_tensors};
use mluc_sources::{Next, Scan, Source, files::Layout, packets::Calibration};

/// The kinds that `--input` takes, then other files.
const KINDS: &str = "bin pcd.bin npy pcd ply pcap pcapng mcap model sensor labels calib lines checkpoint socket las";

/// All points of the first scans.
fn read_scans(path: &str, deskew: bool) -> anyhow::Result<()> {
    let layout = Layout { deskew, ..Layout::default() };
    let mut source = Source::open(path.as_ref(), &layout, false)?;
    let mut scan = Scan::default();
    for sequence in 0..4 {
        if source.load(sequence, &mut scan)? != Next::Scan {
            break;
        }
        let mut points = vec![Point::default(); inspect_bin(&scan.bytes).points_out as usize];
        decode_bin(&scan.bytes, &mut points);
        assert!(points.iter().all(Point::is_finite));
    }
    Ok(())
}

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let Some((&choice, bytes)) = data.split_first() else {
        return;
    };
    let kind = KINDS.split(' ').nth((choice % 128).into()).unwrap_or("bin");
    let path = format!("/dev/shm/mluc-fuzz-{}.{kind}", std::process::id());
    std::fs::write(&path, bytes).expect("room in shared memory");
    let (file, text) = (path.as_ref(), String::from_utf8_lossy(bytes));
    // Most files are refused. The target only checks that no file causes a crash.
    let _ = match kind {
        "model" => Model::from_bytes(bytes).is_ok(),
        "sensor" => SensorProfile::parse(&text, "here").is_ok(),
        "labels" => read_labels(file).is_ok(),
        "calib" => Calibration::parse(&text).is_ok() || read_calibration(file).is_ok(),
        "lines" => read_json_lines(file).is_ok(),
        "checkpoint" => read_tensors(bytes).is_ok(),
        "socket" => mluc_view::subscribe(&text, &mut Default::default()).is_ok(),
        _ => read_scans(&path, choice >= 128).is_ok(),
    };
    std::fs::remove_file(&path).expect("it is ours");
});
