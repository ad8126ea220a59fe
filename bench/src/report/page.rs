//! The page: what a person reads. One file, no script, nothing from outside.

use serde_json::Value;

use super::charts;
use super::charts::Sample;
use super::figures::number;
use super::frame::{FrameRecord, HOPS, STAGES, measured};
use super::series::series;

/// The page of a report, its frames (warm-up included) and what the stages took of the machine over time.
pub(crate) fn page(report: &Value, frames: &[FrameRecord], samples: &[Sample]) -> String {
    let figures = series(&measured(frames));
    let rate_hz = number(report, "/scenario/rate_hz").filter(|rate_hz| *rate_hz > 0.0);
    let period_ms = rate_hz.map(|rate_hz| 1000.0 / rate_hz);
    format!(
        include_str!("page.html"),
        title = escape(report["title"].as_str().unwrap_or_default()),
        style = include_str!("page.css"),
        warnings = warnings(report),
        tiles = tiles(report),
        latency = charts::latency_over_time(frames, period_ms),
        stages = rows(STAGES, &report["stages"], stage_cells),
        waterfall = charts::waterfall(frames),
        percentiles = charts::percentile_curves(&figures),
        histograms = charts::histograms(&figures),
        hops = rows(HOPS, &report["hops"], hop_cells),
        together = together(report),
        resources = resources(samples),
        quiet = facts(&report["quiet"]),
        machine = facts(&report["machine"]),
        build = facts(&report["build"]),
        scenario = facts(&report["scenario"]),
    )
}

fn warnings(report: &Value) -> String {
    let texts = report["warnings"].as_array().into_iter().flatten();
    let texts = texts.filter_map(Value::as_str).map(escape);
    texts
        .map(|text| format!("<p class=\"warning\">{text}</p>\n"))
        .collect()
}

fn tiles(report: &Value) -> String {
    let ms = |us: f64| format!("{} ms", short(us / 1000.0));
    let total = |q: &str| ms(report["end_to_end_us"][q].as_f64().unwrap_or(0.0));
    let [taken_in, out, dropped] =
        ["in", "out", "dropped"].map(|key| report["frames"][key].as_u64().unwrap_or(0));
    let percent = short(100.0 * dropped as f64 / taken_in.max(1) as f64);
    let dropped = match dropped {
        0 => "no frame dropped".to_string(),
        n => format!("{n} dropped ({percent} %)"),
    };
    let first = |key: &str| report["first_frame"][key].as_f64();
    let over_steady = match first("over_steady") {
        Some(ratio) => format!("{} times the median of later ones", short(ratio)),
        None => "no median to compare with".to_string(),
    };
    let first_ms = first("latency_us").map_or("dropped".to_string(), ms);
    let most = format!("90 of 100 frames within {}", total("p90"));
    let tail = format!("99.9 %: {}, slowest: {}", total("p999"), total("max"));
    let counts = format!("{out} / {taken_in}");
    let tiles = [
        ("median, end to end", total("p50"), most),
        ("99 of 100 frames within", total("p99"), tail),
        ("frames out of frames in", counts, dropped),
        ("first frame", first_ms, over_steady),
    ];
    let tiles = tiles.map(|(word, number, below)| {
        format!("<div><span>{word}</span><b>{number}</b><span>{below}</span></div>")
    });
    tiles.concat()
}

fn rows(names: [&str; 4], values: &Value, cells: fn(&Value) -> Vec<String>) -> String {
    let rows = names.map(|name| {
        let cells = cells(&values[name]).into_iter();
        let cells: String = cells.map(|cell| format!("<td>{cell}</td>")).collect();
        format!("<tr><th>{name}</th>{cells}</tr>\n")
    });
    rows.concat()
}

fn stage_cells(stage: &Value) -> Vec<String> {
    let cell =
        |key: &str, factor: f64| short(factor * number(stage, &format!("/{key}")).unwrap_or(0.0));
    let times =
        "queue_us/p50 queue_us/p99 queue_us/max run_us/p50 run_us/p90 run_us/p99 run_us/max";
    let took = "threads cpu_cores memory_mib shared_memory_mib".split(' ');
    let took = took.map(|key| cell(&format!("resources/{key}"), 1.0));
    let waiting = format!("{} %", cell("resources/waiting_for_cpu", 100.0));
    let times = times.split(' ').map(|key| cell(key, 1e-3));
    let forced = cell("resources/switches_forced_per_s", 1.0);
    times.chain(took).chain([waiting, forced]).collect()
}

fn hop_cells(hop: &Value) -> Vec<String> {
    let keys = "payload_bytes p50_us p99_us alone_p50_us alone_p99_us raw_p50_us raw_p99_us \
                alone_p50_us/raw_p50_us futex_p50_us socket_p50_us socket_p50_us/alone_p50_us memcpy_p50_us";
    let cell = |key: &str| {
        let text = match key.split_once('/') {
            None => hop[key].as_f64().map(short),
            Some((above, below)) => hop[above].as_f64().and_then(|above| {
                let below = hop[below].as_f64().filter(|below| *below > 0.0)?;
                Some(format!("{} x", short(above / below)))
            }),
        };
        text.unwrap_or("-".to_string())
    };
    keys.split(' ').map(cell).collect()
}

fn together(report: &Value) -> String {
    let together = |key: &str| report["hops_together"][key].as_f64();
    let (Some(p50_us), Some(share)) = (together("p50_us"), together("share_of_100_ms")) else {
        return String::new();
    };
    let (p50, percent) = (short(p50_us), short(100.0 * share));
    format!(
        "<p>All hand-overs of a frame together: {p50} us at the median, {percent} % of a frame of 100 ms.</p>"
    )
}

/// Of a run that was watched; a report of several runs leaves it to theirs.
fn resources(samples: &[Sample]) -> String {
    if samples.is_empty() {
        return String::new();
    }
    let chart = charts::resources_over_time(samples);
    format!(
        "<section><h2>CPU and memory over time</h2>\n<p>Of each stage's process, all its threads; memory of its own.</p>\n{chart}</section>"
    )
}

fn facts(values: &Value) -> String {
    let rows = values
        .as_object()
        .into_iter()
        .flatten()
        .map(|(key, value)| {
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

/// Text for HTML, attributes too.
fn escape(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    let text = text.replace('>', "&gt;").replace('"', "&quot;");
    text.replace('\'', "&#39;")
}

/// A number with the digits that matter.
pub(super) fn short(value: f64) -> String {
    let digits = match value.abs() {
        v if v >= 99.95 => 0,
        v if v >= 9.995 => 1,
        v if v >= 0.995 => 2,
        0.0 => 0,
        _ => 3,
    };
    let text = format!("{value:.digits$}");
    if digits == 0 {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::figures::report_of;
    use crate::report::frame::testing::{dropped, frame};
    use serde_json::json;

    #[test]
    fn the_page_shows_everything_and_its_tags_are_closed() {
        let slower = |n| frame(n, 2000 + 10 * (n as i64 % 7));
        let mut frames: Vec<FrameRecord> = (0..120).map(slower).collect();
        for overtaken in frames.iter_mut().skip(20).step_by(40) {
            *overtaken = dropped(overtaken.sequence);
        }
        let mut report = report_of(&frames);
        report["title"] = "mluc <bench>".into();
        report["warnings"] = json!(["a & b"]);
        report["scenario"] = json!({"rate_hz": 10});
        let samples = [0.0, 1.0, 2.0].map(|at_s| Sample {
            at_s,
            cpu_cores: [0.1, 1.5, 0.2, 0.0],
            memory_mib: [10.0; 4],
        });
        let html = page(&report, &frames, &samples);
        for tag in ["svg", "table", "section", "div", "text", "title"] {
            let count = |text: String| html.matches(&text).count();
            let opened = count(format!("<{tag}>")) + count(format!("<{tag} "));
            assert_eq!(opened, count(format!("</{tag}>")), "{tag}");
        }
        assert_eq!(html.matches("<svg").count(), 5);
        assert!(html.contains("99.9 %") && html.contains("backbone, ms"));
        assert!(html.contains("mluc &lt;bench&gt;") && html.contains("a &amp; b"));
        assert!(!html.contains("NaN") && !html.contains("inf"));
    }

    #[test]
    fn numbers_are_short_and_text_cannot_leave_its_place() {
        let texts = [0.0, 0.0123, 1.5, 2.0, 12.34, 99.97, 1234.5].map(short);
        assert_eq!(texts, ["0", "0.012", "1.5", "2", "12.3", "100", "1234"]);
        let escaped = "&lt;a href=&quot;x&quot;&gt;&#39;&amp;";
        assert_eq!(escape("<a href=\"x\">'&"), escaped);
    }

    #[test]
    fn a_run_without_frames_has_a_page() {
        let all_dropped = [dropped(0), dropped(1)];
        for (frames, words) in [(&all_dropped[..0], "0 / 0"), (&all_dropped, "2 dropped")] {
            let html = page(&report_of(frames), frames, &[]);
            assert!(html.contains(words) && !html.contains("NaN"));
        }
    }
}
