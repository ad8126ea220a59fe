//! What a hop into a refiner and out of it costs: two programs side by side, frame by frame in turns.

use std::time::Duration;

use anyhow::Context;
use mluc_geometry::quantile;
use mluc_ipc_types::Stage;
use serde::Serialize;

use crate::refiner::scene::usual;
use crate::refiner::session::{Options, Session};

/// Frames before the first that counts.
const WARM_UP: u32 = 20;
/// Between two frames; long enough that both programs sleep when the next one comes.
const PERIOD: Duration = Duration::from_millis(10);

/// Of one quantity, us.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Percentiles {
    /// Median.
    pub(crate) p50_us: f64,
    /// 99th percentile.
    pub(crate) p99_us: f64,
    /// Largest.
    pub(crate) max_us: f64,
}

/// Of one program.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct HopTimes {
    /// Which program.
    pub(crate) program: String,
    /// From the head's publication to the refiner's reception.
    pub(crate) hop_in: Percentiles,
    /// From its reception to its publication.
    pub(crate) run: Percentiles,
    /// From its publication to the reception behind it.
    pub(crate) hop_out: Percentiles,
}

/// Two programs side by side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct LatencyReport {
    /// Frames measured of each.
    pub(crate) frames: u32,
    /// What the other is compared with.
    pub(crate) reference: HopTimes,
    /// The program.
    pub(crate) program: HopTimes,
    /// Program minus reference, p50 of the hop in, us.
    pub(crate) extra_in_p50_us: f64,
    /// The same of the hop out.
    pub(crate) extra_out_p50_us: f64,
}

/// A running program and its times: hop in, run, hop out.
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
    let mut lanes = [
        Lane::start(reference, "hop-0")?,
        Lane::start(program, "hop-1")?,
    ];
    for number in 0..WARM_UP + frames {
        for lane in &mut lanes {
            std::thread::sleep(PERIOD);
            let title = &lane.session.options.title;
            lane.frame(number >= WARM_UP)
                .with_context(|| title.clone())?;
        }
    }
    let [reference, program] = lanes.map(Lane::result);
    Ok(LatencyReport {
        frames,
        extra_in_p50_us: program.hop_in.p50_us - reference.hop_in.p50_us,
        extra_out_p50_us: program.hop_out.p50_us - reference.hop_out.p50_us,
        reference,
        program,
    })
}

impl<'a> Lane<'a> {
    fn start(options: &'a Options, label: &str) -> anyhow::Result<Lane<'a>> {
        let mut session = Session::new(options, label)?;
        session.start().with_context(|| options.title.clone())?;
        Ok(Lane {
            session,
            times_us: [const { Vec::new() }; 3],
        })
    }

    fn frame(&mut self, counts: bool) -> anyhow::Result<()> {
        let (points, detections) = usual();
        let frame = self.session.player.frame(points, detections);
        let sent = self.session.player.send(&frame)?;
        let answer = self.session.await_answer(&sent)?;
        let own = answer.header.stages[Stage::Refiner as usize];
        let spans = [
            (
                sent.header.stages[Stage::Head as usize].published_ns,
                own.received_ns,
            ),
            (own.received_ns, own.published_ns),
            (own.published_ns, answer.received_ns),
        ];
        if counts {
            for (times_us, (from, to)) in self.times_us.iter_mut().zip(spans) {
                times_us.push(to.saturating_sub(from) as f64 * 1e-3);
            }
        }
        Ok(())
    }

    fn result(self) -> HopTimes {
        let [hop_in, run, hop_out] = self.times_us.map(|mut times_us| {
            times_us.sort_by(f64::total_cmp);
            let at = |q| quantile(&times_us, q).unwrap_or(0.0);
            let [p50_us, p99_us, max_us] = [0.5, 0.99, 1.0].map(at);
            Percentiles {
                p50_us,
                p99_us,
                max_us,
            }
        });
        HopTimes {
            program: self.session.options.title.clone(),
            hop_in,
            run,
            hop_out,
        }
    }
}

impl LatencyReport {
    /// The table.
    pub(crate) fn text(&self) -> String {
        let mut text = format!(
            "{} frames each, in turns; us           p50        p99        max\n",
            self.frames
        );
        for times in [&self.reference, &self.program] {
            text += &format!("{}\n", times.program);
            for (name, p) in [
                ("head published -> received", times.hop_in),
                ("received -> published", times.run),
                ("published -> received behind", times.hop_out),
            ] {
                text += &format!(
                    "  {name:32}{:10.1} {:10.1} {:10.1}\n",
                    p.p50_us, p.p99_us, p.max_us
                );
            }
        }
        text + &format!(
            "extra a hop at p50: in {:+.1} us, out {:+.1} us\n",
            self.extra_in_p50_us, self.extra_out_p50_us
        )
    }
}
