//! `--trace`: spans of all processes to one file.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mluc::UsageError;

use super::arguments::RunArgs;
use crate::report::{FrameRecord, Selection, Span, chrome_trace, parse_span};

/// Names the folder into which the processes write their spans.
pub(crate) const SPANS_VARIABLE: &str = "MLUC_SPANS";

/// A trace that was asked for.
#[derive(Clone, Debug)]
pub(crate) struct TraceRequest {
    file: PathBuf,
    frame: Which,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Which {
    Median,
    Worst,
    First,
    All,
    Sequence(u64),
}

impl TraceRequest {
    pub(crate) fn resolve(
        args: &RunArgs,
        variants: usize,
    ) -> Result<Option<TraceRequest>, UsageError> {
        let Some(file) = args.trace.clone() else {
            return Ok(None);
        };
        if variants > 1 || args.rounds.is_some_and(|rounds| rounds > 1) {
            return Err(UsageError(
                "a trace shows one run: --trace goes with one round of one pipeline".to_string(),
            ));
        }
        let frame = which(&args.trace_frame)?;
        Ok(Some(TraceRequest { file, frame }))
    }

    /// Reads the spans and writes the trace; the frame's sequence for the terminal.
    pub(crate) fn write(
        &self,
        spans_folder: &Path,
        frames: &[FrameRecord],
    ) -> anyhow::Result<String> {
        let spans = read(spans_folder)?;
        let (selection, text) = match self.frame {
            Which::All => (Selection::All, "all frames".to_string()),
            which => {
                let sequence = choose(which, frames)?;
                (Selection::Frame(sequence), format!("frame {sequence}"))
            }
        };
        let trace = chrome_trace(&spans, selection);
        if trace["traceEvents"].as_array().is_none_or(Vec::is_empty) {
            bail!("no spans of {text}: was it dropped, or does the run have fewer frames?");
        }
        fs::write(&self.file, trace.to_string())
            .with_context(|| format!("writing {}", self.file.display()))?;
        Ok(format!(
            "{text}: {} (open it in ui.perfetto.dev or chrome://tracing)",
            self.file.display()
        ))
    }
}

/// Where the processes write their spans, for as long as the measurement lasts.
pub(crate) struct SpansFolder(PathBuf);

impl SpansFolder {
    pub(crate) fn make(out: &Path) -> anyhow::Result<SpansFolder> {
        let folder = out.join("spans");
        fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
        // Stages find it whatever folder they run in.
        let folder =
            fs::canonicalize(&folder).with_context(|| format!("finding {}", folder.display()))?;
        Ok(SpansFolder(folder))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.0
    }

    pub(crate) fn variable(&self) -> (&'static str, String) {
        (SPANS_VARIABLE, self.0.display().to_string())
    }
}

impl Drop for SpansFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn which(word: &str) -> Result<Which, UsageError> {
    match word {
        "median" => Ok(Which::Median),
        "worst" => Ok(Which::Worst),
        "first" => Ok(Which::First),
        "all" => Ok(Which::All),
        number => number.parse().map(Which::Sequence).map_err(|_| {
            UsageError(format!(
                "--trace-frame must be median, worst, first, all or a sequence, found '{word}'"
            ))
        }),
    }
}

fn choose(which: Which, frames: &[FrameRecord]) -> anyhow::Result<u64> {
    let mut out: Vec<(i64, u64)> = frames
        .iter()
        .filter(|frame| !frame.is_warm_up)
        .filter_map(|frame| Some((frame.published_ns()? - frame.due_ns, frame.sequence)))
        .collect();
    out.sort_unstable();
    let chosen = match which {
        Which::Sequence(sequence) => return Ok(sequence),
        Which::First | Which::All => return Ok(0),
        Which::Median => out.get(out.len().saturating_sub(1) / 2),
        Which::Worst => out.last(),
    };
    chosen
        .map(|&(_, sequence)| sequence)
        .context("no frame came out: no trace")
}

fn read(folder: &Path) -> anyhow::Result<Vec<Span>> {
    let entries = fs::read_dir(folder).with_context(|| format!("spans in {}", folder.display()))?;
    let mut spans = Vec::new();
    for entry in entries.flatten() {
        let text = fs::read_to_string(entry.path())
            .with_context(|| format!("reading {}", entry.path().display()))?;
        spans.extend(text.lines().filter_map(parse_span));
    }
    Ok(spans)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_chosen_by_word_or_number() {
        assert_eq!(which("worst").unwrap(), Which::Worst);
        assert_eq!(which("17").unwrap(), Which::Sequence(17));
        assert!(which("wurst").is_err());
        assert!(choose(Which::Median, &[]).is_err());
        assert_eq!(choose(Which::Sequence(4), &[]).unwrap(), 4);
    }
}
