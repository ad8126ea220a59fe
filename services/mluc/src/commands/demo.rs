//! `mluc demo`: the whole pipeline, four processes, on the user's scans or on the bundled ones, with output for people.

use super::up::Summary;
use crate::settings::{Pace, Settings};
use crate::supervisor::{Left, LineWriter, Sink, run};
use crate::terminal::{print_err, print_out};
use crate::{bundled::BundledScans, cli::PipelineArgs, piped::Piped};
use anyhow::Context;
use mluc_gateway::picture::{BoxKind, DrawnBox, View, bird_eye};
use mluc_geometry::Box3;
use mluc_ipc_types::{Object, ObjectKind, Point};
use mluc_runtime::{Shutdown, log_to_stderr};
use mluc_sources::is_live;
use std::{path::Path, process::ExitCode};

pub(crate) fn demo(picture: &Path, mut args: PipelineArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("demo", "warn");
    let _piped = Piped::take(&mut args.input)?;
    // From here on the program cleans up after a signal.
    let shutdown = Shutdown::on_signals()?;
    let is_own = args.input.is_none() && args.config.is_none();
    let bundled = is_own.then(|| BundledScans::write("demo")).transpose()?;
    if let Some(scans) = &bundled {
        args.input = Some(scans.folder().to_path_buf());
        print_out("simulated scans through four processes:\n")?;
    }
    // A live sensor does not wait.
    let is_live = args.input.as_deref().is_some_and(is_live);
    if args.config.is_none() && !is_live {
        args.pace.get_or_insert(Pace::Complete);
    }
    let own = || format!("demo-{}", std::process::id());
    args.instance.get_or_insert_with(own);
    let settings = Settings::resolve(args.clone())?;
    let mut shown = Shown { best: None, summary: Summary::default() };
    let (outcome, dropped) = run(args, settings, shutdown, &mut shown)?;
    let is_read = dropped? == 0;
    // If nobody reads standard output, the text goes to standard error.
    let say = |text: String| {
        if is_read {
            return print_out(text);
        }
        print_err(text);
        Ok(())
    };
    say(format!("\n{}", outcome.latencies.table()))?;
    let Some(best) = shown.best else {
        say("no frame came out: no picture".into())?;
        return Ok(shown.summary.exit_code(&outcome));
    };
    let view = View { title: format!("mluc demo, frame {}", best.name), ..View::around() };
    let canvas = bird_eye(bytemuck::cast_slice(&best.points), &best.boxes, &view);
    std::fs::write(picture, canvas.png())
        .with_context(|| format!("writing {}", picture.display()))?;
    let picture = picture.display();
    say(format!("picture of frame {}: {picture}", best.name))?;
    Ok(shown.summary.exit_code(&outcome))
}

struct Shown {
    best: Option<Best>,
    summary: Summary,
}

/// The frame whose unknown objects have the largest sum of scores.
struct Best {
    name: String,
    points: Vec<Point>,
    /// Sum of the scores of its unknown objects.
    unknown: f32,
    boxes: Vec<DrawnBox>,
}

impl Sink for Shown {
    fn take(&mut self, left: Left<'_>, writer: &mut LineWriter) -> anyhow::Result<bool> {
        let (header, objects, classes) = (left.header, left.objects, left.classes);
        self.summary.record(header);
        let shown: Vec<&Object> = objects.iter().filter(|o| o.is_published()).collect();
        let (name, points_in, count) = (header.name(), header.points_in, shown.len());
        let mut text = format!("frame {name}: {points_in} points, {count} objects");
        for object in &shown {
            text += &format!("\n  {}", describe(object, classes));
        }
        let is_read = writer.hand_on(text.into_bytes());
        let unknown = shown.iter().filter(|object| is_unknown(object));
        let unknown = unknown.map(|object| object.score).sum();
        if self.best.as_ref().is_none_or(|best| unknown > best.unknown) {
            self.best = Some(Best {
                name: name.to_string(),
                points: left.points.to_vec(),
                unknown,
                boxes: shown.iter().map(|object| drawn(object, classes)).collect(),
            });
        }
        Ok(is_read)
    }

    fn needs_points(&self) -> bool {
        true
    }
}

fn is_unknown(object: &Object) -> bool {
    object.kind == ObjectKind::Unknown as u32
}

fn label<'a>(object: &Object, classes: &'a [String]) -> &'a str {
    if is_unknown(object) {
        return "UNKNOWN";
    }
    classes.get(object.class_id as usize).map_or("?", String::as_str)
}

fn describe(object: &Object, classes: &[String]) -> String {
    let ([x, y, z], [l, w, h]) = (object.center_m, object.size_m);
    format!(
        "{:11} score {:4.2}  at {x:6.1} {y:6.1} {z:5.1} m  size {l:4.1} x {w:3.1} x {h:3.1} m  heading {:4.0} deg  {:5} points",
        label(object, classes),
        object.score,
        object.yaw_rad.to_degrees(),
        object.points_count,
    )
}

fn drawn(object: &Object, classes: &[String]) -> DrawnBox {
    let label = label(object, classes);
    DrawnBox {
        box_in_sensor: Box3::from_f32(object.center_m, object.size_m, object.yaw_rad),
        kind: [BoxKind::Known, BoxKind::Unknown][usize::from(is_unknown(object))],
        label: label.to_lowercase(),
        caption: format!("{label} {:.2}", object.score),
    }
}
