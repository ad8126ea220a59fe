//! Recordings that MCAP's own Python packages wrote (`recordings/make.py`).

use mluc_ipc_types::Flags;
use mluc_sources::{Next, Scan, Source, files::Layout};
use std::path::{Path, PathBuf};

const POINTS: [f32; 12] = [1.0, 2.0, 3.0, 0.5, -4.0, 5.5, -6.0, 0.25, 7.0, -8.0, 9.0, 1.0];

fn recording(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recordings").join(name)
}

fn open(path: &Path, topic: Option<&str>, repeat: bool) -> Result<Source, String> {
    let layout =
        Layout { topic: topic.map(str::to_string), intensity_scale: 0.25, ..Layout::default() };
    Source::open(path, &layout, repeat).map_err(|error| format!("{error:#}"))
}

fn load(source: &mut Source, sequence: u64, scan: &mut Scan) -> Next {
    let mut loads = std::iter::repeat_with(|| source.load(sequence, scan).unwrap());
    loads.find(|next| *next != Next::NotYet).unwrap()
}

#[test]
fn the_same_points_come_from_every_message_and_compression() {
    let points: Vec<u8> = POINTS.iter().flat_map(|v| v.to_le_bytes()).collect();
    for (name, topic, count) in [
        ("ros2.mcap", None, 3),
        ("plain.mcap", None, 3),
        ("lz4.mcap", None, 3),
        ("unchunked.mcap", None, 3),
        ("clouds.mcap", Some("/big_endian"), 3),
        ("clouds.mcap", Some("/padded_rows"), 3),
        ("clouds.mcap", Some("/ros1"), 3),
        ("clouds.mcap", Some("/foxglove"), 3),
        // A damaged message gives the points that it has, and is flagged.
        ("clouds.mcap", Some("/cut"), 2),
        ("clouds.mcap", Some("/no_x"), 0),
    ] {
        let mut source = open(&recording(name), topic, false).unwrap();
        let mut scan = Scan::default();
        assert_eq!(load(&mut source, 0, &mut scan), Next::Scan);
        assert_eq!(scan.bytes, points[..16 * count], "{name} {topic:?}");
        let is_whole = scan.flags == Flags::default();
        assert_eq!(is_whole, count == 3, "{name} {topic:?}");
        // The time of recording, if nothing gives the sensor's time.
        let stamp_ns = [1_000_000_000, 5_000_000_006][usize::from(count > 0)];
        assert_eq!(scan.stamp_ns, Some(stamp_ns));
    }
}

#[test]
fn scans_come_as_they_were_recorded_round_after_round() {
    let mut scan = Scan::default();
    for (repeat, sequences) in [(false, 0..2), (true, 0..5), (true, 1..4)] {
        let mut source = open(&recording("lz4.mcap"), None, repeat).unwrap();
        assert_eq!(source.count(), Some(2));
        for sequence in sequences.clone() {
            // A second request gives the same scan.
            for _ in 0..2 {
                assert_eq!(load(&mut source, sequence, &mut scan), Next::Scan);
                let found = (&*scan.name, scan.offset_ns);
                let name = format!("{sequence:06}");
                assert_eq!(found, (&*name, Some(sequence * 100_000_000)));
            }
        }
        let end = load(&mut source, sequences.end, &mut scan);
        assert_eq!(end == Next::End, !repeat);
    }
    // Damage in the second chunk: the scan of the first one comes, and then the end.
    let mut bytes = std::fs::read(recording("lz4.mcap")).unwrap();
    bytes[600] ^= 1;
    let file = tempfile::Builder::new().suffix(".mcap").tempfile().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let mut source = open(file.path(), None, false).unwrap();
    let found = [0, 1, 2].map(|sequence| load(&mut source, sequence, &mut scan));
    assert_eq!((found[0], found[2]), (Next::Scan, Next::End));
}

#[test]
fn points_are_corrected_by_whatever_tells_of_motion() {
    let load_with = |odometry: Option<&str>, name: &str| {
        let layout =
            Layout { deskew: true, odometry: odometry.map(str::to_string), ..Layout::default() };
        Source::open(&recording(name), &layout, false).map_err(|error| format!("{error:#}"))
    };
    for odometry in [None, Some("/odom"), Some("/pose")] {
        let mut source = load_with(odometry, "moving.mcap").unwrap();
        for sequence in 0..2 {
            let mut scan = Scan::default();
            assert_eq!(load(&mut source, sequence, &mut scan), Next::Scan);
            let (bytes, _) = scan.bytes.as_chunks();
            let numbers: Vec<f32> = bytes.iter().map(|v| f32::from_le_bytes(*v)).collect();
            for (number, [x, y, z, _]) in numbers.as_chunks::<4>().0.iter().enumerate() {
                // The sensor faces the robot's left: what is ahead of the robot is on the sensor's right.
                let off = [x - 10.0, y + 0.1 * number as f32, z + 1.0];
                assert!(off.iter().all(|off| off.abs() < 2e-3), "{odometry:?} {number}: {off:?}");
            }
            assert_eq!((numbers.len(), scan.flags), (44, Flags::default()));
            let [x, y, z] = scan.pose.unwrap().position_m;
            let off = [x - 1.0 - sequence as f64, y, z - 0.5];
            assert!(off.iter().all(|off| off.abs() < 1e-9), "{off:?}");
        }
    }
    let own = "topic of poses: expected /points of nav_msgs/msg/Odometry";
    let any = "topic of poses: expected a topic of nav_msgs";
    let cases = [(Some("/points"), "moving.mcap", own), (None, "lz4.mcap", any)];
    for (odometry, name, words) in cases {
        let error = load_with(odometry, name).err().unwrap();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn what_cannot_be_taken_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let whole = std::fs::read(recording("plain.mcap")).unwrap();
    let packed = std::fs::read(recording("lz4.mcap")).unwrap();
    let mut other = packed.clone();
    let at = packed.windows(3).rposition(|word| word == b"lz4").unwrap();
    other[at] = b'q';
    let clouds = std::fs::read(recording("clouds.mcap")).unwrap();
    // The statistics count two messages of the second channel.
    let (mut silent, two) = (whole.clone(), [2u8, 0, 2, 0, 0, 0, 0, 0, 0, 0]);
    let at = whole.windows(10).rposition(|word| word == two).unwrap();
    silent[at + 2] = 0;
    let cases = [
        (&clouds[..], None),
        (&clouds, Some("/json")),
        (&whole, Some("/b")),
        (&whole[..whole.len() - 100], None),
        (&whole[8..], None),
        (b"", None),
        (&other, None),
        (&silent, None),
    ];
    let lines = include_str!("recordings/refused.txt").lines();
    assert_eq!(lines.clone().count(), cases.len());
    for ((bytes, topic), words) in cases.into_iter().zip(lines) {
        std::fs::write(&path, bytes).unwrap();
        let error = open(folder.path(), topic, false).err().unwrap();
        assert!(error.contains(words), "{words}: {error}");
    }
}
