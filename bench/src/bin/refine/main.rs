//! How good and how fast a refiner is on labelled scans, without a network: simulated proposals around each labelled
//! object, the refined box against the label. `--json` prints one object for a program.

mod ceiling;
mod proposals;
mod scene;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::Parser;
use mluc_geometry::{Box3, iou_3d};
use mluc_lab::dataset::Dataset;
use mluc_refiner::{FrameIndex, Mode, Refined, Refiner, Settings};
use serde::Serialize;

use proposals::{Random, candidate, proposal};
use scene::Frame;

/// Proposals for each labelled object.
const PROPOSALS_PER_OBJECT: u64 = 8;
/// Timed passes over the folder, after one that is not.
const PASSES: u64 = 5;

/// Quality and time of a refiner on a folder of labelled scans.
#[derive(Parser)]
struct Arguments {
    /// Folder in KITTI's layout: velodyne, label_2, calib.
    #[arg(long)]
    dataset: PathBuf,
    /// literal, corrected, distance, dbscan, euclidean or none.
    #[arg(long, default_value = "distance")]
    refiner: String,
    /// Settings of the refiner as JSON, for experiments: '{"distance":{"join_m":0.5}}'.
    #[arg(long)]
    settings: Option<String>,
    /// Proposals a frame in the timing part.
    #[arg(long, default_value_t = 20)]
    proposals: usize,
    /// Timing at random points of the scan instead of at the labelled objects: dearer, walls and bushes are large.
    #[arg(long)]
    anywhere: bool,
    /// Threads of the pool around it; the refiner works in one.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

#[derive(Default, Serialize)]
struct Quality {
    objects: usize,
    mean_iou_3d: f64,
    share_above_0_1: f64,
    share_above_0_3: f64,
    share_above_0_5: f64,
    ceiling_mean_iou_3d: f64,
}

#[derive(Serialize)]
struct Report {
    refiner: &'static str,
    frames: usize,
    #[serde(flatten)]
    all: Quality,
    by_class: BTreeMap<String, Quality>,
    proposals: usize,
    timed_frames: usize,
    p50_ms: f64,
    p99_ms: f64,
    max_ms: f64,
    /// The same by the thread's own CPU time: what remains comparable on a machine with other work.
    cpu_p50_ms: f64,
    cpu_p99_ms: f64,
}

/// All figures of one labelled object.
struct Judged {
    class: String,
    ious: Vec<f64>,
    ceiling: f64,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let Some(mode) = Mode::from_name(&arguments.refiner) else {
        let names: Vec<_> = Mode::ALL.iter().map(|mode| mode.name()).collect();
        bail!("refiner {}: expected one of {names:?}", arguments.refiner);
    };
    let mut settings: Settings = match &arguments.settings {
        Some(text) => serde_json::from_str(text).context("--settings")?,
        None => Settings::default(),
    };
    settings.mode = mode;
    let frames = scene::read(&Dataset::open(&arguments.dataset)?)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .build()?;
    let report = pool.install(|| measure(&frames, settings, &arguments))?;
    match arguments.json {
        true => println!("{}", serde_json::to_string(&report)?),
        false => print_table(&report),
    }
    Ok(())
}

fn measure(frames: &[Frame], settings: Settings, arguments: &Arguments) -> Result<Report> {
    let mode = settings.mode;
    let mut refiner = Refiner::new(settings, &scene::sensor())?;
    let judged = judge(frames, &mut refiner);
    let mut classes: BTreeMap<String, Vec<&Judged>> = BTreeMap::new();
    for object in &judged {
        classes
            .entry(object.class.clone())
            .or_default()
            .push(object);
    }
    let proposals = arguments.proposals;
    let times = time(frames, &mut refiner, proposals, arguments.anywhere);
    let cpu_ms = sorted(times.iter().map(|time| time.cpu_ms).collect());
    let times_ms = sorted(times.iter().map(|time| time.wall_ms).collect());
    let at = |values: &[f64], share: f64| {
        let last = values.len().saturating_sub(1);
        values
            .get((last as f64 * share).round() as usize)
            .copied()
            .unwrap_or(0.0)
    };
    Ok(Report {
        refiner: mode.name(),
        frames: frames.len(),
        all: quality(&judged.iter().collect::<Vec<_>>()),
        by_class: classes
            .into_iter()
            .map(|(class, objects)| (class, quality(&objects)))
            .collect(),
        proposals,
        timed_frames: times_ms.len(),
        p50_ms: at(&times_ms, 0.5),
        p99_ms: at(&times_ms, 0.99),
        max_ms: at(&times_ms, 1.0),
        cpu_p50_ms: at(&cpu_ms, 0.5),
        cpu_p99_ms: at(&cpu_ms, 0.99),
    })
}

/// Each proposal alone: what is judged is the box, not who suppresses whom.
fn judge(frames: &[Frame], refiner: &mut Refiner) -> Vec<Judged> {
    let mut out = Refined::default();
    let mut index = FrameIndex::default();
    let height_m = scene::sensor().height_m;
    let mut judged = Vec::new();
    for (f, frame) in frames.iter().enumerate() {
        for (o, object) in frame.objects.iter().enumerate() {
            let ious = (0..PROPOSALS_PER_OBJECT)
                .map(|k| {
                    let mut random = Random::keyed([f as u64, o as u64, k]);
                    let proposed = proposal(&object.class, &object.shape, &mut random);
                    let detections = [candidate(&proposed, 1.0)];
                    refiner.refine(f as u64 * 8 + k, &frame.points, &detections, &mut out);
                    let published = out.objects.iter().find(|found| found.is_published());
                    published.map_or(0.0, |found| iou_3d(&box_of(found), &object.shape))
                })
                .collect();
            judged.push(Judged {
                class: object.class.clone(),
                ious,
                ceiling: ceiling::ceiling(&frame.points, &object.shape, &mut index, height_m),
            });
        }
    }
    judged
}

fn box_of(object: &mluc_ipc_types::Object) -> Box3 {
    Box3 {
        center_m: object.center_m.map(f64::from),
        size_m: object.size_m.map(f64::from),
        yaw_rad: f64::from(object.yaw_rad),
    }
}

fn quality(objects: &[&Judged]) -> Quality {
    let ious: Vec<f64> = objects
        .iter()
        .flat_map(|o| o.ious.iter().copied())
        .collect();
    let mean = |values: &mut dyn Iterator<Item = f64>, count: usize| {
        values.sum::<f64>() / count.max(1) as f64
    };
    let above = |least: f64| {
        ious.iter().filter(|&&iou| iou > least).count() as f64 / ious.len().max(1) as f64
    };
    Quality {
        objects: objects.len(),
        mean_iou_3d: mean(&mut ious.iter().copied(), ious.len()),
        share_above_0_1: above(0.1),
        share_above_0_3: above(0.3),
        share_above_0_5: above(0.5),
        ceiling_mean_iou_3d: mean(&mut objects.iter().map(|o| o.ceiling), objects.len()),
    }
}

/// One frame.
struct Timed {
    wall_ms: f64,
    cpu_ms: f64,
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// The CPU time that this thread has used, ms.
fn cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
}

/// Times of whole frames with so many candidates: at the labelled objects in turn, or wherever random points of the scan
/// lie.
fn time(frames: &[Frame], refiner: &mut Refiner, proposals: usize, anywhere: bool) -> Vec<Timed> {
    let mut out = Refined::default();
    let mut times = Vec::new();
    for pass in 0..=PASSES {
        let frames = frames.iter().enumerate();
        for (f, frame) in frames.filter(|(_, f)| !f.points.is_empty()) {
            let detections: Vec<_> = (0..proposals)
                .map(|k| {
                    let mut random = Random::keyed([f as u64, k as u64, 1000 + pass]);
                    let proposed = match frame.objects.len() {
                        count if count > 0 && !anywhere => {
                            let object = &frame.objects[k % count];
                            proposal(&object.class, &object.shape, &mut random)
                        }
                        _ => proposal("", &random_place(frame, &mut random), &mut random),
                    };
                    candidate(&proposed, 1.0 + k as f32)
                })
                .collect();
            let (start, cpu_start_ms) = (Instant::now(), cpu_ms());
            refiner.refine(f as u64, &frame.points, &detections, &mut out);
            if pass > 0 {
                times.push(Timed {
                    wall_ms: start.elapsed().as_secs_f64() * 1e3,
                    cpu_ms: cpu_ms() - cpu_start_ms,
                });
            }
        }
    }
    times
}

/// A box of 1 m at a random point of the scan: mostly walls and bushes near the sensor.
fn random_place(frame: &Frame, random: &mut Random) -> Box3 {
    let p = frame.points[random.below(frame.points.len())];
    Box3 {
        center_m: [p.x_m, p.y_m, p.z_m].map(f64::from),
        size_m: [1.0; 3],
        yaw_rad: 0.0,
    }
}

fn print_table(report: &Report) {
    println!("refiner {}, {} frames", report.refiner, report.frames);
    println!(
        "{:<16} {:>7} {:>9} {:>6} {:>6} {:>6} {:>8}",
        "class", "objects", "mean IoU", ">0.1", ">0.3", ">0.5", "ceiling"
    );
    let rows = report.by_class.iter().map(|(name, q)| (name.as_str(), q));
    for (name, q) in rows.chain([("all", &report.all)]) {
        println!(
            "{name:<16} {:>7} {:>9.3} {:>6.2} {:>6.2} {:>6.2} {:>8.3}",
            q.objects,
            q.mean_iou_3d,
            q.share_above_0_1,
            q.share_above_0_3,
            q.share_above_0_5,
            q.ceiling_mean_iou_3d
        );
    }
    println!(
        "{} proposals a frame: p50 {:.2} ms, p99 {:.2} ms, max {:.2} ms over {} frames; CPU time p50 {:.2} ms, p99 {:.2} ms",
        report.proposals,
        report.p50_ms,
        report.p99_ms,
        report.max_ms,
        report.timed_frames,
        report.cpu_p50_ms,
        report.cpu_p99_ms
    );
}
