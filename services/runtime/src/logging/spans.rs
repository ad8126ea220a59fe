//! Spans of the frame path, written to a file by each process: what a trace of one frame over all processes is made of.
//!
//! Spans with the target [`SPANS_TARGET`] are written, a JSON line each: process, pid, tid, name, sequence, begin and end on
//! CLOCK_MONOTONIC. A span without a `sequence` takes that of the span around it. Lines are handed to the kernel when an
//! outermost span ends, so that a frame is there even if the process is killed later. Without the layer such a span costs
//! one comparison.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Mutex;

use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id};
use tracing::{Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{FilterFn, filter_fn};
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;

use crate::monotonic_ns;

/// Target of the spans that are written.
pub(super) const SPANS_TARGET: &str = "mluc::frame";

/// Writes spans.
pub(super) struct Spans {
    process: &'static str,
    sink: Mutex<Sink>,
}

struct Sink {
    file: File,
    lines: String,
}

/// A span that has not ended.
struct Open {
    sequence: u64,
    begin_ns: u64,
}

impl Spans {
    /// Into `folder/PROCESS-PID.spans`.
    pub(super) fn create(folder: &Path, process: &'static str) -> io::Result<Spans> {
        let name = format!("{process}-{}.spans", std::process::id());
        let (file, lines) = (File::create(folder.join(name))?, String::new());
        let sink = Mutex::new(Sink { file, lines });
        Ok(Spans { process, sink })
    }

    /// Lets the spans of the frame path through, and nothing else.
    pub(super) fn filter() -> FilterFn<fn(&Metadata<'_>) -> bool> {
        filter_fn(|metadata| metadata.is_span() && metadata.target() == SPANS_TARGET)
    }
}

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for Spans {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        let Some(span) = context.span(id) else {
            return;
        };
        let mut sequence = Sequence(None);
        attributes.record(&mut sequence);
        let inherited = || {
            let parent = span.parent()?;
            let extensions = parent.extensions();
            extensions.get::<Open>().map(|open| open.sequence)
        };
        let open = Open {
            sequence: sequence.0.or_else(inherited).unwrap_or(u64::MAX),
            begin_ns: monotonic_ns(),
        };
        span.extensions_mut().insert(open);
    }

    fn on_close(&self, id: Id, context: Context<'_, S>) {
        let end_ns = monotonic_ns();
        let Some(span) = context.span(&id) else {
            return;
        };
        let extensions = span.extensions();
        let (Some(open), Ok(mut sink)) = (extensions.get::<Open>(), self.sink.lock()) else {
            return;
        };
        // Names of processes and spans are plain words of ours: nothing to escape.
        let _ = writeln!(
            sink.lines,
            r#"{{"process":"{}","pid":{},"tid":{},"name":"{}","sequence":{},"begin_ns":{},"end_ns":{end_ns}}}"#,
            self.process,
            std::process::id(),
            rustix::thread::gettid().as_raw_nonzero(),
            span.name(),
            open.sequence,
            open.begin_ns,
        );
        if span.parent().is_none() {
            let Sink { file, lines } = &mut *sink;
            // A full disk costs the trace and not the pipeline.
            let _ = file.write_all(lines.as_bytes());
            lines.clear();
        }
    }
}

/// Picks the field `sequence`.
struct Sequence(Option<u64>);

impl Visit for Sequence {
    fn record_u64(&mut self, field: &Field, value: u64) {
        if field.name() == "sequence" {
            self.0 = Some(value);
        }
    }

    fn record_debug(&mut self, _: &Field, _: &dyn std::fmt::Debug) {}
}

#[cfg(test)]
mod tests {
    use tracing_subscriber::prelude::*;

    use super::*;

    #[test]
    fn spans_of_a_frame_are_written_with_its_sequence() {
        let folder = std::env::temp_dir().join(format!("mluc-spans-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let spans = Spans::create(&folder, "head").unwrap();
        let layer = spans.with_filter(Spans::filter());
        let subscriber = tracing_subscriber::registry().with(layer);
        tracing::subscriber::with_default(subscriber, || {
            let frame = tracing::trace_span!(target: SPANS_TARGET, "frame", sequence = 7u64);
            let _frame = frame.entered();
            let _other = tracing::info_span!("elsewhere").entered();
            tracing::trace_span!(target: SPANS_TARGET, "run").in_scope(|| ());
        });
        let name = format!("head-{}.spans", std::process::id());
        let text = std::fs::read_to_string(folder.join(name)).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 2, "{text}");
        for (line, name) in lines.iter().zip(["run", "frame"]) {
            let expected = format!(r#""name":"{name}","sequence":7,"#);
            assert!(line.contains(&expected), "{text}");
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}
