//! `mluc doctor`: whether this machine can run the pipeline, and what to do if not.

use std::fs;
use std::path::Path;
use std::process::ExitCode;

use mluc_ipc_types::{
    DETECTIONS_MAX, OBJECT_POINTS_MAX, OBJECTS_MAX, POINTS_MAX, Topic, feature_blocks,
};
use mluc_model::Model;
use mluc_runtime::Instance;

use crate::EXIT_FAILURE;
use crate::cli::DoctorArgs;
use crate::model;
use crate::terminal::print_out;

/// How a check came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Fine,
    Warning,
    Failure,
}

struct Finding {
    verdict: Verdict,
    text: String,
}

fn finding(verdict: Verdict, text: impl Into<String>) -> Finding {
    Finding {
        verdict,
        text: text.into(),
    }
}

pub(crate) fn doctor(args: DoctorArgs) -> anyhow::Result<ExitCode> {
    let loaded = model::load(&args.model);
    let mut findings = vec![match &loaded {
        Ok(model) => describe_model(model),
        Err(error) => finding(Verdict::Failure, format!("{error:#}")),
    }];
    findings.push(check_shared_memory(loaded.as_ref().ok()));
    findings.push(check_cores());
    findings.push(check_governor());
    findings.extend(check_leftovers());
    for found in &findings {
        let word = match found.verdict {
            Verdict::Fine => "fine",
            Verdict::Warning => "warning",
            Verdict::Failure => "FAILURE",
        };
        print_out(format_args!("{word:8} {}", found.text))?;
    }
    let is_failure = |found: &Finding| found.verdict == Verdict::Failure;
    Ok(if findings.iter().any(is_failure) {
        ExitCode::from(EXIT_FAILURE)
    } else {
        ExitCode::SUCCESS
    })
}

fn describe_model(model: &Model) -> Finding {
    let manifest = &model.manifest;
    let text = format!(
        "model {} ({}), classes {}, fingerprint {:016x}",
        manifest.name,
        manifest.network.profile,
        model::class_names(model).join(", "),
        model.fingerprint
    );
    if manifest.provenance.steps == 0 {
        return finding(Verdict::Warning, format!("{text}: it was never trained"));
    }
    finding(Verdict::Fine, text)
}

/// What all topics take when every slot is in use.
fn needed_bytes(model: &Model) -> u64 {
    let network = &model.manifest.network;
    let cells = network.map_shape().iter().product();
    let blocks = feature_blocks(cells, network.feature_channels());
    let pools = [
        (Topic::POINTS, POINTS_MAX),
        (Topic::FEATURES, blocks),
        (Topic::DETECTIONS, DETECTIONS_MAX),
        (Topic::OBJECTS, OBJECTS_MAX),
        (Topic::OBJECT_POINTS, OBJECT_POINTS_MAX),
    ];
    pools
        .iter()
        .map(|(topic, elements)| (topic.slots() * elements * topic.element_bytes) as u64)
        .sum()
}

fn check_shared_memory(model: Option<&Model>) -> Finding {
    let Ok(about) = rustix::fs::statvfs("/dev/shm") else {
        return finding(Verdict::Failure, "/dev/shm is missing: mount a tmpfs there");
    };
    let free_mib = (about.f_bavail * about.f_frsize) >> 20;
    let Some(model) = model else {
        return finding(Verdict::Fine, format!("/dev/shm: {free_mib} MiB free"));
    };
    let needed_mib = needed_bytes(model).div_ceil(1 << 20);
    let text = format!("/dev/shm: {free_mib} MiB free, this model needs {needed_mib} MiB");
    if free_mib >= needed_mib {
        return finding(Verdict::Fine, text);
    }
    let advice = "make it larger (in a container: --shm-size)";
    finding(Verdict::Failure, format!("{text}: {advice}"))
}

fn check_cores() -> Finding {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load: f64 = load
        .split_whitespace()
        .next()
        .and_then(|word| word.parse().ok())
        .unwrap_or(0.0);
    let text = format!("{cores} cores, load {load:.1}");
    match (cores >= 2, load < cores as f64) {
        (true, true) => finding(Verdict::Fine, text),
        (false, _) => finding(Verdict::Warning, format!("{text}: 10 Hz needs two")),
        _ => finding(
            Verdict::Warning,
            format!("{text}: other work will delay frames"),
        ),
    }
}

fn check_governor() -> Finding {
    let path = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
    match fs::read_to_string(path).as_deref().map(str::trim) {
        Err(_) => finding(Verdict::Fine, "CPU frequency is not ours to see"),
        Ok("performance") => finding(Verdict::Fine, "CPU governor: performance"),
        Ok(other) => finding(
            Verdict::Warning,
            format!("CPU governor: {other}; `performance` makes latency even"),
        ),
    }
}

/// Folders of instances in which nobody lives.
fn check_leftovers() -> Vec<Finding> {
    let stem = format!("mluc-{}-", rustix::process::geteuid().as_raw());
    let entries = fs::read_dir("/dev/shm").into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| {
        let name = entry.file_name().into_string().ok()?;
        entry
            .path()
            .is_dir()
            .then(|| name.strip_prefix(&stem).map(str::to_string))?
    });
    names.filter_map(|name| leftover(&name)).collect()
}

fn leftover(name: &str) -> Option<Finding> {
    use rustix::fs::{FlockOperation, flock};
    let instance = Instance::new(name).ok()?;
    let lock = fs::File::open(Path::new(instance.root()).join(".lock")).ok()?;
    let is_alone = flock(&lock, FlockOperation::NonBlockingLockExclusive).is_ok();
    is_alone.then(|| {
        finding(
            Verdict::Warning,
            format!("instance '{name}' left files after a crash: the next `mluc up --instance {name}` removes them"),
        )
    })
}
