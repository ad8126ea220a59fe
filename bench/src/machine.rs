//! The machine that a figure belongs to, and how quiet it was: without it a figure means little.

use std::fs::read_to_string;
use std::process::Command;

use serde::Serialize;

/// Read from the system at the time of measuring; `?` where it does not say.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// Of the first processor.
    pub cpu: String,
    /// Processors that this process may use.
    pub cores: usize,
    /// Vector extensions that matter to the kernels.
    pub extensions: Vec<String>,
    /// MiB.
    pub memory_mib: u64,
    /// Name and version of the system's kernel.
    pub kernel: String,
    /// Of the processors' frequency.
    pub governor: String,
    /// Processes that ran or wanted to, over the last minute: near 0 on a quiet machine.
    pub load_1min: f64,
    /// The compiler found on the path.
    pub compiler: String,
    /// Of the checkout, and whether files differ from it.
    pub commit: String,
    /// Seconds since 1970, by the machine's clock.
    pub unix_time_s: u64,
}

impl Machine {
    /// This one, now.
    pub fn here() -> Machine {
        let cpuinfo = read_to_string("/proc/cpuinfo").unwrap_or_default();
        let flags = field(&cpuinfo, "flags").or_else(|| field(&cpuinfo, "Features"));
        let flags = flags.unwrap_or_default();
        let known = [
            "avx2",
            "fma",
            "avx512f",
            "avx512_vnni",
            "avx512_bf16",
            "amx_int8",
            "asimd",
            "asimddp",
            "bf16",
        ];
        let has = |name: &&str| flags.split_whitespace().any(|flag| flag == *name);
        let memory = read_to_string("/proc/meminfo").unwrap_or_default();
        let memory = field(&memory, "MemTotal").unwrap_or_default();
        Machine {
            cpu: field(&cpuinfo, "model name").unwrap_or_else(|| "?".into()),
            cores: std::thread::available_parallelism().map_or(0, usize::from),
            extensions: known
                .iter()
                .filter(|name| has(name))
                .map(|name| name.to_string())
                .collect(),
            memory_mib: memory
                .split_whitespace()
                .next()
                .and_then(|kib| kib.parse::<u64>().ok())
                .unwrap_or(0)
                / 1024,
            kernel: line_of("/proc/sys/kernel/osrelease"),
            governor: line_of("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
            load_1min: line_of("/proc/loadavg")
                .split_whitespace()
                .next()
                .and_then(|load| load.parse().ok())
                .unwrap_or(0.0),
            compiler: told_by("rustc", &["--version"]),
            commit: told_by("git", &["describe", "--always", "--dirty", "--abbrev=12"]),
            unix_time_s: std::time::SystemTime::now()
                .duration_since(std::time::UNIX_EPOCH)
                .map_or(0, |time| time.as_secs()),
        }
    }
}

/// The value of the first line `key : value`.
fn field(text: &str, key: &str) -> Option<String> {
    text.lines().find_map(|line| {
        let (name, value) = line.split_once(':')?;
        (name.trim() == key).then(|| value.trim().to_string())
    })
}

fn line_of(path: &str) -> String {
    match read_to_string(path) {
        Ok(text) => text.trim().to_string(),
        Err(_) => "?".into(),
    }
}

fn told_by(program: &str, arguments: &[&str]) -> String {
    match Command::new(program).args(arguments).output() {
        Ok(output) if output.status.success() => {
            String::from_utf8_lossy(&output.stdout).trim().to_string()
        }
        _ => "?".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_system_are_read() {
        let text = "processor\t: 0\nmodel name\t: Some CPU @ 2 GHz: fast\nflags\t: fma avx2\n";
        assert_eq!(
            field(text, "model name").as_deref(),
            Some("Some CPU @ 2 GHz: fast")
        );
        assert_eq!(field(text, "flags").as_deref(), Some("fma avx2"));
        assert_eq!(field(text, "bugs"), None);
    }

    #[test]
    fn this_machine_has_cores_and_memory() {
        let machine = Machine::here();
        assert!(machine.cores > 0 && machine.memory_mib > 0, "{machine:?}");
        assert_ne!(machine.kernel, "?");
    }
}
