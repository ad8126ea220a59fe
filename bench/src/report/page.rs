//! The page: what a person reads. One file, no script, nothing from outside.

use serde_json::{Map, Value};

use super::charts;
use super::charts::Sample;
use super::figures::{HandOver, LatencyReport, StageFigures};
use super::frame::{FrameRecord, HOPS, STAGES, measured};
use super::series::series;
use crate::svg::{escape, short};

/// The page of a report, its frames (warm-up included) and what the stages took of the machine over time.
pub(crate) fn page(report: &LatencyReport, frames: &[FrameRecord], samples: &[Sample]) -> String {
    let figures = series(&measured(frames));
    format!(
        include_str!("page.html"),
        title = escape(&report.title),
        style = include_str!("page.css"),
        warnings = warnings(report),
        tiles = tiles(report),
        latency = charts::latency_over_time(frames, report.period_ms()),
        stages = rows(STAGES, report.stages.each_ref().map(stage_cells)),
        waterfall = charts::waterfall(frames),
        percentiles = charts::percentile_curves(&figures),
        histograms = charts::histograms(&figures),
        hops = rows(HOPS, report.hops.each_ref().map(hop_cells)),
        together = together(report),
        cpu = charts::cpu_over_time(samples),
        quiet = facts(&report.quiet),
        machine = facts(&report.machine),
        build = facts(&report.build),
        scenario = facts(&report.scenario),
        instrumentation = facts(&report.instrumentation),
    )
}

fn warnings(report: &LatencyReport) -> String {
    let line = |text: &String| format!("<p class=\"warning\">{}</p>\n", escape(text));
    report.warnings.iter().map(line).collect()
}

fn tiles(report: &LatencyReport) -> String {
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
    let first_ms = first.latency_us.map_or("dropped".to_string(), ms);
    let most = format!("90 of 100 frames within {}", ms(total.p90));
    let tail = format!("99.9 %: {}, slowest: {}", ms(total.p999), ms(total.max));
    let out = format!("{} / {}", counts.out, counts.taken_in);
    let tiles = [
        ("median, end to end", ms(total.p50), most),
        ("99 of 100 frames within", ms(total.p99), tail),
        ("frames out of frames in", out, dropped),
        ("first frame", first_ms, over_steady),
    ];
    let tiles = tiles.map(|(word, number, below)| {
        format!("<div><span>{word}</span><b>{number}</b><span>{below}</span></div>")
    });
    tiles.concat()
}

fn rows<const CELLS: usize>(names: [&str; 4], cells: [[String; CELLS]; 4]) -> String {
    let rows = names.into_iter().zip(cells).map(|(name, cells)| {
        let cells = cells.map(|cell| format!("<td>{cell}</td>")).concat();
        format!("<tr><th>{name}</th>{cells}</tr>\n")
    });
    rows.collect()
}

fn stage_cells(stage: &StageFigures) -> [String; 13] {
    let ms = |us: f64| short(us / 1000.0);
    let (queue, run, took) = (&stage.queue_us, &stage.run_us, &stage.resources);
    [
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
    ]
}

fn hop_cells(hop: &HandOver) -> [String; 12] {
    let us = |value: Option<f64>| value.map_or("-".to_string(), short);
    let ratio = |above: Option<f64>, below: Option<f64>| match (above, below) {
        (Some(above), Some(below)) if below > 0.0 => format!("{} x", short(above / below)),
        _ => "-".to_string(),
    };
    let b = &hop.baselines;
    [
        hop.payload_bytes.to_string(),
        us(hop.p50_us),
        us(hop.p99_us),
        us(b.alone_p50_us),
        us(b.alone_p99_us),
        us(b.raw_p50_us),
        us(b.raw_p99_us),
        ratio(b.alone_p50_us, b.raw_p50_us),
        us(b.futex_p50_us),
        us(b.socket_p50_us),
        ratio(b.socket_p50_us, b.alone_p50_us),
        us(b.memcpy_p50_us),
    ]
}

fn together(report: &LatencyReport) -> String {
    let together = &report.hops_together;
    let (Some(p50_us), Some(share)) = (together.p50_us, together.share_of_100_ms) else {
        return String::new();
    };
    let (p50, percent) = (short(p50_us), short(100.0 * share));
    format!(
        "<p>All hand-overs of a frame together: {p50} us at the median, {percent} % of a frame of 100 ms.</p>"
    )
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
        format!("<tr><th>{key}</th><td>{text}</td></tr>\n")
    });
    rows.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame::testing::{dropped, frame};

    #[test]
    fn the_page_shows_everything_and_its_tags_are_closed() {
        let slower = |n| frame(n, 2000 + 10 * (n as i64 % 7));
        let mut frames: Vec<FrameRecord> = (0..120).map(slower).collect();
        for overtaken in frames.iter_mut().skip(20).step_by(40) {
            *overtaken = dropped(overtaken.sequence);
        }
        let mut report = LatencyReport::of_frames(&frames);
        report.title = "mluc <bench>".to_string();
        report.warnings = vec!["a & b".to_string()];
        report.scenario.insert("rate_hz".to_string(), 10.into());
        let samples = [0.0, 1.0, 2.0].map(|at_s| Sample {
            at_s,
            cpu_cores: [0.1, 1.5, 0.2, 0.0],
            memory_mib: [1.0; 4],
        });
        let html = page(&report, &frames, &samples);
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
        let all_dropped = [dropped(0), dropped(1)];
        for (frames, words) in [(&all_dropped[..0], "0 / 0"), (&all_dropped, "2 dropped")] {
            let html = page(&LatencyReport::of_frames(frames), frames, &[]);
            assert!(html.contains(words) && !html.contains("NaN"));
        }
    }
}
