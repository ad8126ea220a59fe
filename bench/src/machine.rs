//! The machine that a figure belongs to, and the program that was measured: without them a figure means little.

use std::fs::read_to_string;
use std::path::Path;
use std::process::Command;
use std::str::FromStr;
use std::time::{SystemTime, UNIX_EPOCH};

use mluc::placement::usable_cpus;
use serde_json::{Map, Value, json};

/// Instruction sets that the kernels choose by.
const EXTENSIONS: &str =
    "avx2 fma avx_vnni avx512f avx512_bf16 avx512_vnni amx_bf16 amx_int8 asimd asimddp bf16";
/// Folders whose files are in the program `mluc`.
const SOURCES: &str = "ipc-types geometry kernels model services weights Cargo.toml";

/// Processor, memory, kernel, and the moment; what the system does not say is null.
pub fn describe_machine() -> Map<String, Value> {
    let cpuinfo = text_of("/proc/cpuinfo").unwrap_or_default();
    let flags = field(&cpuinfo, "flags").or(field(&cpuinfo, "Features"));
    let flags: Vec<&str> = flags.unwrap_or_default().split_whitespace().collect();
    let mut extensions: Vec<&str> = EXTENSIONS.split(' ').collect();
    extensions.retain(|extension| flags.contains(extension));
    let meminfo = text_of("/proc/meminfo").unwrap_or_default();
    let part = || field(&cpuinfo, "CPU part").map(|part| format!("part {part}"));
    let time = SystemTime::now().duration_since(UNIX_EPOCH);
    object(json!({
        "processor": field(&cpuinfo, "model name").map(str::to_string).or_else(part),
        "cores_usable": usable_cpus().len(),
        "cores_present": cpuinfo.lines().filter(|line| line.starts_with("processor")).count(),
        "instruction_sets": extensions.join(" "),
        "memory_mib": number_of(&meminfo, "MemTotal:") / 1024,
        "virtual_machine": flags.contains(&"hypervisor"),
        "kernel": text_of("/proc/sys/kernel/osrelease"),
        "governor": text_of("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").unwrap_or_else(|| "not visible".to_string()),
        "architecture": std::env::consts::ARCH,
        "load_1min": load(),
        "unix_time_s": time.map_or(0, |time| time.as_secs()),
    }))
}

/// What was built; two reports with the same `binary` ran the same program.
pub fn describe_build(program: &Path) -> Map<String, Value> {
    let bytes = std::fs::read(program).unwrap_or_default();
    object(json!({
        "version": env!("CARGO_PKG_VERSION"),
        "commit": commit(program),
        "compiler": compiler(&bytes),
        "is_optimised": !cfg!(debug_assertions),
        "binary": format!("{:016x}", fingerprint(&bytes)),
    }))
}

/// The machine, and the running program.
pub fn describe_here() -> Map<String, Value> {
    let mut machine = describe_machine();
    let own = std::env::current_exe().unwrap_or_default();
    machine.extend(describe_build(&own));
    machine
}

/// Memory that can be had without swapping, MiB.
pub(crate) fn available_mib() -> u64 {
    let meminfo = text_of("/proc/meminfo").unwrap_or_default();
    number_of(&meminfo, "MemAvailable:") / 1024
}

/// Processes that ran or wanted to, over the last minute: near 0 on a quiet machine.
pub(crate) fn load() -> f64 {
    let text = text_of("/proc/loadavg").unwrap_or_default();
    first_number(&text).unwrap_or(0.0)
}

/// The number after `key` at the begin of a line; 0 when there is none.
pub(crate) fn number_of(text: &str, key: &str) -> u64 {
    first_number(field(text, key).unwrap_or_default()).unwrap_or(0)
}

fn first_number<T: FromStr>(text: &str) -> Option<T> {
    text.split_whitespace().next()?.parse().ok()
}

/// Ticks of the CPU in `/proc/PID/stat`, fields 14 to 17: in the program and in the kernel, of the process and of its children
/// that have ended (proc(5)).
pub(crate) fn cpu_ticks(stat: &str) -> [u64; 4] {
    // The name in parentheses may hold anything; what follows it begins with field 3.
    let fields = stat.rsplit_once(')').map_or("", |(_, fields)| fields);
    let mut ticks = fields.split_whitespace().skip(11);
    [(); 4].map(|()| ticks.next().and_then(|word| word.parse().ok()).unwrap_or(0))
}

pub(crate) fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

/// The compiler's note in a program: `rustc version 1.95.0 (...)`.
fn compiler(program: &[u8]) -> Option<String> {
    const NOTE: &[u8] = b"rustc version ";
    let mut windows = program.windows(NOTE.len());
    let at = windows.position(|found| found == NOTE)?;
    let note = program[at..].split(|&byte| byte == 0).next()?;
    Some(String::from_utf8_lossy(note).into_owned())
}

/// Of what was built: `MLUC_COMMIT` when the build had it set; else, where the sources still lie on this machine, the last
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

/// FNV-1a over words of 8 bytes.
fn fingerprint(bytes: &[u8]) -> u64 {
    bytes.chunks(8).fold(0xcbf2_9ce4_8422_2325, |hash, chunk| {
        let mut word = [0; 8];
        word[..chunk.len()].copy_from_slice(chunk);
        (hash ^ u64::from_le_bytes(word)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The value of the first line `key : value`, or `key value`.
fn field<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let value = text.lines().find_map(|line| line.strip_prefix(key))?;
    Some(value.trim_start_matches([' ', '\t', ':']).trim_end())
}

fn text_of(path: &str) -> Option<String> {
    Some(read_to_string(path).ok()?.trim_end().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_and_program_are_described() {
        let here = describe_here();
        assert!(here["memory_mib"].as_u64() > Some(0) && available_mib() > 0);
        assert!(here["compiler"].as_str().unwrap().starts_with("rustc"));
        // A changed byte is another binary.
        assert_ne!(fingerprint(b"0123456789"), fingerprint(b"0123456788"));
    }

    #[test]
    fn lines_of_the_system_are_read() {
        let text = "processor\t: 0\nmodel name\t: Some CPU @ 2 GHz: fast\nflags\t: fma avx2\n";
        assert_eq!(field(text, "model name"), Some("Some CPU @ 2 GHz: fast"));
        assert_eq!(field(text, "flags"), Some("fma avx2"));
        assert_eq!(field(text, "bugs"), None);
        let text = "VmRSS:\t  12 kB\nRssAnon:\t   345 kB\n";
        let numbers = ["RssAnon:", "RssShmem:"].map(|key| number_of(text, key));
        assert_eq!(numbers, [345, 0]);
        let stat = "1 (a) b)) S 2 3 4 5 6 7 8 9 10 11 100 20 3 4 20 0 1 0";
        assert_eq!(cpu_ticks(stat), [100, 20, 3, 4]);
        assert_eq!(cpu_ticks(""), [0; 4]);
    }
}
