//! Log lines to stderr; stdout belongs to results. One line an event, with wall-clock time, for people or as JSON; the same
//! message again and again is summed up.

mod repeats;
mod stderr;

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, SystemTime};
use std::{collections::BTreeMap, fmt::Debug, io::Write};

use humantime::format_rfc3339_millis;
use serde_json::json;
use tracing::Level;
use tracing::field::{Field, Visit};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::prelude::*;

use crate::monotonic_ns;
use repeats::Repeats;
pub use stderr::PatientStderr;

static IS_JSON: OnceLock<bool> = OnceLock::new();
/// What this process is called in its lines.
static PROCESS: OnceLock<&str> = OnceLock::new();
static REPEATS: Mutex<Repeats> = Mutex::new(Repeats(Vec::new()));

/// How log lines are written: for people, or a JSON object a line (`time`, `level`, `process`, `message`, `fields`).
pub const LOG_FORMATS: [&str; 2] = ["human", "json"];
/// Names the format where no option does. A pipeline hands it to its stages.
pub const LOG_FORMAT_VARIABLE: &str = "MLUC_LOG_FORMAT";

/// From now on this process writes this format; the first word counts.
pub fn choose_log_format(name: &str) {
    let _ = IS_JSON.set(name == LOG_FORMATS[1]);
}

/// What was chosen, else what the environment names.
pub fn log_format() -> &'static str {
    let variable = || std::env::var(LOG_FORMAT_VARIABLE).is_ok_and(|name| name == LOG_FORMATS[1]);
    LOG_FORMATS[usize::from(*IS_JSON.get_or_init(variable))]
}

/// A line for the log, in the current format. `fields` are names and values, said behind the message.
pub fn log_line(process: &str, level: Level, message: &str, fields: &[(&str, String)]) -> String {
    let time = format_rfc3339_millis(SystemTime::now()).to_string();
    if log_format() == LOG_FORMATS[1] {
        let fields: BTreeMap<&str, &String> = fields.iter().map(|(k, v)| (*k, v)).collect();
        let level = level.as_str();
        return json!({"time": time, "level": level, "process": process, "message": message, "fields": fields}).to_string();
    }
    let fields = fields.iter();
    let fields = fields.map(|(name, value)| format!(" {name}={value}"));
    let fields: String = fields.collect();
    // One line an event.
    let text = format!("{message}{fields}").replace('\n', "\\n");
    format!("{time} {level:5} {process}: {text}")
}

/// Writes the sums of messages that repeated and whose time is over; at the end of a process, of all.
pub fn tell_repeats(is_end: bool) {
    let now_ns = if is_end { u64::MAX } else { monotonic_ns() };
    for line in sums(now_ns) {
        let _ = PatientStderr(Duration::ZERO).write_all(format!("{line}\n").as_bytes());
    }
}

fn sums(now_ns: u64) -> Vec<String> {
    // A panic beside a log line poisons nothing that matters here.
    let mut repeats = REPEATS.lock().unwrap_or_else(PoisonError::into_inner);
    let ended = repeats.ended(now_ns).into_iter();
    let process = PROCESS.get().unwrap_or(&"log");
    let line = |(level, message, count)| {
        let told = format!("{message} ({count} more like it)");
        log_line(process, level, &told, &[])
    };
    ended.map(line).collect()
}

/// Starts logging. `MLUC_LOG` sets the filter (`info` without it); `process` names this process in each line. iceoryx2's
/// own messages are silent: every failure of it comes out as an error of ours that says what to do.
pub fn log_to_stderr(process: &'static str, default_filter: &str) {
    let given = std::env::var("MLUC_LOG").unwrap_or_default();
    let given = Some(given).filter(|words| !words.is_empty());
    let filter = given.and_then(|words| EnvFilter::try_new(words).ok());
    let filter = filter.unwrap_or_else(|| EnvFilter::new(default_filter));
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(|| PatientStderr(Duration::ZERO))
        .with_ansi(false)
        .event_format(Line { process })
        .with_filter(filter);
    let _ = PROCESS.set(process);
    if log_format() == LOG_FORMATS[1] {
        std::panic::set_hook(Box::new(move |panic| {
            let line = log_line(process, Level::ERROR, &panic.to_string(), &[]);
            let _ = PatientStderr(Duration::ZERO).write_all(format!("{line}\n").as_bytes());
        }));
    }
    // A second start in one process (tests) keeps the first.
    let _ = tracing_subscriber::registry().with(lines).try_init();
}

struct Line {
    process: &'static str,
}

impl<S, N> tracing_subscriber::fmt::FormatEvent<S, N> for Line
where
    S: tracing::Subscriber + for<'a> tracing_subscriber::registry::LookupSpan<'a>,
    N: for<'a> tracing_subscriber::fmt::FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        _: &tracing_subscriber::fmt::FmtContext<'_, S, N>,
        mut writer: tracing_subscriber::fmt::format::Writer<'_>,
        event: &tracing::Event<'_>,
    ) -> std::fmt::Result {
        let mut words = Words::default();
        event.record(&mut words);
        let level = *event.metadata().level();
        let now_ns = crate::monotonic_ns();
        for line in sums(now_ns) {
            writeln!(writer, "{line}")?;
        }
        let mut repeats = REPEATS.lock().unwrap_or_else(PoisonError::into_inner);
        if repeats.admit(level, &words.message, now_ns) {
            let line = log_line(self.process, level, &words.message, &words.fields);
            writeln!(writer, "{line}")?;
        }
        Ok(())
    }
}

/// What an event says.
#[derive(Default)]
struct Words {
    message: String,
    fields: Vec<(&'static str, String)>,
}

impl Visit for Words {
    fn record_str(&mut self, field: &Field, value: &str) {
        self.fields.push((field.name(), value.to_string()));
    }

    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        let text = format!("{value:?}");
        if field.name() == "message" {
            self.message = text;
        } else {
            self.fields.push((field.name(), text));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_json_is_an_object_whatever_it_says() {
        choose_log_format("json");
        let fields = [("path", "a \"b\"\n".to_string())];
        let line = log_line("up", Level::WARN, "cannot \"read\"\n", &fields);
        let mut value: serde_json::Value = serde_json::from_str(&line).unwrap();
        let time = value["time"].take();
        assert!(humantime::parse_rfc3339(time.as_str().unwrap_or("?")).is_ok());
        let expected = json!({
            "time": null, "level": "WARN", "process": "up", "message": "cannot \"read\"\n", "fields": {"path": "a \"b\"\n"},
        });
        assert_eq!(value, expected);
    }

    #[test]
    fn what_repeated_is_told_at_the_end() {
        choose_log_format("json");
        for _ in 0..9 {
            let mut repeats = REPEATS.lock().unwrap();
            repeats.admit(Level::WARN, "the same", crate::monotonic_ns());
        }
        let last = sums(u64::MAX).pop().unwrap();
        assert!(last.contains("the same (4 more like it)"), "{last}");
    }
}
