//! Log lines to stderr; stdout belongs to results.

mod spans;

use std::path::Path;

use tracing_subscriber::EnvFilter;
use tracing_subscriber::prelude::*;

use spans::Spans;

/// Starts logging. `MLUC_LOG` sets the filter (`info` without it); `process` names this process in each line. iceoryx2's
/// own messages are silent: every failure of it comes out as an error of ours that says what to do. `MLUC_SPANS` names a
/// folder into which the spans of the frame path are written (`mluc bench --trace`).
pub fn log_to_stderr(process: &'static str, default_filter: &str) {
    let filter =
        EnvFilter::try_from_env("MLUC_LOG").unwrap_or_else(|_| EnvFilter::new(default_filter));
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(false)
        .event_format(Line { process })
        .with_filter(filter);
    let folder = std::env::var_os("MLUC_SPANS");
    let spans = folder.map(|folder| Spans::create(Path::new(&folder), process));
    let (spans, failure) = match spans.transpose() {
        Ok(spans) => (spans.map(|s| s.with_filter(Spans::filter())), None),
        Err(error) => (None, Some(error)),
    };
    // A second start in one process (tests) keeps the first.
    let _ = tracing_subscriber::registry()
        .with(lines)
        .with(spans)
        .try_init();
    if let Some(error) = failure {
        tracing::warn!(%error, "MLUC_SPANS: no spans are written");
    }
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
        context: &tracing_subscriber::fmt::FmtContext<'_, S, N>,
        mut writer: tracing_subscriber::fmt::format::Writer<'_>,
        event: &tracing::Event<'_>,
    ) -> std::fmt::Result {
        let seconds = crate::monotonic_ns() as f64 * 1e-9;
        let level = event.metadata().level();
        write!(writer, "{seconds:.3} {level:5} {}: ", self.process)?;
        let fields = context.field_format();
        fields.format_fields(writer.by_ref(), event)?;
        writeln!(writer)
    }
}
