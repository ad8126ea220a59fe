//! The machine that a figure belongs to, and the program that was measured: without them a figure means little.

use mluc::placement::usable_cpus;
use mluc_geometry::{FNV_OFFSET, fnv1a};
use procfs::{CpuInfo, Current, LoadAverage, Meminfo};
use serde_json::{Value, json};
use std::{fs::read_to_string, path::Path, process::Command, time::SystemTime, time::UNIX_EPOCH};

/// Instruction sets that the kernels choose by.
const EXTENSIONS: &str =
    "avx2 fma avx_vnni avx512f avx512_bf16 avx512_vnni amx_bf16 amx_int8 asimd asimddp bf16";
const MIB: u64 = 1 << 20;
/// Folders and files from which the program `mluc` is built.
const SOURCES: &str = "ipc-types geometry kernels model services weights Cargo.toml Cargo.lock";

/// Processor, memory, kernel and time; a value that the system does not report is null.
pub(crate) fn describe_machine() -> Value {
    let cpus = CpuInfo::current().ok();
    let field = |name: &str| cpus.as_ref().and_then(|cpus| cpus.get_field(0, name));
    let flags = field("flags").or(field("Features")).unwrap_or_default();
    let flags: Vec<&str> = flags.split_whitespace().collect();
    let mut extensions: Vec<&str> = EXTENSIONS.split(' ').collect();
    extensions.retain(|extension| flags.contains(extension));
    let part = || field("CPU part").map(|part| format!("part {part}"));
    let time = SystemTime::now().duration_since(UNIX_EPOCH);
    json!({
        "processor": field("model name").map(str::to_string).or_else(part),
        "cores_usable": usable_cpus().len(),
        "cores_present": cpus.as_ref().map_or(0, CpuInfo::num_cores),
        "instruction_sets": extensions.join(" "),
        "memory_mib": Meminfo::current().map_or(0, |memory| memory.mem_total / MIB),
        "virtual_machine": flags.contains(&"hypervisor"),
        "kernel": text_of("/proc/sys/kernel/osrelease"),
        "governor": text_of("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").unwrap_or_else(|| "not visible".to_string()),
        "architecture": std::env::consts::ARCH,
        "load_1min": load(),
        "unix_time_s": time.map_or(0, |time| time.as_secs()),
    })
}

/// What was built; two reports with the same `binary` ran the same program.
pub(crate) fn describe_build(program: &Path) -> Value {
    let bytes = std::fs::read(program).unwrap_or_default();
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "commit": commit(program),
        "compiler": compiler(&bytes),
        "is_optimised": !cfg!(debug_assertions),
        "binary": format!("{:016x}", fnv1a(FNV_OFFSET, &bytes)),
    })
}

/// Load average of the last minute (processes that ran or were ready to run): near 0 on a quiet machine.
pub(crate) fn load() -> f64 {
    let one = LoadAverage::current().map_or(0.0, |load| f64::from(load.one));
    // Two decimals, as the kernel writes it.
    (one * 100.0).round() / 100.0
}

/// The compiler's note in a program: `rustc version 1.95.0 (...)`.
fn compiler(program: &[u8]) -> Option<String> {
    const NOTE: &[u8] = b"rustc version ";
    let at = program.windows(NOTE.len()).position(|found| found == NOTE)?;
    let note = program[at..].split(|&byte| byte == 0).next()?;
    Some(String::from_utf8_lossy(note).into_owned())
}

/// Commit of the program: `MLUC_COMMIT` if the build had it set; else, if the sources are still on this machine, the last
/// commit before the program was built, with `-dirty` when a source changed since that commit and before the build.
fn commit(program: &Path) -> Option<String> {
    if let Some(commit) = option_env!("MLUC_COMMIT") {
        return Some(commit.to_string());
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let git = |arguments: &[&str]| {
        let mut command = Command::new("git");
        let output = command.arg("-C").arg(&root).args(arguments).output().ok()?;
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        output.status.success().then_some(text)
    };
    let modified = |path: &Path| std::fs::metadata(path).and_then(|about| about.modified());
    let built = modified(program).ok()?;
    let seconds = built.duration_since(UNIX_EPOCH).ok()?.as_secs();
    let before = format!("--before={seconds}");
    let log = git(&["log", "-1", "--abbrev=12", "--format=%h", &before])?;
    let commit = log.lines().next().filter(|line| !line.is_empty())?;
    let mut diff = vec!["diff", "--name-only", commit, "--"];
    diff.extend(SOURCES.split(' '));
    let changed = git(&diff)?;
    let is_built = |name: &str| modified(&root.join(name)).is_ok_and(|changed| changed <= built);
    let is_dirty = changed.lines().any(is_built);
    Some(format!("{commit}{}", if is_dirty { "-dirty" } else { "" }))
}

fn text_of(path: &str) -> Option<String> {
    Some(read_to_string(path).ok()?.trim_end().to_string())
}
