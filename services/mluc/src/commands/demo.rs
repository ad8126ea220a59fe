//! `mluc demo`: the whole pipeline, four processes, on scans that the program brings along.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use mluc_gateway::picture::{BoxKind, DrawnBox, View, bird_eye};
use mluc_geometry::Box3;
use mluc_ipc_types::{FrameHeader, Object, ObjectKind, Point};
use mluc_runtime::log_to_stderr;

use crate::bundled::BundledScans;
use crate::cli::{DemoArgs, PipelineArgs};
use crate::settings::{Pace, Settings};
use crate::supervisor::{Sink, run};
use crate::terminal::print_out;

/// Objects below these scores, known and unknown, are not printed or drawn; `mluc up` gives them all.
const SCORE_MIN: f32 = 0.3;
const UNKNOWN_SCORE_MIN: f32 = 0.05;

pub(crate) fn demo(args: DemoArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("demo", "warn");
    let scans = BundledScans::write("demo")?;
    let settings = Settings::resolve(PipelineArgs {
        input: Some(scans.folder().to_path_buf()),
        model: Some(args.model),
        pace: Some(Pace::Complete),
        instance: Some(format!("demo-{}", std::process::id())),
        ..PipelineArgs::default()
    })?;
    let count = scans.points.len();
    print_out(format_args!(
        "{count} simulated scans through four processes:\n"
    ))?;
    let mut show = Show::default();
    let outcome = run(&settings, &mut show)?;
    print_out(format_args!("\n{}", outcome.latencies.table()))?;
    match show.best {
        Some(best) => {
            let points = scans.points.get(best.sequence as usize);
            draw(&args.picture, points.map_or(&[], Vec::as_slice), &best)?;
            let picture = args.picture.display();
            print_out(format_args!("picture of frame {}: {picture}", best.name))?;
        }
        None => print_out("no frame came out: no picture")?,
    }
    Ok(ExitCode::from(outcome.exit_code()))
}

/// A frame that is worth a picture.
struct Best {
    sequence: u64,
    name: String,
    unknown: usize,
    boxes: Vec<DrawnBox>,
}

/// Prints each frame and remembers the one with the most unknown objects.
#[derive(Default)]
struct Show {
    best: Option<Best>,
}

impl Sink for Show {
    fn frame(
        &mut self,
        header: &FrameHeader,
        objects: &[Object],
        classes: &[String],
    ) -> anyhow::Result<bool> {
        let score_min = |o: &Object| {
            if is_unknown(o) {
                UNKNOWN_SCORE_MIN
            } else {
                SCORE_MIN
            }
        };
        let is_shown = |o: &&Object| o.is_published() && o.score >= score_min(o);
        let shown: Vec<&Object> = objects.iter().filter(is_shown).collect();
        print_out(format_args!(
            "frame {}: {} points, {} objects",
            header.name(),
            header.points_in,
            shown.len()
        ))?;
        for object in &shown {
            print_out(format_args!("  {}", describe(object, classes)))?;
        }
        let unknown = shown.iter().filter(|object| is_unknown(object)).count();
        if self.best.as_ref().is_none_or(|best| unknown > best.unknown) {
            self.best = Some(Best {
                sequence: header.sequence,
                name: header.name().to_string(),
                unknown,
                boxes: shown.iter().map(|object| drawn(object, classes)).collect(),
            });
        }
        Ok(true)
    }
}

fn is_unknown(object: &Object) -> bool {
    object.kind == ObjectKind::Unknown as u32
}

fn label<'a>(object: &Object, classes: &'a [String]) -> &'a str {
    if is_unknown(object) {
        return "UNKNOWN";
    }
    let class = classes.get(object.class_id as usize);
    class.map_or("?", String::as_str)
}

fn describe(object: &Object, classes: &[String]) -> String {
    let ([x, y, z], [l, w, h]) = (object.center_m, object.size_m);
    format!(
        "{:11} score {:4.2}  at {x:6.1} {y:6.1} {z:5.1} m  size {l:4.1} x {w:3.1} x {h:3.1} m  heading {:4.0} deg  {:5} \
         points  normalised EDS {:4.2}",
        label(object, classes),
        object.score,
        object.yaw_rad.to_degrees(),
        object.points_count,
        object.eds_normalised,
    )
}

fn drawn(object: &Object, classes: &[String]) -> DrawnBox {
    DrawnBox {
        box_in_sensor: Box3 {
            center_m: object.center_m.map(f64::from),
            size_m: object.size_m.map(f64::from),
            yaw_rad: f64::from(object.yaw_rad),
        },
        kind: if is_unknown(object) {
            BoxKind::Unknown
        } else {
            BoxKind::Known
        },
        label: label(object, classes).to_lowercase(),
        caption: format!("{} {:.2}", label(object, classes), object.score),
    }
}

fn draw(path: &Path, points: &[Point], best: &Best) -> anyhow::Result<()> {
    let view = View {
        title: format!("mluc demo, frame {}", best.name),
        ..View::around()
    };
    let file = File::create(path).with_context(|| format!("creating {}", path.display()))?;
    let canvas = bird_eye(bytemuck::cast_slice(points), &best.boxes, &view);
    canvas
        .write_png(&mut BufWriter::new(file))
        .with_context(|| format!("writing {}", path.display()))
}
