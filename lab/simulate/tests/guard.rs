//! Tests ingest's guard on faults that users have, put into scans: of simulated products, and of real sensors in `MLUC_KITTI` and `MLUC_SENSORS`.
//! docs/sensors.md has the table that the test prints (`--nocapture`).

use mluc_dataset::read_scan;
use mluc_ingest::{DecodeReport, Expected, Guard, estimate::Estimator, estimate::SensorEstimate};
use mluc_ipc_types::{Flags, Point};
use mluc_model::{Manifest, Model, SensorProfile};
use mluc_simulate::{Family, Split, frame};
use mluc_tests::{data_folder, root};
use std::path::Path;

type Scan = Vec<Point>;

/// The number of scans after which a fault must be flagged.
const SCANS: usize = 10;

/// What the shipped model accepts: any sensor, all around.
fn takes() -> Manifest {
    Model::read(&root().join("weights/any-open.safetensors")).expect("a model").manifest
}

/// Scans of one sensor, its profile, and the estimate of the sensor from the scans.
struct Set {
    name: String,
    scans: Vec<Scan>,
    sensor: SensorProfile,
    found: SensorEstimate,
}

fn estimate(scans: &[Scan]) -> SensorEstimate {
    let mut estimator = Estimator::new();
    scans.iter().for_each(|scan| estimator.look(scan, 0));
    estimator.estimate().clone()
}

fn points(values: Vec<[f32; 4]>) -> Scan {
    values.into_iter().map(bytemuck::cast).collect()
}

/// Two scans of a simulated product.
fn simulated(name: &str) -> Set {
    let mut sensor = SensorProfile::load(name).expect("a product");
    sensor.height_m = Some(1.6);
    // Fewer columns make the test faster.
    sensor.azimuth_step_deg = sensor.azimuth_step_deg.max(0.4);
    let scan = |index| {
        let frame = frame(Family::SimAny, Split::Test, 11, index, Some(&sensor));
        points(frame.expect("a frame").points)
    };
    let scans: Vec<Scan> = (0..2).map(scan).collect();
    let found = estimate(&scans);
    Set { name: name.into(), scans, sensor, found }
}

/// The first scans of a folder; its sensor is estimated.
fn recorded(name: &str, folder: &Path, count: usize) -> Set {
    let files = std::fs::read_dir(folder).expect("a folder").flatten();
    let mut files: Vec<_> = files.map(|e| e.path()).collect();
    files.sort();
    files.truncate(count);
    let scans = files.iter().map(|file| read_scan(file).expect("a scan"));
    let scans: Vec<Scan> = scans.map(points).collect();
    let found = estimate(&scans);
    Set { name: name.into(), sensor: found.profile(name, None), scans, found }
}

/// All flags that the guard sets while the scans pass.
fn flagged(expected: &Expected, scans: impl Iterator<Item = (Scan, u32)>) -> Flags {
    let mut guard = Guard::new(expected.clone());
    let mut all = Flags::default();
    for (scan, not_finite) in scans {
        let report = DecodeReport { dropped_not_finite: not_finite, ..DecodeReport::default() };
        let reasons = guard.check(&scan, &report).iter();
        all = reasons.fold(all, |all, reason| all.with(reason.flag()));
    }
    all
}

/// A change of a scan; returns how many points are no longer finite.
type Change = Box<dyn Fn(&mut Scan) -> u32>;

fn each(change: impl Fn(&mut Point) + 'static) -> Change {
    Box::new(move |scan| {
        scan.iter_mut().for_each(&change);
        0
    })
}

fn keep(holds: impl Fn(&Point) -> bool + 'static) -> Change {
    Box::new(move |scan| {
        scan.retain(&holds);
        0
    })
}

fn scale(factor: f32) -> Change {
    each(move |p| [&mut p.x_m, &mut p.y_m, &mut p.z_m].into_iter().for_each(|v| *v *= factor))
}

/// The faults, and for each whether the guard must see it.
fn faults(set: &Set) -> Vec<(&'static str, Change, bool)> {
    let height_m = set.found.height_m.expect("a ground");
    let elevations = set.sensor.elevations_deg.clone();
    // If the beams are not clear, the profile's beams are synthetic: half of them is not half of the sensor's beams.
    let are_clear = set.found.are_beams_clear;
    let beam = move |p: &Point| {
        let deg = p.z_m.atan2(p.x_m.hypot(p.y_m)).to_degrees();
        let off = |at: &&f32| (**at - deg).abs();
        let nearest = elevations.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        elevations.iter().position(|at| Some(at) == nearest).unwrap_or(0)
    };
    let (sin, cos) = 10.0_f32.to_radians().sin_cos();
    let lift = |by_m: f32| each(move |p| p.z_m -= by_m);
    let tilted = each(move |p| {
        (p.x_m, p.z_m) = (cos * p.x_m - sin * p.z_m, sin * p.x_m + cos * p.z_m);
    });
    let twice: Change = Box::new(|scan| {
        scan.extend_from_within(..);
        0
    });
    let losing: Change = Box::new(|scan| {
        let all = scan.len();
        let left = scan.chunks(10).flat_map(|ten| ten.iter().skip(3));
        *scan = left.copied().collect();
        (all - scan.len()) as u32
    });
    let ahead = |p: &Point| (-0.5..1.594).contains(&p.y_m.atan2(p.x_m));
    let mut faults = Vec::new();
    let mut add = |name, change: Change, is_seen: bool| faults.push((name, change, is_seen));
    add("millimetres", scale(1000.0), true);
    add("feet", scale(1.0 / 0.3048), true);
    add("z down", each(|p| (p.y_m, p.z_m) = (-p.y_m, -p.z_m)), true);
    let swapped = each(|p| (p.x_m, p.y_m) = (p.y_m, p.x_m));
    add("x and y swapped", swapped, false);
    let turned = each(|p| (p.y_m, p.z_m) = (-p.z_m, p.y_m));
    add("turned by 90 degrees about x", turned, true);
    let half = keep(move |p| beam(p) % 2 == 0);
    add("half of the beams", half, are_clear);
    add("all points twice", twice, true);
    let [low, high] = [0.05, 5.0].map(|above_m| lift(above_m - height_m));
    add("0.25 m lower than the model takes", low, true);
    add("2 m higher than the model takes", high, true);
    add("tilted by 10 degrees", tilted, true);
    add("30 % NaN", losing, true);
    add("all zeros", each(|p| *p = Point::default()), true);
    add("120 degrees missing", keep(move |p| !ahead(p)), true);
    add("cut at 15 m", keep(|p| p.x_m.hypot(p.y_m) < 15.0), true);
    add("intensity 0 to 255", each(|p| p.intensity *= 255.0), true);
    faults
}

/// Prints rows of the table: scans without a fault must get no flag, scans with a fault must get one.
fn check(sets: &[Set]) {
    let mut wrong = Vec::new();
    for set in sets {
        let manifest = takes();
        let expected = Expected::new(&manifest, Some(set.sensor.clone()));
        let count = SCANS.max(set.scans.len());
        let cycle = || set.scans.iter().cloned().cycle().take(count);
        let mut row = |fault: &str, flags: Flags, is_expected: bool| {
            let names = flags.names().filter(|name| name.starts_with("suspect_"));
            let names = names.collect::<Vec<_>>().join(", ");
            println!("| {} | {fault} | {names} |", set.name);
            let is_optional = fault == "half of the beams" && !is_expected;
            let has_axes = fault != "z down" || flags.contains(Flags::SUSPECT_AXES);
            if !is_optional && (flags.contains(Flags::INPUT_SUSPECT) && has_axes) != is_expected {
                wrong.push(format!("{}: {fault}", set.name));
            }
        };
        let found = flagged(&expected, cycle().map(|scan| (scan, 0)));
        row("none", found, false);
        for (fault, change, is_seen) in faults(set) {
            let changed = cycle().take(SCANS).map(|mut scan| {
                let not_finite = change(&mut scan);
                (scan, not_finite)
            });
            row(fault, flagged(&expected, changed), is_seen);
        }
        let frozen = std::iter::repeat_n((set.scans[0].clone(), 0), SCANS);
        let found = flagged(&expected, frozen);
        row("the same scan again and again", found, true);
        let is_dense = set.sensor.elevations_deg.len() > 24;
        let other = if is_dense { "vlp-16" } else { "hdl-64e" };
        let other = SensorProfile::load(other).expect("a product");
        let expected = Expected::new(&manifest, Some(other));
        let found = flagged(&expected, cycle().map(|scan| (scan, 0)));
        row("another sensor is given", found, true);
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn faults_in_simulated_scans_are_flagged_and_sound_scans_are_not() {
    check(&["vlp-16", "hdl-32e", "os1-64"].map(simulated));
}

#[test]
fn faults_in_recorded_scans_are_flagged_and_sound_scans_are_not() {
    let mut sets = Vec::new();
    if let Some(folder) = data_folder("MLUC_KITTI") {
        let folder = folder.join("object/training/velodyne");
        sets.push(recorded("kitti", &folder, 20));
    }
    if let Some(folder) = data_folder("MLUC_SENSORS") {
        for entry in std::fs::read_dir(&folder).expect("a folder").flatten() {
            let (name, scans) = (entry.file_name(), entry.path().join("velodyne"));
            if scans.is_dir() {
                sets.push(recorded(&name.to_string_lossy(), &scans, 20));
            }
        }
    }
    check(&sets);
}
