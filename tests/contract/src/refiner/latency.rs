//! What a hop into a refiner and out of it costs: two programs side by side, frame by frame in turns.

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

#[derive(Clone, Copy, Serialize)]
struct Percentiles {
    p50_us: f64,
    p99_us: f64,
    max_us: f64,
}

/// Of one program.
#[derive(Serialize)]
struct HopTimes {
    program: String,
    /// From the head's publication to the refiner's reception.
    hop_in: Percentiles,
    /// From its reception to its publication.
    run: Percentiles,
    /// From its publication to the reception behind it.
    hop_out: Percentiles,
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
            let measured = lane.frame(number >= WARM_UP);
            measured.with_context(|| title.clone())?;
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
        let mut frame = self.session.player.usual();
        let answer = self.session.exchange(&mut frame)?;
        let own = answer.header.stages[Stage::Refiner as usize];
        let sent_ns = frame.header.stages[Stage::Head as usize].published_ns;
        let passed_ns = [
            sent_ns,
            own.received_ns,
            own.published_ns,
            answer.received_ns,
        ];
        if counts {
            for (times_us, span_ns) in self.times_us.iter_mut().zip(passed_ns.windows(2)) {
                times_us.push(span_ns[1].saturating_sub(span_ns[0]) as f64 * 1e-3);
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
        let frames = self.frames;
        let mut text =
            format!("{frames} frames each, in turns; us           p50        p99        max\n");
        for times in [&self.reference, &self.program] {
            text += &format!("{}\n", times.program);
            for (name, p) in [
                ("head published -> received", times.hop_in),
                ("received -> published", times.run),
                ("published -> received behind", times.hop_out),
            ] {
                let [p50, p99, max] = [p.p50_us, p.p99_us, p.max_us];
                text += &format!("  {name:32}{p50:10.1} {p99:10.1} {max:10.1}\n");
            }
        }
        text + &format!(
            "extra a hop at p50: in {:+.1} us, out {:+.1} us\n",
            self.extra_in_p50_us, self.extra_out_p50_us
        )
    }
}
