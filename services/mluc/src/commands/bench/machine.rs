//! What the pipeline ran on, and what was built.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::UNIX_EPOCH;

use rustix::thread::sched_getaffinity;
use serde_json::{Map, Value, json};

use super::processes::number_of;
use crate::place::usable_cpus;

/// Instruction sets that the kernels choose by.
const FEATURES: [&str; 8] = [
    "avx2",
    "fma",
    "avx512f",
    "avx512_bf16",
    "avx512_vnni",
    "amx_bf16",
    "asimd",
    "bf16",
];

/// Memory that can be had without swapping, MiB.
pub(super) fn available_mib() -> u64 {
    let text = read("/proc/meminfo").unwrap_or_default();
    number_of(&text, "MemAvailable:") / 1024
}

/// Processor, memory, kernel.
pub(super) fn describe_machine() -> Map<String, Value> {
    let cpuinfo = read("/proc/cpuinfo").unwrap_or_default();
    let flags = field(&cpuinfo, "flags")
        .or(field(&cpuinfo, "Features"))
        .unwrap_or_default();
    let words: Vec<&str> = flags.split_whitespace().collect();
    let features: Vec<&str> = FEATURES
        .into_iter()
        .filter(|feature| words.contains(feature))
        .collect();
    let meminfo = read("/proc/meminfo").unwrap_or_default();
    let is_limited = sched_getaffinity(None).is_ok();
    let value = json!({
        "processor": field(&cpuinfo, "model name").or_else(|| field(&cpuinfo, "CPU part").map(|part| format!("part {part}"))),
        "cores_usable": if is_limited { Some(usable_cpus().len()) } else { None },
        "cores_present": cpuinfo.lines().filter(|line| line.starts_with("processor")).count(),
        "instruction_sets": features.join(" "),
        "caches": caches(),
        "memory_mib": number_of(&meminfo, "MemTotal:") / 1024,
        "virtual_machine": words.contains(&"hypervisor"),
        "kernel": read("/proc/sys/kernel/osrelease"),
        "kernel_preemption": read("/proc/sys/kernel/version"),
        "governor": read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").unwrap_or_else(|| "not visible".to_string()),
        "clock_source": read("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        "huge_pages": read("/sys/kernel/mm/transparent_hugepage/enabled"),
        "architecture": std::env::consts::ARCH,
    });
    object(value)
}

/// What was built; two reports with the same `binary` ran the same program.
pub(super) fn describe_build() -> Map<String, Value> {
    let binary = std::env::current_exe()
        .ok()
        .and_then(|path| fs::read(path).ok());
    object(json!({
        "version": env!("CARGO_PKG_VERSION"),
        "commit": commit(),
        "compiler": env!("MLUC_COMPILER"),
        "target": env!("MLUC_TARGET"),
        "profile": env!("MLUC_PROFILE"),
        "binary": binary.map(|bytes| format!("{:016x}", fingerprint(&bytes))),
    }))
}

/// Of what was built: `MLUC_COMMIT` when the build had it set; else, where the sources still lie on this machine, the last
/// commit before the program was built, with `-dirty` when a source changed since that commit and before the build.
fn commit() -> Option<String> {
    if let Some(commit) = option_env!("MLUC_COMMIT") {
        return Some(commit.to_string());
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let built = fs::metadata(std::env::current_exe().ok()?)
        .and_then(|about| about.modified())
        .ok()?;
    let seconds = built.duration_since(UNIX_EPOCH).ok()?.as_secs();
    let before = format!("--before={seconds}");
    let commit = git(&root, &["log", "-1", "--abbrev=12", "--format=%h", &before])?;
    let commit = commit
        .lines()
        .next()
        .filter(|line| !line.is_empty())?
        .to_string();
    let ours = [
        "ipc-types",
        "geometry",
        "kernels",
        "model",
        "services",
        "weights",
        "Cargo.toml",
    ];
    let changed = git(
        &root,
        &[&["diff", "--name-only", &commit, "--"], &ours[..]].concat(),
    )?;
    let is_in_the_build = |name: &&str| {
        let changed = fs::metadata(root.join(name)).and_then(|about| about.modified());
        changed.is_ok_and(|changed| changed <= built)
    };
    Some(match changed.lines().find(is_in_the_build) {
        Some(_) => format!("{commit}-dirty"),
        None => commit,
    })
}

/// What git says, if it is there and content.
fn git(root: &Path, arguments: &[&str]) -> Option<String> {
    let output = Command::new("git")
        .arg("-C")
        .arg(root)
        .args(arguments)
        .output()
        .ok()?;
    output
        .status
        .success()
        .then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

/// FNV-1a over words of 8 bytes.
fn fingerprint(bytes: &[u8]) -> u64 {
    bytes.chunks(8).fold(0xcbf2_9ce4_8422_2325, |hash, chunk| {
        let mut word = [0; 8];
        word[..chunk.len()].copy_from_slice(chunk);
        (hash ^ u64::from_le_bytes(word)).wrapping_mul(0x0100_0000_01b3)
    })
}

fn caches() -> String {
    let of = |index: usize| {
        let folder = format!("/sys/devices/system/cpu/cpu0/cache/index{index}");
        let (level, kind) = (
            read(&format!("{folder}/level"))?,
            read(&format!("{folder}/type"))?,
        );
        let size = read(&format!("{folder}/size"))?;
        let letter = match kind.as_str() {
            "Data" => "d",
            "Instruction" => "i",
            _ => "",
        };
        Some(format!("L{level}{letter} {size}"))
    };
    (0..6).filter_map(of).collect::<Vec<_>>().join(", ")
}

fn field(cpuinfo: &str, key: &str) -> Option<String> {
    let line = cpuinfo.lines().find(|line| {
        line.split(':')
            .next()
            .is_some_and(|name| name.trim() == key)
    })?;
    Some(line.split_once(':')?.1.trim().to_string())
}

/// A small file's text without the line end.
fn read(path: &str) -> Option<String> {
    fs::read_to_string(path)
        .ok()
        .map(|text| text.trim_end().to_string())
}

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_is_described() {
        let machine = describe_machine();
        assert!(machine["memory_mib"].as_u64().unwrap() > 0);
        assert!(machine["cores_usable"].as_u64().unwrap() > 0);
        assert!(machine["kernel"].is_string());
        assert!(available_mib() > 0);
        let build = describe_build();
        assert!(build["compiler"].as_str().unwrap().starts_with("rustc"));
        assert_eq!(build["binary"].as_str().unwrap().len(), 16);
    }

    #[test]
    fn a_changed_byte_is_another_binary() {
        assert_ne!(fingerprint(b"0123456789"), fingerprint(b"0123456788"));
        assert_ne!(fingerprint(b""), fingerprint(b"\0"));
    }
}
