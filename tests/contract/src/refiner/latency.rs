//! What a hop into a refiner and out of it costs: two programs side by side, frame by frame in turns.

use std::collections::BTreeMap;
use std::time::Duration;

use anyhow::Context;
use mluc_geometry::quantile;
use mluc_ipc_types::Stage;
use serde::Serialize;

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

#[derive(Serialize)]
struct Percentiles {
    p50_us: f64,
    p99_us: f64,
    max_us: f64,
}

/// Of one program, by the names of [`SPANS`].
#[derive(Serialize)]
struct HopTimes {
    program: String,
    #[serde(flatten)]
    spans: BTreeMap<&'static str, Percentiles>,
}

/// Two programs side by side.
#[derive(Serialize)]
pub(crate) struct LatencyReport {
    /// Measured of each.
    frames: u32,
    reference: HopTimes,
    program: HopTimes,
    /// Program minus reference.
    extra_in_p50_us: f64,
    extra_out_p50_us: f64,
}

/// A running program and its times in the order of [`SPANS`].
struct Lane<'a> {
    session: Session<'a>,
    times_us: [Vec<f64>; 3],
}

/// Sends `frames` frames to each, one after the other in turns, with a pause before each.
pub(crate) fn compare(
    reference: &Options,
    program: &Options,
    frames: u32,
) -> anyhow::Result<LatencyReport> {
    let (mut reference, mut program) = (Lane::start(reference, 0)?, Lane::start(program, 1)?);
    for number in 0..WARM_UP + frames {
        for lane in [&mut reference, &mut program] {
            std::thread::sleep(PERIOD);
            let measured = lane.frame(number >= WARM_UP);
            measured.with_context(|| lane.session.options.title.clone())?;
        }
    }
    let [reference, program] = [reference, program].map(Lane::result);
    let extra_p50_us = |span: &str| program.spans[span].p50_us - reference.spans[span].p50_us;
    Ok(LatencyReport {
        frames,
        extra_in_p50_us: extra_p50_us("hop_in"),
        extra_out_p50_us: extra_p50_us("hop_out"),
        reference,
        program,
    })
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

    fn result(self) -> HopTimes {
        let percentiles = |mut times_us: Vec<f64>| {
            times_us.sort_by(f64::total_cmp);
            let at = |q| quantile(&times_us, q).unwrap_or(0.0);
            Percentiles {
                p50_us: at(0.5),
                p99_us: at(0.99),
                max_us: at(1.0),
            }
        };
        let spans = SPANS.iter().zip(self.times_us);
        let spans = spans.map(|((name, _), times_us)| (*name, percentiles(times_us)));
        HopTimes {
            program: self.session.options.title.clone(),
            spans: spans.collect(),
        }
    }
}

impl LatencyReport {
    /// The table.
    pub(crate) fn text(&self) -> String {
        let frames = self.frames;
        let mut text =
            format!("{frames} frames each, in turns; us           p50        p99        max\n");
        for times in [&self.reference, &self.program] {
            text += &format!("{}\n", times.program);
            for (key, name) in SPANS {
                let p = &times.spans[key];
                let [p50, p99, max] = [p.p50_us, p.p99_us, p.max_us];
                text += &format!("  {name:32}{p50:10.1} {p99:10.1} {max:10.1}\n");
            }
        }
        let [extra_in, extra_out] = [self.extra_in_p50_us, self.extra_out_p50_us];
        text + &format!("extra a hop at p50: in {extra_in:+.1} us, out {extra_out:+.1} us\n")
    }
}
