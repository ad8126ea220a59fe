//! The page: what a person reads. One file, no script, nothing from outside.

use serde_json::{Map, Value};

use super::charts::{
    Sample, cpu_over_time, histograms, latency_over_time, percentile_curves, waterfall,
};
use super::figures::{HandOver, LatencyReport, StageFigures};
use super::frame::{FrameRecord, HOPS, STAGES, measured};
use super::series::series;
use crate::svg::{escape, short};

const STYLE: &str = include_str!("page.css");
const STAGES_HEAD: &str = "<tr><th></th><th colspan=\"3\">queue, ms</th><th colspan=\"4\">run, ms</th><th colspan=\"6\">process</th></tr>\
    <tr><th></th><th>p50</th><th>p99</th><th>max</th><th>p50</th><th>p90</th><th>p99</th><th>max</th>\
    <th>threads</th><th>cores used</th><th>memory, MiB</th><th>shared, MiB</th><th>waited for a CPU</th><th>CPU taken away, 1/s</th></tr>";
const HOPS_HEAD: &str = "<tr><th>topic</th><th>bytes</th><th>p50, us</th><th>p99, us</th><th>alone p50</th><th>p99</th>\
    <th>raw iceoryx2 p50</th><th>p99</th><th>alone / raw, p50</th><th>futex wake</th><th>socket copy p50</th>\
    <th>socket / alone</th><th>memcpy</th></tr>";

/// The page of a report, its frames (warm-up included) and what the stages took of the machine over time.
pub(crate) fn page(report: &LatencyReport, frames: &[FrameRecord], samples: &[Sample]) -> String {
    let figures = series(&measured(frames));
    let sections = [
        (
            "Latency of every frame",
            "Every frame that was due is there. A dropped one counts until a newer frame was out: the age of the newest available result.",
            latency_over_time(frames, report.period_ms()),
        ),
        (
            "Stages",
            "Queue: from the publication of its input to the start of computing (ingest: from due). Run: from there to the publication of its result.",
            table(
                STAGES_HEAD,
                STAGES.iter().zip(report.stages.iter().map(stage_cells)),
            ),
        ),
        (
            "Where the time went",
            "One lane a stage; pale: queue, full: run. The slowest of the frames that came out, on the same scale as the median.",
            waterfall(frames),
        ),
        (
            "Percentiles",
            "Run of each stage, and end to end of every frame. With fewer than 1000 frames the right end is the slowest frame.",
            percentile_curves(&figures),
        ),
        (
            "Histograms",
            "Time to the right, logarithmic, each with its own range.",
            histograms(&figures),
        ),
        (
            "Hand-over between processes",
            "From publication to the consumer having it, of frames whose consumer was idle; beside it, measured after the run in turn between two idle processes: our hop alone, and what the machine gives at best for the same bytes.",
            hops(report),
        ),
        (
            "CPU over time",
            "Of each stage's process, all its threads.",
            cpu_over_time(samples),
        ),
        (
            "How quiet the machine was",
            "Other work delays frames by itself. Figures of a machine that was not quiet are upper bounds.",
            facts(&report.quiet),
        ),
        ("What ran, and on what", "", settings(report)),
    ];
    let sections = sections.map(|(title, text, content)| {
        format!("<section><h2>{title}</h2><p>{text}</p>{content}</section>\n")
    });
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width\"><title>{0}</title><style>{STYLE}</style></head><body>\n\
         <h1>{0}</h1>\n{1}{2}\
         <p class=\"foot\">Beside this page: report.json (all figures), frames.csv (every frame), resources.csv. \
         <code>mluc bench compare A B</code> judges two such folders.</p>\n</body></html>\n",
        escape(&report.title),
        glance(report),
        sections.concat()
    )
}

/// What must be seen first: warnings, then four numbers.
fn glance(report: &LatencyReport) -> String {
    let warnings = report.warnings.iter();
    let warnings = warnings.map(|text| format!("<p class=\"warning\">{}</p>\n", escape(text)));
    let ms = |us: f64| format!("{} ms", short(us / 1000.0));
    let (total, counts) = (&report.end_to_end_us, &report.frames);
    let percent = 100.0 * counts.dropped as f64 / counts.taken_in.max(1) as f64;
    let dropped = match counts.dropped {
        0 => "no frame dropped".to_string(),
        n => format!("{n} dropped ({} %)", short(percent)),
    };
    let first = &report.first_frame;
    let over_steady = match first.over_steady {
        Some(ratio) => format!("{} times the median of later ones", short(ratio)),
        None => "no median to compare with".to_string(),
    };
    let tiles = [
        (
            "median, end to end",
            ms(total.p50),
            format!("90 of 100 frames within {}", ms(total.p90)),
        ),
        (
            "99 of 100 frames within",
            ms(total.p99),
            format!("99.9 %: {}, slowest: {}", ms(total.p999), ms(total.max)),
        ),
        (
            "frames out of frames in",
            format!("{} / {}", counts.out, counts.taken_in),
            dropped,
        ),
        (
            "first frame",
            first.latency_us.map_or("dropped".to_string(), ms),
            over_steady,
        ),
    ];
    let tiles = tiles.map(|(word, number, below)| {
        format!("<div><span>{word}</span><b>{number}</b><span>{below}</span></div>")
    });
    let tiles = tiles.concat();
    warnings.collect::<String>() + &format!("<div class=\"tiles\">{tiles}</div>\n")
}

fn stage_cells(stage: &StageFigures) -> Vec<String> {
    let (queue, run, took) = (&stage.queue_us, &stage.run_us, &stage.resources);
    let times = [
        queue.p50, queue.p99, queue.max, run.p50, run.p90, run.p99, run.max,
    ];
    let mut cells: Vec<String> = times.map(|us| short(us / 1000.0)).into();
    cells.extend([
        took.threads.to_string(),
        short(took.cpu_cores),
        short(took.memory_mib),
        short(took.shared_memory_mib),
        format!("{} %", short(100.0 * took.waiting_for_cpu)),
        short(took.switches_forced_per_s),
    ]);
    cells
}

fn hops(report: &LatencyReport) -> String {
    let cells = report.hops.iter().map(hop_cells);
    let mut html = table(HOPS_HEAD, HOPS.iter().zip(cells));
    let together = &report.hops_together;
    if let (Some(p50_us), Some(share)) = (together.p50_us, together.share_of_100_ms) {
        html += &format!(
            "<p>All hand-overs of a frame together: {} us at the median, {} % of a frame of 100 ms.</p>",
            short(p50_us),
            short(100.0 * share)
        );
    }
    html
}

fn hop_cells(hop: &HandOver) -> Vec<String> {
    let us = |value: Option<f64>| value.map_or("-".to_string(), short);
    let ratio = |above: Option<f64>, below: Option<f64>| match (above, below) {
        (Some(above), Some(below)) if below > 0.0 => format!("{} x", short(above / below)),
        _ => "-".to_string(),
    };
    vec![
        hop.payload_bytes.to_string(),
        us(hop.p50_us),
        us(hop.p99_us),
        us(hop.alone_p50_us),
        us(hop.alone_p99_us),
        us(hop.raw_p50_us),
        us(hop.raw_p99_us),
        ratio(hop.alone_p50_us, hop.raw_p50_us),
        us(hop.futex_p50_us),
        us(hop.socket_p50_us),
        ratio(hop.socket_p50_us, hop.alone_p50_us),
        us(hop.memcpy_p50_us),
    ]
}

/// A row a name.
fn table<'a>(head: &str, rows: impl Iterator<Item = (&'a &'a str, Vec<String>)>) -> String {
    let rows = rows.map(|(name, cells)| {
        let cells = cells.into_iter().map(|cell| format!("<td>{cell}</td>"));
        format!("<tr><th>{name}</th>{}</tr>", cells.collect::<String>())
    });
    format!("<table>{head}{}</table>", rows.collect::<String>())
}

fn settings(report: &LatencyReport) -> String {
    let parts = [
        ("machine", &report.machine),
        ("build", &report.build),
        ("scenario", &report.scenario),
        ("instrumentation", &report.instrumentation),
    ];
    let parts = parts.map(|(name, part)| format!("<div><h3>{name}</h3>{}</div>", facts(part)));
    format!("<div class=\"columns\">{}</div>", parts.concat())
}

fn facts(values: &Map<String, Value>) -> String {
    let rows = values.iter().map(|(key, value)| {
        let text = match value {
            Value::String(text) => text.clone(),
            Value::Number(number) => number
                .as_f64()
                .filter(|v| v.fract() != 0.0)
                .map_or(number.to_string(), short),
            Value::Null => "not known".to_string(),
            other => other.to_string(),
        };
        let (key, text) = (escape(&key.replace('_', " ")), escape(&text));
        format!("<tr><th>{key}</th><td>{text}</td></tr>")
    });
    let rows: String = rows.collect();
    format!("<table class=\"facts\">{rows}</table>")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame::testing::{dropped, frame};

    fn example(count: u64) -> (LatencyReport, Vec<FrameRecord>) {
        let slower = |n| frame(n, 2000 + 10 * (n as i64 % 7));
        let mut frames: Vec<FrameRecord> = (0..count).map(slower).collect();
        for overtaken in frames.iter_mut().skip(20).step_by(40) {
            *overtaken = dropped(overtaken.sequence);
        }
        let mut report = LatencyReport::of_frames(&frames);
        report.title = "mluc <bench>".to_string();
        report.warnings = vec!["a & b".to_string()];
        report.scenario.insert("rate_hz".to_string(), 10.into());
        (report, frames)
    }

    #[test]
    fn the_page_stands_alone_and_its_tags_are_closed() {
        let (report, frames) = example(120);
        let samples = [0.0, 1.0, 2.0].map(|at_s| Sample {
            at_s,
            cpu_cores: [0.1, 1.5, 0.2, 0.0],
            memory_mib: [1.0; 4],
        });
        let html = page(&report, &frames, &samples);
        for outside in ["http:", "https:", "<script", "url(", "<link", "<img"] {
            assert!(!html.contains(outside), "{outside}");
        }
        for tag in ["svg", "table", "section", "div", "text", "title"] {
            let count = |text: String| html.matches(&text).count();
            let opened = count(format!("<{tag}>")) + count(format!("<{tag} "));
            assert_eq!(opened, count(format!("</{tag}>")), "{tag}");
        }
        assert_eq!(html.matches("<svg").count(), 5);
        assert!(html.contains("mluc &lt;bench&gt;") && html.contains("a &amp; b"));
        assert!(!html.contains("NaN") && !html.contains("inf"));
    }

    #[test]
    fn a_run_without_frames_has_a_page() {
        let html = page(&LatencyReport::of_frames(&[]), &[], &[]);
        assert!(html.contains("0 / 0") && !html.contains("NaN"));
        let all_dropped = [dropped(0), dropped(1)];
        let html = page(&LatencyReport::of_frames(&all_dropped), &all_dropped, &[]);
        assert!(html.contains("2 dropped") && !html.contains("NaN"));
    }
}
