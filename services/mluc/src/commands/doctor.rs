//! `mluc doctor`: whether this machine can run the pipeline and the model takes the input, and what to do if not.

mod input;

use self::Verdict::{Failure, Fine, Warning};
use crate::{EXIT_FAILURE, UsageError, terminal::print_out};
use crate::{cli::DoctorArgs, external::external, model, piped::Piped, settings::StageSettings};
use mluc_backbone::Precision;
use mluc_ingest::Expected;
use mluc_ipc_types::{
    DETECTIONS_MAX, OBJECT_POINTS_MAX, OBJECTS_MAX, POINTS_MAX, Topic, WIRE_VERSION, feature_blocks,
};
use mluc_kernels::Level;
use mluc_model::{Model, SensorProfile};
use mluc_runtime::{Instance, log_to_stderr};
use mluc_sources::{Open, Source, ros2_topic};
use rustix::process::{Resource, getrlimit};
use std::{fs, process::ExitCode};

/// A pipeline makes a few hundred files in shared memory; a process of it has at most as many open.
const FILES_MIN: u64 = 1000;

/// The verdict of a check, and its text.
type Finding = (Verdict, String);

#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Fine,
    Warning,
    Failure,
}

/// `open`: opens the input, for a program that knows more inputs than `mluc`.
pub fn doctor(args: &DoctorArgs, open: Option<Open>) -> anyhow::Result<ExitCode> {
    if open.is_none() && args.input.as_deref().and_then(ros2_topic).is_some() {
        return external("mluc-ros2", &["doctor"]);
    }
    log_to_stderr("doctor", "warn");
    let loaded = model::load(&args.model);
    let about_model = match &loaded {
        Ok(model) => describe_model(model, &args.model),
        Err(error) => (Failure, format!("{error:#}")),
    };
    let instances = check_instances();
    let about_memory = check_shared_memory(loaded.as_ref().ok(), !instances.is_empty());
    let about_cpu = check_processor(loaded.as_ref().ok());
    let version = env!("CARGO_PKG_VERSION");
    let version = format!("mluc {version}, wire version {WIRE_VERSION}");
    let mut findings = vec![
        (Fine, version),
        about_model,
        about_memory,
        check_cores(),
        about_cpu,
        check_governor(),
        check_rights(),
        check_open_files(getrlimit(Resource::Nofile).current),
    ];
    findings.extend(instances);
    let mut input = args.input.clone();
    let _piped = Piped::take(&mut input)?;
    if let (Some(input), Ok(model)) = (&input, &loaded) {
        let sensor = args.sensor.as_deref().map(SensorProfile::load).transpose();
        let sensor = sensor.map_err(|error| UsageError(error.to_string()))?;
        let expected = Expected::new(&model.manifest, sensor);
        let (layout, open) = (args.layout.layout()?, open.unwrap_or(Source::open));
        let told = input::findings(input, &layout, &expected, open);
        findings.extend(told.unwrap_or_else(|error| vec![(Failure, format!("{error:#}"))]));
    }
    for (verdict, text) in &findings {
        let word = match verdict {
            Fine => "fine",
            Warning => "warning",
            Failure => "FAILURE",
        };
        print_out(format_args!("{word:8} {text}"))?;
    }
    let has_failed = findings.iter().any(|(verdict, _)| *verdict == Failure);
    Ok(ExitCode::from(if has_failed { EXIT_FAILURE } else { 0 }))
}

fn describe_model(model: &Model, name: &str) -> Finding {
    let architecture = &model.manifest.network.profile;
    let (classes, fingerprint) = (model.manifest.class_names().join(", "), model.fingerprint);
    let text =
        format!("model {name} ({architecture}), classes {classes}, fingerprint {fingerprint:016x}");
    if model.manifest.provenance.steps == 0 {
        let hint = "take a model that ships with mluc (--model), or train it with `mluc-lab train`";
        return (Warning, format!("{text}: it was never trained: {hint}"));
    }
    (Fine, text)
}

/// Bytes of all topics when every slot is in use.
fn needed_bytes(model: &Model) -> u64 {
    let network = &model.manifest.network;
    let cells = network.map_shape().iter().product();
    let blocks = feature_blocks(cells, network.feature_channels(), network.ground_nodes());
    let pools = [
        (Topic::POINTS, POINTS_MAX),
        (Topic::FEATURES, blocks),
        (Topic::DETECTIONS, DETECTIONS_MAX),
        (Topic::OBJECTS, OBJECTS_MAX),
        (Topic::OBJECT_POINTS, OBJECT_POINTS_MAX),
    ];
    let bytes = pools.map(|(topic, elements)| topic.slots() * elements * topic.element_bytes);
    // And small topics, and two copies of the model during a reload.
    bytes.iter().sum::<usize>() as u64 + (16 << 20)
}

/// `is_used`: there are files of an instance.
fn check_shared_memory(model: Option<&Model>, is_used: bool) -> Finding {
    let Ok(about) = rustix::fs::statvfs("/dev/shm") else {
        return (Failure, "/dev/shm is missing: mount a tmpfs there".into());
    };
    let [free_mib, all_mib] =
        [about.f_bavail, about.f_blocks].map(|blocks| (blocks * about.f_frsize) >> 20);
    let text = format!("/dev/shm: {free_mib} of {all_mib} MiB free");
    let Some(model) = model else {
        return (Fine, text);
    };
    if about.f_files > 0 && about.f_favail < FILES_MIN {
        let hint = "remove files there, or mount it with a larger nr_inodes";
        return (Failure, format!("{text}, but no more files: {hint}"));
    }
    let needed_mib = needed_bytes(model).div_ceil(1 << 20);
    let text = format!("{text}, this model needs {needed_mib} MiB");
    if free_mib >= needed_mib || all_mib == 0 {
        return (Fine, text);
    }
    if is_used && all_mib >= needed_mib {
        return (Warning, format!("{text}: the instances below use a part of it"));
    }
    let hint = "make it larger (in a container: --shm-size)";
    (Failure, format!("{text}: {hint}"))
}

fn check_cores() -> Finding {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split_whitespace().next();
    let load: f64 = load.and_then(|word| word.parse().ok()).unwrap_or(0.0);
    let text = format!("{cores} cores, load {load:.1}");
    if cores < 2 {
        return (Warning, format!("{text}: 10 Hz needs two"));
    }
    if load >= cores as f64 {
        return (Warning, format!("{text}: other work will delay frames"));
    }
    (Fine, text)
}

fn check_governor() -> Finding {
    let path = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
    match fs::read_to_string(path).as_deref().map(str::trim) {
        Err(_) => (Fine, "CPU governor: not readable here".into()),
        Ok("performance") => (Fine, "CPU governor: performance".into()),
        Ok(other) => {
            let hint = "`performance` makes latency even";
            (Warning, format!("CPU governor: {other}; {hint}"))
        }
    }
}

/// The instruction set of the processor, and the precision that the default, `auto`, chooses there for this model.
fn check_processor(model: Option<&Model>) -> Finding {
    let level = Level::best().name();
    if level == "portable" {
        let hint = "every precision is slow: use a processor with AVX2 and FMA, or NEON";
        return (Warning, format!("processor: {level}: {hint}"));
    }
    let chosen = model.map(|model| Precision::Auto.chosen(&model.manifest, &model.weights));
    let chosen = chosen.map(|(precision, why)| format!("; precision {precision}: {why}"));
    let chosen = chosen.unwrap_or_default();
    (Fine, format!("processor: {level}{chosen}"))
}

/// The rights of this user: real-time priority and locked memory.
fn check_rights() -> Finding {
    let limit = |resource| getrlimit(resource).current;
    let memory = match limit(Resource::Memlock) {
        Some(bytes) => format!("{} KiB", bytes >> 10),
        None => "any".to_string(),
    };
    let text = format!("locked memory (ulimit -l): {memory}");
    let stage = StageSettings { priority: Some(1), ..StageSettings::default() };
    if let Err(error) = stage.check_right("a stage") {
        let hint = "without it other work delays frames";
        return (Warning, format!("{error}; {hint}; {text}"));
    }
    let most = limit(Resource::Rtprio).filter(|most| *most > 0);
    let most = most.map_or("any".to_string(), |most| most.to_string());
    let text = format!("real-time priority (ulimit -r): {most}; {text}");
    (Fine, text)
}

/// `most`: the limit of open files; `None`: no limit.
fn check_open_files(most: Option<u64>) -> Finding {
    let count = most.map_or("any number".to_string(), |most| most.to_string());
    let text = format!("open files (ulimit -n): {count}");
    if most.is_none_or(|most| most >= FILES_MIN) {
        return (Fine, text);
    }
    let hint = format!("a stage may fail to open shared memory: `ulimit -n {FILES_MIN}` or more");
    (Warning, format!("{text}; {hint}"))
}

/// Instances without a process, running instances and their version, and files that belong to no instance.
fn check_instances() -> Vec<Finding> {
    let stem = format!("mluc-{}-", rustix::process::geteuid().as_raw());
    let entries = fs::read_dir("/dev/shm").into_iter().flatten().flatten();
    let own = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&stem));
    let (folders, files): (Vec<_>, Vec<_>) = own.partition(|entry| entry.path().is_dir());
    let names = folders.into_iter().map(|entry| entry.file_name());
    let names: Vec<_> = names.filter_map(|name| name.into_string().ok()).collect();
    let found = names.iter().filter_map(|name| check_instance(name.strip_prefix(&stem)?));
    let mut found: Vec<Finding> = found.collect();
    // A segment is named after its instance.
    let is_lost = |file: &fs::DirEntry| {
        let file = file.file_name();
        let (file, mut names) = (file.to_string_lossy(), names.iter());
        let is_more = |rest: &str| rest.starts_with('.');
        !names.any(|name| file.strip_prefix(name).is_some_and(is_more))
    };
    let lost = files.iter().filter(|file| is_lost(file)).count();
    if lost > 0 {
        let text = format!("/dev/shm has {lost} files {stem}* of no instance");
        let hint = "remove them when no pipeline runs";
        found.push((Warning, format!("{text}: {hint}")));
    }
    found
}

fn check_instance(name: &str) -> Option<Finding> {
    let instance = Instance::new(name).ok()?;
    let lock = fs::File::open(instance.root().join(".lock")).ok()?;
    if lock.try_lock().is_ok() {
        let text = format!(
            "instance '{name}' left files after a crash: the next `mluc up --instance {name}` removes them"
        );
        return Some((Warning, text));
    }
    let contract = fs::read_to_string(instance.root().join("contract")).ok()?;
    let own = format!("wire={WIRE_VERSION}");
    let is_own = contract.split_whitespace().any(|word| word == own);
    let other = ": this mluc cannot join it; stop it, or run the same mluc on both sides";
    let (verdict, hint) = if is_own { (Fine, "") } else { (Warning, other) };
    let text = format!("instance '{name}' runs ({}){hint}", contract.trim());
    Some((verdict, text))
}
