//! Writing simulated frames as a KITTI-format folder.
//!
//! `velodyne/*.bin` (x, y, z, intensity as little-endian f32), `label_2/*.txt`, `calib/*.txt`, `planes/*.txt`, `instances/*.u16` (little-endian, one per point)
//! and `ImageSets/SPLIT.txt`; sequences also `poses.txt` (x, y, z, yaw of the sensor in the frame of the sequence's first scan) and `timestamps.txt`.

use super::{ExportOptions, Family, SimulateError, SimulatedFrame, SimulatedObject};
use super::{labels::calibration, simulated};
use mluc_dataset::{DatasetError, Label, make_folders, scan_bytes, write_file};
use mluc_geometry::{Calibration, limit_period};
use rayon::prelude::*;

/// Writes a data set. `written` is called after each frame, from any thread.
pub fn export(options: &ExportOptions, written: impl Fn() + Sync) -> Result<(), SimulateError> {
    options.check()?;
    let parts = "velodyne label_2 calib planes instances ImageSets".split(' ');
    let parts = parts.chain(options.moving.then_some("timed"));
    make_folders(&options.folder, &parts.collect::<Vec<_>>())?;
    let calibration = calibration(options.family)?;
    let one = |index| {
        // A frame is complete when its last file exists and these files are not empty, which a power cut can cause.
        let has = |file: &str| {
            let path = options.folder.join(file);
            std::fs::metadata(path).is_ok_and(|file| file.len() > 0)
        };
        let files =
            [("planes", "txt"), ("velodyne", "bin"), ("instances", "u16"), ("calib", "txt")];
        let mut files = files.map(|(part, end)| format!("{part}/{index:06}.{end}")).into_iter();
        if options.resume && files.all(|file| has(&file)) {
            written();
            return Ok([0.0; 3]);
        }
        let (frame, pose) = simulated(options, index)?;
        write_frame(options, &calibration, index, &frame)?;
        written();
        Ok(pose)
    };
    let poses = options.indices().into_par_iter().map(one);
    write_poses(options, &poses.collect::<Result<Vec<_>, SimulateError>>()?)?;
    let names: String = (0..options.frames).map(|i| format!("{i:06}\n")).collect();
    let list = format!("ImageSets/{}.txt", options.split.name());
    let list = options.folder.join(list);
    Ok(write_file(&list, names.as_bytes())?)
}

/// Poses and time stamps of sequences. Each sequence is another place, one kilometre further, so that no place is visited twice.
fn write_poses(options: &ExportOptions, poses: &[[f64; 3]]) -> Result<(), DatasetError> {
    let Some(steps) = options.sequence else {
        return Ok(());
    };
    let mut text = String::from("# x y z yaw (m, rad)\n");
    let mut stamps = String::new();
    for (index, [x, y, z]) in poses.iter().enumerate() {
        let sequence = index / steps as usize;
        text += &format!("{} {y} {z} 0\n", x + 1000.0 * sequence as f64);
        let (seconds, tenths) = (index / 10, index % 10);
        let (h, m, s) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
        stamps += &format!("2000-01-01 {h:02}:{m:02}:{s:02}.{tenths}00000000\n");
    }
    write_file(&options.folder.join("poses.txt"), text.as_bytes())?;
    write_file(&options.folder.join("timestamps.txt"), stamps.as_bytes())
}

fn write_frame(
    options: &ExportOptions,
    calibration: &Calibration,
    index: u32,
    frame: &SimulatedFrame,
) -> Result<(), DatasetError> {
    let label = |object: &SimulatedObject| {
        let mut label = label_of(object, options.family, calibration);
        // Another sequence has other objects.
        let scene = options.sequence.map(|steps| index / steps);
        label.track = scene.map(|scene| scene * OBJECTS_MAX + object.number);
        format!("{label}\n")
    };
    let labels: String = frame.objects.iter().map(label).collect();
    let instances = frame.instances.iter().flat_map(|i| i.to_le_bytes());
    let calib = calibration_text(calibration);
    let plane = plane_text(calibration, frame.plane);
    let files = [
        ("velodyne", "bin", scan_bytes(&frame.points)),
        ("instances", "u16", instances.collect()),
        ("label_2", "txt", labels.into_bytes()),
        ("calib", "txt", calib.into_bytes()),
        ("planes", "txt", plane.into_bytes()),
    ];
    let rows = frame.points.iter().zip(&frame.times_s);
    let rows = rows.flat_map(|([x, y, z, i], time_s)| [*x, *y, *z, *i, *time_s]);
    let timed = rows.flat_map(f32::to_le_bytes);
    let timed = options.moving.then(|| ("timed", "bin", timed.collect()));
    for (folder, extension, bytes) in files.iter().chain(&timed) {
        let file = format!("{folder}/{index:06}.{extension}");
        write_file(&options.folder.join(file), bytes)?;
    }
    Ok(())
}

/// Upper bound on the number of objects in a scene.
const OBJECTS_MAX: u32 = 1000;

/// The label line of an object.
fn label_of(object: &SimulatedObject, family: Family, calibration: &Calibration) -> Label {
    let camera_box = calibration.label_from_box_in_sensor(&object.box_in_sensor);
    let [x, _, z] = camera_box.location_m;
    let alpha_rad = camera_box.rotation_y_rad - x.atan2(z);
    Label {
        class: object.class.name().to_owned(),
        truncated: object.truncated,
        occluded: object.occluded(family),
        alpha_rad: limit_period(alpha_rad, 0.5, std::f64::consts::TAU),
        image_box_px: object.image_box_px,
        camera_box,
        ..Label::default()
    }
}

fn calibration_text(calibration: &Calibration) -> String {
    const IDENTITY: &[f64] = &[1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.];
    let [p2, r0_rect, velo_to_cam] = calibration.matrices();
    let line = |(name, values): (&str, &[f64])| {
        let values: String = values.iter().map(|value| format!(" {value}")).collect();
        format!("{name}:{values}\n")
    };
    let cameras = ["P0", "P1", "P2", "P3"].map(|name| line((name, p2.1)));
    let rest = [r0_rect, velo_to_cam, ("Tr_imu_to_velo", IDENTITY)].map(line);
    cameras.concat() + &rest.concat()
}

/// The ground plane in the camera frame, in the layout of the road planes published for KITTI.
fn plane_text(calibration: &Calibration, [a, b, c, d]: [f64; 4]) -> String {
    // The ends of the normal, transformed to the camera frame. The normal has length 1 only to f32 precision.
    let [origin, tip] = [[0.0; 3], [a, b, c]].map(|p| calibration.rect_from_sensor(p));
    let [x, y, z] = [0, 1, 2].map(|i| tip[i] - origin[i]);
    let offset = d - (x * origin[0] + y * origin[1] + z * origin[2]);
    let length = x.hypot(y).hypot(z);
    let [x, y, z, offset] = [x, y, z, offset].map(|v| v / length);
    format!("# Plane\nWidth 4\nHeight 1\n{x:.6e} {y:.6e} {z:.6e} {offset:.6e}\n")
}
