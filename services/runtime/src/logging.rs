//! Log lines on stderr; stdout is for results. Each event is one line with wall-clock time, as text for people or as JSON.
//! Repeated messages are counted and summed up.

mod repeats;
mod stderr;

use crate::monotonic_ns;
use humantime::format_rfc3339_millis;
use repeats::Repeats;
use serde_json::json;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::{collections::BTreeMap, fmt::Debug, io::Write, time::Duration, time::SystemTime};
pub use stderr::PatientStderr;
use tracing::{Level, field::Field, field::Visit};
use tracing_subscriber::prelude::*;
use tracing_subscriber::{EnvFilter, filter::LevelFilter};

static IS_JSON: OnceLock<bool> = OnceLock::new();
/// Name of this process in its log lines.
static PROCESS: OnceLock<&str> = OnceLock::new();
static REPEATS: Mutex<Repeats> = Mutex::new(Repeats(Vec::new()));

/// Formats of log lines: text for people, or one JSON object per line (`time`, `level`, `process`, `message`, `fields`).
pub const LOG_FORMATS: [&str; 2] = ["human", "json"];
/// Environment variable that names the format if no option does. A pipeline passes it to its stages.
pub const LOG_FORMAT_VARIABLE: &str = "MLUC_LOG_FORMAT";

/// Sets the log format of this process. Only the first call has an effect.
pub fn choose_log_format(name: &str) {
    let _ = IS_JSON.set(name == LOG_FORMATS[1]);
}

/// The chosen format, else the one that the environment names.
pub fn log_format() -> &'static str {
    let variable = || std::env::var(LOG_FORMAT_VARIABLE).is_ok_and(|name| name == LOG_FORMATS[1]);
    LOG_FORMATS[usize::from(*IS_JSON.get_or_init(variable))]
}

/// A line for the log, in the current format. `fields` are names and values, which follow the message.
pub fn log_line(process: &str, level: Level, message: &str, fields: &[(&str, String)]) -> String {
    let time = format_rfc3339_millis(SystemTime::now()).to_string();
    if log_format() == LOG_FORMATS[1] {
        let fields: BTreeMap<&str, &String> = fields.iter().map(|(k, v)| (*k, v)).collect();
        let level = level.as_str();
        return json!({"time": time, "level": level, "process": process, "message": message, "fields": fields}).to_string();
    }
    let fields: String = fields.iter().map(|(name, value)| format!(" {name}={value}")).collect();
    // One line per event.
    let text = format!("{message}{fields}").replace('\n', "\\n");
    format!("{time} {level:5} {process}: {text}")
}

/// Writes the counts of repeated messages whose time window is over. With `is_end`, at the end of a process, it writes all counts.
pub fn tell_repeats(is_end: bool) {
    let now_ns = if is_end { u64::MAX } else { monotonic_ns() };
    for line in sums(now_ns) {
        let _ = PatientStderr(Duration::ZERO).write_all(format!("{line}\n").as_bytes());
    }
}

fn sums(now_ns: u64) -> Vec<String> {
    // A poisoned lock does no harm here: the counts stay usable after a panic.
    let mut repeats = REPEATS.lock().unwrap_or_else(PoisonError::into_inner);
    let ended = repeats.ended(now_ns).into_iter();
    let process = PROCESS.get().unwrap_or(&"log");
    let line = |(level, message, count)| {
        let told = format!("{message} ({count} more like it)");
        log_line(process, level, &told, &[])
    };
    ended.map(line).collect()
}

/// Starts logging. `MLUC_LOG` sets the filter (`default_filter` without it); `process` names this process in each line. iceoryx2's
/// own messages are off: this project reports each failure of iceoryx2 as an error that says what to do.
pub fn log_to_stderr(process: &'static str, default_filter: &str) {
    let given = std::env::var("MLUC_LOG").unwrap_or_default();
    let given = Some(given).filter(|words| !words.is_empty());
    // A word that is no level would be a module's name, and nothing would be logged.
    let is_module =
        |words: &str| !words.contains(['=', ',']) && words.parse::<LevelFilter>().is_err();
    // What the default silences in libraries stays silenced, unless the words name it.
    let (_, silenced) = default_filter.split_once(',').unwrap_or_default();
    let read = |words: &String| {
        let kept = match words.parse::<LevelFilter>() {
            Ok(LevelFilter::OFF) => String::new(),
            Ok(LevelFilter::ERROR) => silenced.replace("=warn", "=error"),
            _ => silenced.to_owned(),
        };
        EnvFilter::try_new(kept + "," + words).ok().filter(|_| !is_module(words))
    };
    let filter = given.as_ref().and_then(read);
    if let (Some(words), None) = (&given, &filter) {
        let text = format!(
            "MLUC_LOG: expected a level (off, error, warn, info, debug, trace) or MODULE=LEVEL,.., found {words}: {default_filter} is used"
        );
        let line = log_line(process, Level::WARN, &text, &[]);
        let _ = PatientStderr(Duration::ZERO).write_all(format!("{line}\n").as_bytes());
    }
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
    // A second call in one process (tests) keeps the first logger.
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
        let stage = words.fields.iter().find(|(name, _)| *name == "stage");
        let stage = stage.map_or("", |(_, stage)| stage);
        let told = format!("{} {stage}", words.message);
        if repeats.admit(level, told.trim_end(), now_ns) {
            let line = log_line(self.process, level, &words.message, &words.fields);
            writeln!(writer, "{line}")?;
        }
        Ok(())
    }
}

/// Message and fields of an event.
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
            REPEATS.lock().unwrap().admit(Level::WARN, "the same", crate::monotonic_ns());
        }
        let last = sums(u64::MAX).pop().unwrap();
        assert!(last.contains("the same (4 more like it)"), "{last}");
    }
}
