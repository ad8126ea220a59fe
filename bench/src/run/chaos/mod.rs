//! `mluc-bench chaos`: stages of a real pipeline are killed and stopped at any moment, pairs and start-up included; supervisors
//! are killed and followed at once; two signals end a run. What comes out is compared with a run in which nothing happened.

mod pipeline;

use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Args;
use mluc::bundled::BundledScans;
use mluc_geometry::{Random, quantile_of};
use mluc_ipc_types::Stage;
use rustix::process::{Signal, kill_process};

use super::plan::mluc_program;
use pipeline::{Pipeline, Reference, Start, reference};

/// The deadlines of the pipeline that is hit: a stage that is stopped while it starts waits no 30 s.
const CONFIG: &str = "[stages.ingest]\nstart_max_ms = 3000\n[stages.backbone]\nstart_max_ms = 3000\n\
    [stages.head]\nstart_max_ms = 3000\n[stages.refiner]\nstart_max_ms = 3000\n";
/// A pipeline that gives no line for so long is given up.
const PATIENCE: Duration = Duration::from_secs(60);

#[derive(Args, Clone, Debug)]
pub(crate) struct ChaosArgs {
    /// Kills and stops stages for so long.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Of the random choices.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Hits each stage alone, and never at its start.
    #[arg(long)]
    single: bool,
    /// Stops no stage.
    #[arg(long)]
    no_stops: bool,
    /// Kills so many supervisors, each followed by a start at once.
    #[arg(long, default_value_t = 0)]
    starts: u32,
    /// Ends so many runs by two signals; some while they start, in some a stage is killed or stopped between the two.
    #[arg(long, default_value_t = 0)]
    signals: u32,
    /// This program in the refiner's place, with its arguments: "python3 refiner.py".
    #[arg(long, value_name = "COMMAND")]
    refiner: Option<String>,
}

pub(crate) fn chaos(args: &ChaosArgs) -> Result<ExitCode> {
    let folder = tempfile::tempdir().context("making a folder")?;
    let config = folder.path().join("chaos.toml");
    let words = |command: &String| command.split(' ').map(str::to_string).collect::<Vec<_>>();
    let command = args.refiner.as_ref().map(words);
    let command = command.map_or(String::new(), |words| format!("command = {words:?}\n"));
    std::fs::write(&config, format!("{CONFIG}{command}")).context("writing a configuration")?;
    let bundled = BundledScans::write("chaos")?;
    let start = Start {
        program: mluc_program()?,
        input: bundled.folder().to_path_buf(),
        config,
        instance: format!("chaos-{}", std::process::id()),
    };
    let reference = reference(&start)?;
    let mut random = Random::new(args.seed, &[]);
    let mut is_good = true;
    if args.seconds > 0.0 {
        is_good &= hits(args, &start, &reference, &mut random)?;
    }
    if args.starts > 0 {
        is_good &= starts(args.starts, &start, &reference, &mut random)?;
    }
    if args.signals > 0 {
        is_good &= signals(args, &start, &reference, &mut random)?;
    }
    println!("{}", if is_good { "all good" } else { "NOT good" });
    Ok(ExitCode::from(u8::from(!is_good)))
}

/// What is done to stages at one moment.
struct Hit {
    stages: Vec<Stage>,
    signal: Signal,
    /// The first one again, after so long: at its start. By this signal.
    again: Option<(Duration, Signal)>,
}

impl Hit {
    fn draw(args: &ChaosArgs, random: &mut Random) -> Hit {
        let [first, second] = [0, 1].map(|_| Stage::ALL[random.below(4)]);
        let is_pair = !args.single && random.unit() < 0.3;
        let is_again = !args.single && random.unit() < 0.3;
        let is_stop = !args.no_stops && random.unit() < 0.3;
        let after = Duration::from_secs_f64(random.uniform(0.0, 0.2));
        let is_stop_at_start = !args.no_stops && random.unit() < 0.1;
        let again = if is_stop_at_start {
            Signal::STOP
        } else {
            Signal::KILL
        };
        let mut stages = vec![first];
        stages.extend((is_pair && second != first).then_some(second));
        Hit {
            stages,
            signal: if is_stop { Signal::STOP } else { Signal::KILL },
            again: (is_again && !is_stop).then_some((after, again)),
        }
    }

    fn row(&self) -> String {
        if self.signal == Signal::STOP {
            return "stopped".to_string();
        }
        match (&self.stages[..], self.again) {
            (_, Some((_, Signal::STOP))) => "killed, and stopped at its start".to_string(),
            (_, Some(_)) => "killed, and again at its start".to_string(),
            ([stage], None) => format!("{} killed", stage.name()),
            _ => "two killed".to_string(),
        }
    }
}

/// Hits stages at random moments. A recovery is from the last signal to the next line whose frame passed the stages after it.
fn hits(
    args: &ChaosArgs,
    start: &Start,
    reference: &Reference,
    random: &mut Random,
) -> Result<bool> {
    let options = "--pace sensor --loop --rate 10";
    let mut pipeline = Pipeline::start(start, options)?;
    let mut recoveries: Vec<(String, f64)> = vec![];
    let mut count = 0;
    let first = pipeline.line_within(PATIENCE, reference)?;
    ensure!(first.is_some(), "no line came");
    let begun = Instant::now();
    while begun.elapsed().as_secs_f64() < args.seconds {
        let calm_until = Instant::now() + Duration::from_secs_f64(random.uniform(0.0, 1.0));
        while let Some(left) = calm_until.checked_duration_since(Instant::now()) {
            pipeline.line_within(left, reference)?;
        }
        let hit = Hit::draw(args, random);
        let mut at = None;
        for stage in &hit.stages {
            at = send(&pipeline, *stage, hit.signal, &mut count).or(at);
        }
        if let Some((after, signal)) = hit.again {
            std::thread::sleep(after);
            at = send(&pipeline, hit.stages[0], signal, &mut count).or(at);
        }
        let Some(at) = at else { continue };
        // What was past the stage before the signal is no recovery.
        let line = loop {
            let line = pipeline.line_within(PATIENCE, reference)?;
            let line = line.context("no line for a minute after a hit")?;
            if line.passed_after(at, &hit.stages) {
                break line;
            }
        };
        let took_ms = (line.at - at).as_secs_f64() * 1e3;
        recoveries.push((hit.row(), took_ms));
    }
    pipeline.signal(Signal::TERM);
    let end = pipeline.end();
    pipeline.drain(reference);
    println!(
        "{count} signals in {:.0} s; from the last one of a hit to the next line through its stages, ms:",
        args.seconds
    );
    table(&recoveries);
    let (received, skipped) = (pipeline.received, pipeline.skipped);
    let [frames_in, out, lost, under_way] = end.frames.unwrap_or_default();
    println!(
        "frames: {frames_in} in, {out} out, {lost} dropped, {under_way} under way; lines {received}, gaps {skipped}"
    );
    println!(
        "wrong or mixed frames: {}; files left: {}; exit code: {:?}",
        pipeline.wrong, end.files_left, end.code
    );
    let is_counted = frames_in == out + lost + under_way && out == received && lost == skipped;
    let is_clean = pipeline.wrong == 0 && end.files_left == 0 && end.code == Some(0);
    Ok(is_counted && is_clean)
}

/// When the signal was sent; `None`: the stage does not run.
fn send(pipeline: &Pipeline, stage: Stage, signal: Signal, count: &mut u32) -> Option<Instant> {
    let pid = pipeline.stage(stage)?;
    let at = Instant::now();
    kill_process(pid, signal).ok()?;
    *count += 1;
    Some(at)
}

/// Count, p50, p99 and max of each row.
fn table(values: &[(String, f64)]) {
    let mut rows: Vec<&String> = values.iter().map(|(row, _)| row).collect();
    rows.sort();
    rows.dedup();
    println!(
        "{:32} {:>6} {:>8} {:>8} {:>8}",
        "", "count", "p50", "p99", "max"
    );
    for row in rows {
        let of_row = values.iter().filter(|(name, _)| name == row);
        let ms: Vec<f64> = of_row.map(|(_, ms)| *ms).collect();
        let quantile = |q| quantile_of(ms.clone(), q).unwrap_or_default();
        let [p50, p99, max] = [0.5, 0.99, 1.0].map(quantile);
        println!("{row:32} {:6} {p50:8.0} {p99:8.0} {max:8.0}", ms.len());
    }
}

/// Kills supervisors, and starts the next at once: its frames begin at 0 and are its own.
fn starts(count: u32, start: &Start, reference: &Reference, random: &mut Random) -> Result<bool> {
    let (mut took, mut wrong) = (vec![], 0);
    let mut pipeline = Pipeline::start(start, "--pace complete --loop")?;
    for _ in 0..count {
        // Up to a second: in its start, or while frames flow.
        let life = Instant::now() + Duration::from_secs_f64(random.uniform(0.0, 1.0));
        while let Some(left) = life.checked_duration_since(Instant::now()) {
            pipeline.line_within(left, reference)?;
        }
        pipeline.signal(Signal::KILL);
        let at = Instant::now();
        let next = Pipeline::start(start, "--pace complete --loop")?;
        wrong += pipeline.wrong;
        pipeline = next;
        if random.unit() < 0.5 {
            let line = pipeline.line_within(PATIENCE, reference)?;
            let line = line.context("no line for a minute after a start")?;
            took.push((
                "start to the first line".to_string(),
                (line.at - at).as_secs_f64() * 1e3,
            ));
            wrong += u64::from(line.sequence != 0);
        }
    }
    let last = pipeline.line_within(PATIENCE, reference)?;
    pipeline.signal(Signal::TERM);
    let end = pipeline.end();
    println!("{count} supervisors killed, each followed at once, ms:");
    table(&took);
    println!(
        "wrong or mixed frames: {wrong}; files left: {}; exit code: {:?}",
        end.files_left, end.code
    );
    Ok(last.is_some() && wrong == 0 && end.files_left == 0 && end.code == Some(0))
}

/// Two signals 0 to 500 ms apart, to runs that are at work or still start; in some a stage is hit between the two.
fn signals(
    args: &ChaosArgs,
    start: &Start,
    reference: &Reference,
    random: &mut Random,
) -> Result<bool> {
    let count = args.signals;
    let (mut bad, mut hits, mut longest_ms) = (0, 0, 0.0f64);
    for _ in 0..count {
        let mut pipeline = Pipeline::start(start, "--pace complete --loop")?;
        let is_starting = random.unit() < 0.3;
        if is_starting {
            pipeline.wait_for_a_stage()?;
        } else {
            let first = pipeline.line_within(PATIENCE, reference)?;
            ensure!(first.is_some(), "no line for a minute");
        }
        let hit = Hit::draw(args, random);
        let is_hit = random.unit() < 0.5;
        let [one, two] = [0, 1].map(|_| [Signal::INT, Signal::TERM][random.below(2)]);
        let gap_ms = random.uniform(0.0, 500.0) * f64::from(u8::from(random.unit() < 0.8));
        pipeline.signal(one);
        let begun = Instant::now();
        if is_hit {
            let at_ms = random.uniform(0.0, gap_ms.min(50.0));
            std::thread::sleep(Duration::from_secs_f64(at_ms * 1e-3));
            for stage in &hit.stages {
                send(&pipeline, *stage, hit.signal, &mut hits);
            }
        }
        let gap = Duration::from_secs_f64(gap_ms * 1e-3);
        std::thread::sleep(gap.saturating_sub(begun.elapsed()));
        pipeline.signal(two);
        let end = pipeline.end();
        let is_good = end.code == Some(0) && end.frames.is_some() && end.files_left == 0;
        longest_ms = longest_ms.max(1e3 * begun.elapsed().as_secs_f64());
        if !is_good {
            bad += 1;
            println!(
                "{one:?}, {gap_ms:.0} ms, {two:?}, starting {is_starting}, stages hit {is_hit}: code {:?}, {} files left\n{}",
                end.code, end.files_left, end.log
            );
        }
    }
    println!(
        "{count} runs ended by two signals, {hits} stages hit meanwhile: {bad} badly; the longest end took {longest_ms:.0} ms"
    );
    Ok(bad == 0)
}
