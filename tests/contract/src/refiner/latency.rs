//! What a hop into a refiner and out of it costs: two programs side by side, frame by frame in turns.

use std::time::Duration;

use anyhow::Context;
use mluc_geometry::quantile_of;
use mluc_ipc_types::Stage;
use serde_json::{Value, json};

use crate::program::Options;
use crate::refiner::session::Session;

/// Frames before the first that counts.
const WARM_UP: u32 = 20;
/// Between two frames; long enough that both programs sleep when the next one comes.
const PERIOD: Duration = Duration::from_millis(10);

/// What is measured, as the JSON and the table name it.
const SPANS: [(&str, &str); 3] = [
    ("hop_in", "head published -> received"),
    ("run", "received -> published"),
    ("hop_out", "published -> received behind"),
];

/// A running program and its times in the order of [`SPANS`].
struct Lane<'a> {
    session: Session<'a>,
    times_us: [Vec<f64>; 3],
}

/// Sends `frames` frames to each, one after the other in turns, with a pause before each. The report: each program's percentiles, and
/// what `program` takes longer than `reference`.
pub(crate) fn compare(
    reference: &Options,
    program: &Options,
    frames: u32,
) -> anyhow::Result<Value> {
    let mut lanes = [Lane::start(reference, 0)?, Lane::start(program, 1)?];
    for number in 0..WARM_UP + frames {
        for lane in &mut lanes {
            std::thread::sleep(PERIOD);
            let measured = lane.frame(number >= WARM_UP);
            measured.with_context(|| lane.session.options.title.clone())?;
        }
    }
    let [reference, program] = lanes.map(Lane::result);
    let extra_p50_us = |span: &str| {
        let [ours, theirs] = [&reference, &program].map(|p| p[span]["p50_us"].as_f64());
        Some(theirs? - ours?)
    };
    Ok(json!({
        "frames": frames,
        "extra_in_p50_us": extra_p50_us("hop_in"),
        "extra_out_p50_us": extra_p50_us("hop_out"),
        "reference": reference,
        "program": program,
    }))
}

impl<'a> Lane<'a> {
    fn start(options: &'a Options, number: u32) -> anyhow::Result<Lane<'a>> {
        let mut session = Session::new(options, &format!("hop-{number}"))?;
        session.start().with_context(|| options.title.clone())?;
        Ok(Lane {
            session,
            times_us: Default::default(),
        })
    }

    fn frame(&mut self, counts: bool) -> anyhow::Result<()> {
        let mut frame = self.session.player.usual();
        let answer = self.session.exchange(&mut frame)?;
        let own = answer.header.stages[Stage::Refiner as usize];
        let sent_ns = frame.header.stages[Stage::Head as usize].published_ns;
        let (taken_ns, published_ns) = (own.received_ns, own.published_ns);
        let passed_ns = [sent_ns, taken_ns, published_ns, answer.received_ns];
        if counts {
            for (times_us, span_ns) in self.times_us.iter_mut().zip(passed_ns.windows(2)) {
                times_us.push(span_ns[1].saturating_sub(span_ns[0]) as f64 * 1e-3);
            }
        }
        Ok(())
    }

    fn result(self) -> Value {
        let mut result = json!({"program": self.session.options.title});
        for ((span, _), times_us) in SPANS.iter().zip(self.times_us) {
            let at = |q| quantile_of(times_us.clone(), q);
            result[span] = json!({"p50_us": at(0.5), "p99_us": at(0.99), "max_us": at(1.0)});
        }
        result
    }
}

/// The report as a table.
pub(crate) fn table(report: &Value) -> String {
    let number = |value: &Value| value.as_f64().unwrap_or(0.0);
    let frames = &report["frames"];
    let mut text =
        format!("{frames} frames each, in turns; us           p50        p99        max\n");
    for times in [&report["reference"], &report["program"]] {
        text += &format!("{}\n", times["program"].as_str().unwrap_or_default());
        for (span, name) in SPANS {
            let keys = ["p50_us", "p99_us", "max_us"];
            let [p50, p99, max] = keys.map(|key| number(&times[span][key]));
            text += &format!("  {name:32}{p50:10.1} {p99:10.1} {max:10.1}\n");
        }
    }
    let extra = ["extra_in_p50_us", "extra_out_p50_us"].map(|key| number(&report[key]));
    text + &format!(
        "extra a hop at p50: in {:+.1} us, out {:+.1} us",
        extra[0], extra[1]
    )
}
