//! The report for people: the page (one file, no script, no external resources) and the table on a terminal, each from its template.

use super::frame::{FrameRecord, HOPS, STAGES, measured};
use super::{charts, figures::number, figures::short, series::series};
use anyhow::Result;
use minijinja::{Environment, UndefinedBehavior, value::Serde};
use serde_json::{Value, json};

/// The page of a report and its frames, warm-up included.
pub(crate) fn page(report: &Value, frames: &[FrameRecord]) -> Result<String> {
    let figures = series(&measured(frames));
    let rate_hz = number(report, "/scenario/rate_hz").filter(|rate_hz| *rate_hz > 0.0);
    let period_ms = rate_hz.map(|rate_hz| 1000.0 / rate_hz);
    let values = json!({
        "report": report,
        "style": include_str!("page.css"),
        "latency": charts::latency_over_time(frames, period_ms),
        "waterfall": charts::waterfall(frames),
        "percentiles": charts::percentile_curves(&figures),
    });
    render("page.html", include_str!("page.html"), values)
}

/// The report as a table that fits on a screen.
pub(crate) fn table(report: &Value) -> Result<String> {
    let values = json!({"report": report});
    render("table.txt", include_str!("table.txt"), values)
}

/// Fills in a template. If its name ends with `html`, texts are escaped.
pub(crate) fn render(name: &str, template: &str, mut values: Value) -> Result<String> {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Chainable);
    environment.add_filter("short", |value: Option<f64>| value.map_or("-".to_string(), short));
    (values["stages"], values["hops"]) = (json!(STAGES), json!(HOPS));
    Ok(environment.render_named_str(name, template, Serde(values))? + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::figures::report_of;
    use crate::report::frame::testing::{dropped, frame};

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
        let html = page(&report, &frames).unwrap();
        for tag in ["svg", "table", "section", "div", "text", "title"] {
            let count = |text: String| html.matches(&text).count();
            let opened = count(format!("<{tag}>")) + count(format!("<{tag} "));
            assert_eq!(opened, count(format!("</{tag}>")), "{tag}");
        }
        assert_eq!(html.matches("<svg").count(), 3);
        assert!(html.contains("99.9 %"));
        assert!(html.contains("mluc &lt;bench&gt;") && html.contains("a &amp; b"));
        assert!(!html.contains("NaN") && !html.contains("inf"));
    }

    #[test]
    fn a_run_without_frames_has_a_page() {
        let all_dropped = [dropped(0), dropped(1)];
        for (frames, words) in [(&all_dropped[..0], "0 / 0"), (&all_dropped, "2 dropped")] {
            let html = page(&report_of(frames), frames).unwrap();
            assert!(html.contains(words) && !html.contains("NaN"));
        }
    }
}
