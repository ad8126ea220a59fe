//! `mluc-lab render`: pictures of scans with labels and detections, one by one, as a sheet or as an animation.

use super::terminal::{counted, print_err, write_out};
use anyhow::{Context, bail, ensure};
use clap::Args;
use mluc_dataset::{Dataset, read_boxes, read_scan};
use mluc_evaluate::{SensorDetection, input::read_json_lines};
use mluc_gateway::picture::{BoxKind, Canvas, DrawnBox, View, bird_eye, perspective};
use mluc_ipc_types::FrameHeader;
use rayon::prelude::*;
use std::{collections::BTreeMap, path::Path, path::PathBuf};

/// Maximum number of pictures in a sheet or an animation: they are all in memory.
const PICTURES_MAX: usize = 256;
/// Width of a single picture, and of one among others, px.
const WIDTHS_PX: [usize; 2] = [1280, 640];
/// Pixels per metre of a picture from above, alone and among others.
const PX_PER_M: [f32; 2] = [10.0, 5.0];

/// Draw scans as a PNG, with the boxes of their labels and of what was found.
#[derive(Args)]
pub(crate) struct RenderArguments {
    /// A scan (x, y, z, intensity as little-endian f32), or a folder of scans or of velodyne/: a sheet of all.
    #[arg(long)]
    scan: PathBuf,
    /// What was found: the lines of `mluc up`, by the scans' names.
    #[arg(long, value_name = "FILE.jsonl")]
    detections: Option<PathBuf>,
    /// Labels in KITTI's format, a file or a folder of NAME.txt [default: label_2 next to the scan's folder, where it exists].
    #[arg(long)]
    labels: Option<PathBuf>,
    /// Calibrations, a file or a folder of NAME.txt [default: calib next to the scan's folder].
    #[arg(long)]
    calib: Option<PathBuf>,
    /// Show only what lies ahead, out to 70 m, instead of the full circle.
    #[arg(long)]
    ahead: bool,
    /// Look from behind and above the sensor instead of straight down.
    #[arg(long, conflicts_with = "ahead")]
    perspective: bool,
    /// Show a folder as an animated PNG, each scan for so many ms, instead of a sheet.
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u16).range(1..))]
    animate: Option<u16>,
    /// Picture to write.
    #[arg(long)]
    out: PathBuf,
}

pub(crate) fn run(arguments: RenderArguments) -> anyhow::Result<()> {
    write_out(&arguments.out, &arguments.picture()?)
}

impl RenderArguments {
    fn picture(&self) -> anyhow::Result<Vec<u8>> {
        let scans = self.scans()?;
        let found = self.found(&scans)?;
        let drawn = |step: &(dyn Fn() + Sync)| {
            let one = |scan: &PathBuf| {
                let picture = self.draw(scan, &found, scans.len() > 1);
                step();
                picture
            };
            scans.par_iter().map(one).collect::<anyhow::Result<Vec<_>>>()
        };
        let pictures = counted("drawing", scans.len(), drawn)?;
        Ok(match self.animate {
            Some(each_ms) => Canvas::animation(&pictures, each_ms),
            None => sheet(&pictures).png(),
        })
    }

    fn scans(&self) -> anyhow::Result<Vec<PathBuf>> {
        if !self.scan.is_dir() {
            let path = self.scan.display();
            let name = self.scan.to_string_lossy();
            let is_bin = name.ends_with(".bin") && !name.ends_with(".pcd.bin");
            let is_scan = self.scan.exists() && is_bin;
            ensure!(
                is_scan,
                "{path}: expected a .bin scan or a folder of them; `mluc demo --input` draws others"
            );
            return Ok(vec![self.scan.clone()]);
        }
        let dataset = Dataset::open(&self.scan)?;
        let count = dataset.names().len();
        ensure!(
            count <= PICTURES_MAX,
            "{}: expected at most {PICTURES_MAX} scans, found {count}: draw some of them",
            self.scan.display()
        );
        let scans = dataset.names().iter();
        Ok(scans.map(|name| dataset.scan_path(name)).collect())
    }

    /// Detections by scan name; at least one of the names must be a scan's.
    fn found(&self, scans: &[PathBuf]) -> anyhow::Result<BTreeMap<String, Vec<SensorDetection>>> {
        let Some(path) = &self.detections else {
            return Ok(BTreeMap::new());
        };
        let found = read_json_lines(path)?;
        if !scans.iter().any(|scan| found.contains_key(FrameHeader::cut(&stem(scan)))) {
            let expected = scans.first().map(|scan| stem(scan)).unwrap_or_default();
            let other = found.keys().next().context("no frame")?;
            bail!(
                "{}: field frame: expected '{expected}' or another scan's name, found '{other}'",
                path.display()
            );
        }
        Ok(found)
    }

    fn draw(
        &self,
        scan: &Path,
        found: &BTreeMap<String, Vec<SensorDetection>>,
        is_one_of_many: bool,
    ) -> anyhow::Result<Canvas> {
        let (points, title) = (read_scan(scan)?, stem(scan));
        let found = found.get(FrameHeader::cut(&title)).into_iter().flatten();
        let found = found.map(|found| DrawnBox {
            box_in_sensor: found.box_in_sensor,
            kind: [BoxKind::Known, BoxKind::Unknown][found.kind as usize],
            label: found.class.clone(),
            caption: format!("{} {:.2}", found.class, found.score),
        });
        let mut boxes = self.labelled_boxes(scan)?;
        boxes.extend(found);
        let size = usize::from(is_one_of_many);
        if self.perspective {
            return Ok(perspective(&points, &boxes, &title, WIDTHS_PX[size]));
        }
        let mut view = if self.ahead { View::ahead() } else { View::around() };
        (view.title, view.px_per_m) = (title, PX_PER_M[size]);
        Ok(bird_eye(&points, &boxes, &view))
    }

    fn labelled_boxes(&self, scan: &Path) -> anyhow::Result<Vec<DrawnBox>> {
        let Some(path) = given_or_beside(scan, &self.labels, "label_2") else {
            return Ok(Vec::new());
        };
        let Some(calibration) = given_or_beside(scan, &self.calib, "calib") else {
            let path = path.display();
            ensure!(self.labels.is_none(), "{path}: labels need --calib");
            print_err(format_args!("{path}: not drawn: no calibration"));
            return Ok(Vec::new());
        };
        let boxes = read_boxes(&path, &calibration)?.into_iter();
        let drawn = boxes.map(|(label, box_in_sensor)| DrawnBox {
            box_in_sensor,
            kind: BoxKind::Truth,
            label: label.class,
            caption: String::new(),
        });
        Ok(drawn.collect())
    }
}

fn stem(scan: &Path) -> String {
    scan.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The given file, or the scan's file in the given folder, or in `folder` next to the scan's own folder.
fn given_or_beside(scan: &Path, given: &Option<PathBuf>, folder: &str) -> Option<PathBuf> {
    let name = scan.with_extension("txt");
    let name = name.file_name()?;
    match given {
        Some(path) if path.is_dir() => Some(path.join(name)),
        Some(path) => Some(path.clone()),
        None => {
            let path = scan.parent()?.parent()?.join(folder).join(name);
            path.is_file().then_some(path)
        }
    }
}

/// A sheet of equally large pictures, with about as many rows as columns.
fn sheet(pictures: &[Canvas]) -> Canvas {
    let [width, height] = pictures[0].size_px();
    let columns = (pictures.len() as f64).sqrt().ceil() as usize;
    let rows = pictures.len().div_ceil(columns);
    let mut sheet = Canvas::new(columns * width, rows * height, [0; 3]);
    for (index, picture) in pictures.iter().enumerate() {
        sheet.paste(picture, [index % columns * width, index / columns * height]);
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_tests::{NO_CAMERA, write_file};

    #[test]
    fn labels_and_what_was_found_are_drawn_and_a_folder_is_a_sheet_or_an_animation() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let point: [f32; 4] = [20.0, 15.0, -1.0, 0.0];
        for name in ["0.bin", "1.bin"] {
            write_file(&at("scans").join(name), bytemuck::bytes_of(&point));
        }
        let car = "Car 0 0 0 0 0 100 100 1.5 1.6 4 0 1.7 20 -1.5708\n";
        write_file(&at("l.txt"), car);
        write_file(&at("c.txt"), NO_CAMERA);
        let found = r#"{"kind": "unknown", "label": "unknown", "score": 0.5, "center_m": [20, -9, 0], "size_m": [2, 2, 2], "yaw_rad": 0}"#;
        let line = |name: &str| format!("{{\"frame\": \"{name}\", \"objects\": [{found}]}}\n");
        write_file(&at("o.jsonl"), line("0"));
        write_file(&at("other.jsonl"), line("7"));
        let arguments = |scan: &str, labels: &str, detections: &str| RenderArguments {
            scan: at(scan),
            detections: (!detections.is_empty()).then(|| at(detections)),
            labels: (!labels.is_empty()).then(|| at(labels)),
            calib: Some(at("c.txt")),
            ahead: true,
            perspective: false,
            animate: None,
            out: PathBuf::new(),
        };
        let draw = |labels, detections| {
            let arguments = arguments("scans/0.bin", labels, detections);
            let scans = arguments.scans().expect("a scan");
            let found = arguments.found(&scans).expect("detections");
            arguments.draw(&scans[0], &found, false).expect("a picture")
        };
        let [plain, labelled, found] = [draw("", ""), draw("l.txt", ""), draw("", "o.jsonl")];
        // Where a picture differs from the plain one: row 504, 9 m to the right of the car.
        let differs = |canvas: &Canvas, columns: std::ops::Range<usize>| {
            let mut places = columns.flat_map(|x| (460..550).map(move |y| (x, y)));
            places.any(|(x, y)| canvas.pixel(x, y) != plain.pixel(x, y))
        };
        let places = |canvas| [380..420, 480..500].map(|columns| differs(canvas, columns));
        assert_eq!(places(&labelled), [true, false]);
        assert_eq!(places(&found), [false, true]);

        let size = |png: &[u8]| {
            [16, 20].map(|at| u32::from_be_bytes(png[at..at + 4].try_into().expect("4")))
        };
        let mut folder = arguments("scans", "l.txt", "o.jsonl");
        folder.perspective = true;
        let sheet = folder.picture().expect("a sheet");
        folder.animate = Some(100);
        let animation = folder.picture().expect("an animation");
        assert_eq!([size(&sheet), size(&animation)], [[1280, 360], [640, 360]]);
        assert!(animation.windows(4).any(|word| word == b"acTL"));
        let error = arguments("scans", "", "other.jsonl").picture();
        let error = error.expect_err("no frame is a scan's").to_string();
        assert!(error.contains("expected '0'") && error.contains("found '7'"), "{error}");
        assert!(arguments("none.bin", "", "").picture().is_err());
    }
}
