//! The page: what a person reads. One file, no script, nothing from outside.

use std::fmt::Write;

use serde_json::{Map, Value};

use super::figures::{HandOver, LatencyReport};
use super::frame::{FrameRecord, HOPS, STAGES};
use super::histogram::{histograms, percentile_curves};
use super::series::series;
use super::timeline::{Sample, cpu_over_time, latency_over_time};
use super::waterfall::waterfall;
use crate::svg::{escape, short};

const STYLE: &str = include_str!("page.css");

/// The page of a report, its frames (warm-up included) and what the stages took of the machine over time.
pub(crate) fn page(report: &LatencyReport, frames: &[FrameRecord], samples: &[Sample]) -> String {
    let measured: Vec<FrameRecord> = frames.iter().filter(|f| !f.is_warm_up).cloned().collect();
    let figures = series(&measured);
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width\"><title>{0}</title><style>{STYLE}</style></head><body>\n\
         <h1>{0}</h1>\n",
        escape(&report.title)
    );
    html += &glance(report);
    section(
        &mut html,
        "Latency of every frame",
        "Every frame that was due is there. A dropped one counts until a newer frame was out: so long did the vehicle know nothing newer.",
        &latency_over_time(frames, report.period_ms()),
    );
    section(
        &mut html,
        "Stages",
        "Queue: from the publication of its input to the start of computing (ingest: from due). Run: from there to the publication of its result.",
        &stages(report),
    );
    section(
        &mut html,
        "Where the time went",
        "One lane a stage; pale: queue, full: run. The slowest of the frames that came out, on the same scale as the median.",
        &waterfall(frames),
    );
    section(
        &mut html,
        "Percentiles",
        "Run of each stage, and end to end of every frame. With fewer than 1000 frames the right end is the slowest frame.",
        &percentile_curves(&figures),
    );
    section(
        &mut html,
        "Histograms",
        "Time to the right, logarithmic, each with its own range.",
        &histograms(&figures),
    );
    section(
        &mut html,
        "Hand-over between processes",
        "From publication to the consumer having it, of frames whose consumer was idle; beside it, measured after the run in turn between two idle processes: our hop alone, and what the machine gives at best for the same bytes.",
        &hops(report),
    );
    section(
        &mut html,
        "CPU over time",
        "Of each stage's process, all its threads.",
        &cpu_over_time(samples),
    );
    section(
        &mut html,
        "How quiet the machine was",
        "Other work delays frames by itself. Figures of a machine that was not quiet are upper bounds.",
        &table(&report.quiet),
    );
    section(&mut html, "What ran, and on what", "", &settings(report));
    html += "<p class=\"foot\">Beside this page: report.json (all figures), frames.csv (every frame), resources.csv. \
             <code>mluc bench compare A B</code> judges two such folders.</p>\n</body></html>\n";
    html
}

fn section(html: &mut String, title: &str, text: &str, content: &str) {
    let _ = writeln!(
        html,
        "<section><h2>{title}</h2><p>{text}</p>{content}</section>"
    );
}

/// What must be seen first: warnings, then four numbers.
fn glance(report: &LatencyReport) -> String {
    let mut html = String::new();
    for warning in &report.warnings {
        let _ = writeln!(html, "<p class=\"warning\">{}</p>", escape(warning));
    }
    let ms = |us: f64| format!("{} ms", short(us / 1000.0));
    let total = &report.end_to_end_us;
    let counts = &report.frames;
    let dropped = match counts.dropped {
        0 => "no frame dropped".to_string(),
        n => format!(
            "{n} dropped ({} %)",
            short(100.0 * n as f64 / counts.taken_in.max(1) as f64)
        ),
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
            report
                .first_frame
                .latency_us
                .map_or("dropped".to_string(), ms),
            first_frame(report),
        ),
    ];
    html += "<div class=\"tiles\">";
    for (word, number, below) in tiles {
        let _ = write!(
            html,
            "<div><span>{word}</span><b>{}</b><span>{}</span></div>",
            escape(&number),
            escape(&below)
        );
    }
    html += "</div>\n";
    html
}

fn first_frame(report: &LatencyReport) -> String {
    match report.first_frame.over_steady {
        Some(ratio) => format!("{} times the median of later ones", short(ratio)),
        None => "no median to compare with".to_string(),
    }
}

fn stages(report: &LatencyReport) -> String {
    let mut html = String::from(
        "<table><tr><th></th><th colspan=\"3\">queue, ms</th><th colspan=\"4\">run, ms</th><th colspan=\"6\">process</th></tr>\
         <tr><th></th><th>p50</th><th>p99</th><th>max</th><th>p50</th><th>p90</th><th>p99</th><th>max</th>\
         <th>threads</th><th>cores used</th><th>memory, MiB</th><th>shared, MiB</th><th>waited for a CPU</th><th>CPU taken away, 1/s</th></tr>",
    );
    for (name, stage) in STAGES.iter().zip(&report.stages) {
        let ms = |us: f64| short(us / 1000.0);
        let (queue, run, took) = (&stage.queue_us, &stage.run_us, &stage.resources);
        let cells = [
            ms(queue.p50),
            ms(queue.p99),
            ms(queue.max),
            ms(run.p50),
            ms(run.p90),
            ms(run.p99),
            ms(run.max),
            took.threads.to_string(),
            short(took.cpu_cores),
            short(took.memory_mib),
            short(took.shared_memory_mib),
            format!("{} %", short(100.0 * took.waiting_for_cpu)),
            short(took.switches_forced_per_s),
        ];
        row(&mut html, name, &cells);
    }
    html + "</table>"
}

fn hops(report: &LatencyReport) -> String {
    let mut html = String::from(
        "<table><tr><th>topic</th><th>bytes</th><th>p50, us</th><th>p99, us</th><th>alone p50</th><th>p99</th><th>raw iceoryx2 p50</th><th>p99</th>\
         <th>alone / raw, p50</th><th>futex wake</th><th>socket copy p50</th><th>socket / alone</th><th>memcpy</th></tr>",
    );
    for (name, hop) in HOPS.iter().zip(&report.hops) {
        row(&mut html, name, &hop_cells(hop));
    }
    html += "</table>";
    let together = &report.hops_together;
    if let (Some(p50_us), Some(share)) = (together.p50_us, together.share_of_100_ms) {
        let _ = write!(
            html,
            "<p>All hand-overs of a frame together: {} us at the median, {} % of a frame of 100 ms.</p>",
            short(p50_us),
            short(100.0 * share)
        );
    }
    html
}

fn hop_cells(hop: &HandOver) -> [String; 12] {
    let us = |value: Option<f64>| value.map_or("-".to_string(), short);
    let ratio = |above: Option<f64>, below: Option<f64>| match (above, below) {
        (Some(above), Some(below)) if below > 0.0 => format!("{} x", short(above / below)),
        _ => "-".to_string(),
    };
    [
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

fn row(html: &mut String, name: &str, cells: &[String]) {
    let _ = write!(html, "<tr><th>{}</th>", escape(name));
    for cell in cells {
        let _ = write!(html, "<td>{}</td>", escape(cell));
    }
    html.push_str("</tr>");
}

fn settings(report: &LatencyReport) -> String {
    let parts = [
        ("machine", &report.machine),
        ("build", &report.build),
        ("scenario", &report.scenario),
        ("instrumentation", &report.instrumentation),
    ];
    let mut html = String::from("<div class=\"columns\">");
    for (name, part) in parts {
        let _ = write!(html, "<div><h3>{name}</h3>{}</div>", table(part));
    }
    html + "</div>"
}

fn table(values: &Map<String, Value>) -> String {
    let mut html = String::from("<table class=\"facts\">");
    for (key, value) in values {
        let text = match value {
            Value::String(text) => text.clone(),
            Value::Number(number) => number
                .as_f64()
                .filter(|v| v.fract() != 0.0)
                .map_or(number.to_string(), short),
            Value::Null => "not known".to_string(),
            other => other.to_string(),
        };
        let _ = write!(
            html,
            "<tr><th>{}</th><td>{}</td></tr>",
            escape(&key.replace('_', " ")),
            escape(&text)
        );
    }
    html + "</table>"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame::testing::{dropped, frame};

    fn example(count: u64) -> (LatencyReport, Vec<FrameRecord>) {
        let mut frames: Vec<FrameRecord> = (0..count)
            .map(|n| frame(n, 2000 + 10 * (n as i64 % 7)))
            .collect();
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
            let opened = html.matches(&format!("<{tag}>")).count()
                + html.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, html.matches(&format!("</{tag}>")).count(), "{tag}");
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
