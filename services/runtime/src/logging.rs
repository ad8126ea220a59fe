//! Log lines to stderr; stdout belongs to results.

use tracing_subscriber::EnvFilter;

/// Starts logging. `MLUC_LOG` sets the filter (`info` without it); `process` names this process in each line. iceoryx2's
/// own messages are silent: every failure of it comes out as an error of ours that says what to do.
pub fn log_to_stderr(process: &'static str, default_filter: &str) {
    let filter =
        EnvFilter::try_from_env("MLUC_LOG").unwrap_or_else(|_| EnvFilter::new(default_filter));
    // A second start in one process (tests) keeps the first.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_target(false)
        .with_ansi(false)
        .event_format(Line { process })
        .try_init();
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
        context
            .field_format()
            .format_fields(writer.by_ref(), event)?;
        writeln!(writer)
    }
}
