//! Compares decoded packets of real sensors with the output of other decoders: one folder per sensor.
//!
//! `truth.pcd` has one revolution from another decoder, cut at any angle: our points of one turn are compared with it by nearest neighbour, turned about
//! z by the number of quarter turns that fits best (printed). `digest.json` has md5 sums of an Ouster's range images.

use md5::{Digest, Md5};
use mluc_sources::packets::{Calibration, Datagram, Metadata, Revolution};
use mluc_sources::{Scan, files::Format, files::Layout, pcap::Capture};
use mluc_tests::{oracle, read_json};
use rstar::RTree;
use std::fs::{read, read_dir, read_to_string};
use std::path::{Path, PathBuf};

const NEAR_M: f32 = 0.02;
const SHARE_MIN: f64 = 0.99;

/// A point's time (ns) and position.
type Timed = (u64, [f32; 3]);

fn capture(folder: &Path) -> Capture {
    Capture::open(folder.join("packets.pcap")).expect("a capture")
}

/// Every datagram of a capture, which must be complete.
fn each_datagram(folder: &Path, mut on: impl FnMut(&Datagram)) {
    let mut capture = capture(folder);
    while let Some(datagram) = capture.next_datagram().expect("readable") {
        on(&datagram);
    }
    let counts = capture.counts();
    assert!(!counts.cut_short && counts.fragmented_lost == 0, "{counts:?}");
}

/// x, y, z of a PCD file.
fn pcd_points(path: &Path) -> Vec<[f32; 3]> {
    let file = read(path).expect("readable");
    let mut scan = Scan::default();
    let is_cut = Format::Pcd.convert(&Layout::default(), file, &mut scan);
    assert!(!is_cut.expect("a PCD file"));
    let points = scan.bytes.chunks_exact(16).map(bytemuck::pod_read_unaligned);
    points.map(|[x, y, z, _]: [f32; 4]| [x, y, z]).collect()
}

fn has(tree: &RTree<[f32; 3]>, point: [f32; 3], within_m: f32) -> bool {
    tree.locate_within_distance(point, within_m * within_m).next().is_some()
}

/// The share of the points that have a point of the tree within [`NEAR_M`].
fn share(tree: &RTree<[f32; 3]>, points: impl Iterator<Item = [f32; 3]>) -> f64 {
    let near: Vec<bool> = points.map(|point| has(tree, point, NEAR_M)).collect();
    let count = near.iter().filter(|is_near| **is_near).count();
    count as f64 / near.len().max(1) as f64
}

fn turned([x, y, z]: [f32; 3], quarters: usize) -> [f32; 3] {
    [[x, y, z], [-y, x, z], [-x, -y, z], [y, -x, z]][quarters]
}

/// The share of the truth's points with one of ours near, the reverse share, and the quarter turns of our points.
fn compared(ours: &mut [Timed], turn_ns: u64, truth: &[[f32; 3]]) -> (f64, f64, usize) {
    let tree = RTree::bulk_load(truth.to_vec());
    let sample = |quarters| {
        let points = ours.iter().step_by(17).map(move |(_, point)| turned(*point, quarters));
        (share(&tree, points) * 1e6) as u64
    };
    let quarters = (0..4).max_by_key(|quarters| sample(*quarters)).unwrap_or(0);
    ours.iter_mut().for_each(|(_, point)| *point = turned(*point, quarters));
    ours.sort_by_key(|(ns, _)| *ns);
    // The turn that matches the truth: the turn with most points that agree to 2 mm.
    let mut same = vec![0u32];
    for (_, point) in ours.iter() {
        same.push(same[same.len() - 1] + u32::from(has(&tree, *point, 0.002)));
    }
    let after = |ns: u64| ours.partition_point(|(at, _)| *at < ns);
    let found = |start: &usize| same[after(ours[*start].0 + turn_ns)] - same[*start];
    let start = (0..ours.len()).step_by(97).max_by_key(found).expect("points");
    // The other decoder cuts at an angle, not at a time: one comparison extends beyond the turn, the reverse one stays within it.
    let (start_ns, edge_ns) = (ours[start].0, turn_ns / 20);
    let wide = after(start_ns.saturating_sub(edge_ns))..after(start_ns + turn_ns + edge_ns);
    let wide = RTree::bulk_load(ours[wide].iter().map(|(_, point)| *point).collect());
    let narrow = after(start_ns + edge_ns)..after(start_ns + turn_ns - edge_ns);
    let mut covered = vec![false; 361];
    truth.iter().for_each(|point| covered[degree(point)] = true);
    let narrow = ours[narrow].iter().map(|(_, point)| *point);
    let narrow = narrow.filter(|point| covered[degree(point)]);
    let of_truth = share(&wide, truth.iter().copied());
    (of_truth, share(&tree, narrow), quarters)
}

fn degree(point: &[f32; 3]) -> usize {
    (point[1].atan2(point[0]).to_degrees() + 180.0) as usize
}

/// Checks every range image of the digest: staggered, u32, row by row.
fn check_digest(folder: &Path, metadata: &Metadata) {
    let digest = read_json(&folder.join("digest.json"));
    let scans = digest["scans"].as_array().expect("scans");
    assert!(!scans.is_empty());
    let pixels = metadata.rows * metadata.columns;
    let mut frames: Vec<(u16, [Vec<u32>; 2])> = vec![];
    each_datagram(folder, |datagram| {
        metadata.shots(datagram.payload, &mut |shot| {
            if frames.last().is_none_or(|(frame, _)| *frame != shot.frame) {
                frames.push((shot.frame, [vec![0; pixels], vec![0; pixels]]));
            }
            let at = usize::from(shot.row) * metadata.columns + usize::from(shot.column);
            let (_, images) = frames.last_mut().expect("a frame");
            for (image, range_mm) in images.iter_mut().zip(shot.ranges_mm) {
                image[at] = range_mm;
            }
        });
    });
    for (scan, (frame, images)) in scans.iter().zip(&frames) {
        for (name, image) in ["RANGE", "RANGE2"].into_iter().zip(images) {
            let Some(expected) = scan[name].as_str() else {
                continue;
            };
            let bytes: Vec<u8> = image.iter().flat_map(|mm| mm.to_le_bytes()).collect();
            let found = format!("{:x}", Md5::digest(bytes));
            assert_eq!(found, expected, "frame {frame} {name}");
            let hits = image.iter().filter(|mm| **mm > 0).count();
            println!("  frame {frame} {name}: md5 agrees, {hits} of {pixels} pixels with a range");
        }
    }
    assert!(frames.len() >= scans.len(), "{} frames", frames.len());
}

/// The calibration file in the folder of the packets and the answers.
fn calibration(folder: &Path) -> Option<Calibration> {
    let answers = ["packets.pcap", "truth.pcd", "digest.json"].map(|name| folder.join(name));
    let others = read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mut others = others.filter(|path| !answers.contains(path));
    others.find_map(|path| Calibration::parse(&read_to_string(path).ok()?).ok())
}

fn check(folder: &Path) {
    let calibration = calibration(folder);
    let mut decoder = capture(folder).detect(calibration.as_ref()).expect("a decoder");
    let (mut stamps, mut points): (Vec<u64>, Vec<Timed>) = (vec![], vec![]);
    let mut on = |scan: &Revolution| {
        let times = scan.offsets_ns.iter().map(|ns| scan.stamp_ns + u64::from(*ns));
        points.extend(times.zip(scan.points.iter().map(|p| [p.x_m, p.y_m, p.z_m])));
        if !scan.is_partial {
            stamps.push(scan.stamp_ns);
        }
        let mut intensities = scan.points.iter().map(|point| point.intensity);
        assert!(intensities.all(|intensity| (0.0..=1.0).contains(&intensity)));
        assert!(scan.points.iter().all(|point| point.is_finite()));
        assert_eq!(scan.offsets_ns.len(), scan.points.len());
    };
    each_datagram(folder, |datagram| decoder.push(datagram, &mut on));
    decoder.finish(&mut on);
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let (product, counts, count) = (decoder.product(), decoder.counts(), points.len());
    println!("{name}: {product}, {count} points, {counts:?}");
    let mut is_checked = false;
    if let Some(Calibration::Ouster(metadata)) = &calibration {
        check_digest(folder, metadata);
        is_checked = true;
    }
    let truth = folder.join("truth.pcd");
    if truth.exists() {
        let truth = pcd_points(&truth);
        let turns: Vec<u64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let turn_ns = *turns.iter().min().expect("two whole revolutions");
        let (of_truth, of_ours, quarters) = compared(&mut points, turn_ns, &truth);
        let [percent_of_truth, percent_of_ours] = [of_truth, of_ours].map(|share| share * 100.0);
        let (degrees, true_points) = (90 * quarters, truth.len());
        println!(
            "  within 2 cm: {percent_of_truth:.2} % of {true_points} true points, {percent_of_ours:.2} % of ours, turned by {degrees} degrees"
        );
        assert!(of_truth >= SHARE_MIN, "{name}: of the truth {of_truth}");
        assert!(of_ours >= SHARE_MIN, "{name}: of ours {of_ours}");
        is_checked = true;
    }
    assert!(is_checked, "{name}: neither truth.pcd nor digest.json");
}

#[test]
fn oracle_packets_agree_with_other_decoders() {
    let Some(folder) = oracle().map(|folder| folder.join("packets")) else {
        return;
    };
    let entries = read_dir(&folder).expect("the folder of packets");
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    folders.retain(|path| path.join("packets.pcap").exists());
    folders.sort();
    assert!(!folders.is_empty(), "no packets");
    folders.iter().for_each(|folder| check(folder));
}
