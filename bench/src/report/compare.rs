//! Whether two runs differ, or whether it is noise.

use anyhow::{Result, bail};
use serde::Serialize;

use super::bootstrap::{Statistic, interval, scatter};
use super::frame::{FrameRecord, STAGES};
use super::series::{Series, series};
use mluc_geometry::Random;

/// How to judge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompareOptions {
    /// With this probability none of the intervals misses, all rows together.
    pub confidence: f64,
    /// A difference below this share of the figure is noise to whoever decides, however sure it is.
    pub margin: f64,
    /// Relative standard deviation between two starts of the same program, where a report holds fewer than four starts: it
    /// cannot be seen in one. See [`CompareOptions::on_machines`].
    pub start_scatter: f64,
    /// Leaves the stages' own figures out: one of the runs has none.
    pub end_to_end_only: bool,
    /// Draws of the bootstrap.
    pub resamples: usize,
    /// Of the draws.
    pub seed: u64,
}

impl Default for CompareOptions {
    fn default() -> CompareOptions {
        CompareOptions {
            confidence: 0.95,
            margin: 0.02,
            start_scatter: START_SCATTER,
            end_to_end_only: false,
            resamples: 1000,
            seed: 1,
        }
    }
}

/// Of a quiet machine: where pages lie, which core a thread got. Measured over starts: 1 to 2 %.
const START_SCATTER: f64 = 0.015;
/// What other work adds, all cores busy with it: neighbours in the caches and on the memory bus differ from run to run.
/// Measured with two thirds of the cores taken: 6 % end to end.
const START_SCATTER_BUSY: f64 = 0.12;

impl CompareOptions {
    /// For runs during which other processes took these shares of all cores.
    pub fn on_machines(others: [f64; 2]) -> CompareOptions {
        let others = others[0].max(others[1]).clamp(0.0, 1.0);
        CompareOptions {
            start_scatter: START_SCATTER + START_SCATTER_BUSY * others,
            ..CompareOptions::default()
        }
    }
}

/// What a row says of B against A.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The interval of the difference does not leave the margin around 0.
    Noise,
    /// B is surely lower.
    Lower,
    /// B is surely higher.
    Higher,
    /// Too few frames lie beyond this quantile.
    TooFewFrames,
}

/// One figure of both runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Which figure, with its unit.
    pub figure: String,
    /// In A.
    pub a: f64,
    /// In B.
    pub b: f64,
    /// B - A.
    pub difference: f64,
    /// Lower end of the difference's interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// What follows.
    pub verdict: Verdict,
}

/// All figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Measured frames of A and B.
    pub frames: [usize; 2],
    /// The rows.
    pub rows: Vec<Row>,
    /// No row says otherwise.
    pub is_equal: bool,
}

/// Fewer frames than this say nothing.
const FRAMES_MIN: usize = 20;
/// Times below this are the scatter of a wake-up, whatever their share, us.
const MARGIN_US: f64 = 10.0;
/// Of the whole frame: nobody acts on a stage that takes so much more or less of it.
const MARGIN_OF_FRAME: f64 = 0.005;
/// Dropped frames: below this share no difference is told.
const MARGIN_DROPPED: f64 = 0.01;

/// Values of one figure, by round.
struct Figure {
    name: String,
    statistic: Statistic,
    margin_floor: f64,
    rounds: [Vec<Vec<f64>>; 2],
}

/// Judges B against A by their measured frames, each in the order of rounds and sequences.
pub fn compare(
    a: &[FrameRecord],
    b: &[FrameRecord],
    options: &CompareOptions,
) -> Result<Comparison> {
    let rounds = [rounds(a), rounds(b)];
    let frames = rounds
        .each_ref()
        .map(|rounds| rounds.iter().map(Vec::len).sum());
    if let Some(&fewest) = frames.iter().min()
        && fewest < FRAMES_MIN
    {
        bail!("{fewest} measured frames: at least {FRAMES_MIN} are needed for a comparison");
    }
    let mut figures = figures(&rounds);
    if options.end_to_end_only {
        figures.retain(|figure| STAGES.iter().all(|stage| !figure.name.starts_with(stage)));
    }
    let judged = figures.iter().filter(|figure| figure.is_enough()).count();
    // Bonferroni: with so many rows one would stray by chance.
    let confidence = 1.0 - (1.0 - options.confidence) / judged.max(1) as f64;
    let mut random = Random::from_state(options.seed);
    let rows: Vec<Row> = figures
        .iter()
        .map(|figure| judge(figure, confidence, options, &mut random))
        .collect();
    let is_equal = rows
        .iter()
        .all(|row| !matches!(row.verdict, Verdict::Lower | Verdict::Higher));
    Ok(Comparison {
        frames,
        rows,
        is_equal,
    })
}

/// Measured frames of each round.
fn rounds(frames: &[FrameRecord]) -> Vec<Vec<FrameRecord>> {
    let mut rounds: Vec<Vec<FrameRecord>> = Vec::new();
    for frame in frames.iter().filter(|frame| !frame.is_warm_up) {
        match rounds.last_mut() {
            Some(round) if round[0].round == frame.round => round.push(frame.clone()),
            _ => rounds.push(vec![frame.clone()]),
        }
    }
    rounds
}

fn figures(rounds: &[Vec<Vec<FrameRecord>>; 2]) -> Vec<Figure> {
    let all = rounds.each_ref().map(|rounds| {
        let each = rounds.iter().map(|round| series(round));
        each.collect::<Vec<Series>>()
    });
    let first = all[0].iter().flat_map(|series| &series.latency_us);
    let frame_us = Statistic::Quantile(0.5).of(&mut first.copied().collect::<Vec<_>>());
    let margin_us = MARGIN_US.max(MARGIN_OF_FRAME * frame_us);
    let mut figures = Vec::new();
    let mut add = |name: &str, percents: &[u32], pick: &dyn Fn(&Series) -> Vec<f64>| {
        for percent in percents {
            let rounds = all.each_ref().map(|rounds| {
                let picked = rounds.iter().map(pick);
                picked.filter(|values| !values.is_empty()).collect()
            });
            figures.push(Figure {
                name: format!("{name} p{percent}, us"),
                statistic: Statistic::Quantile(f64::from(*percent) / 100.0),
                margin_floor: margin_us,
                rounds,
            });
        }
    };
    add("end to end", &[50, 90, 99], &|s| s.latency_us.clone());
    for (stage, name) in STAGES.iter().enumerate() {
        add(&format!("{name} run"), &[50, 99], &|s| {
            s.run_us[stage].clone()
        });
    }
    for (stage, name) in STAGES.iter().enumerate().skip(1) {
        add(&format!("{name} queue"), &[50], &|s| {
            s.queue_us[stage].clone()
        });
    }
    let is_dropped = |frame: &FrameRecord| f64::from(u8::from(!frame.is_out()));
    figures.push(Figure {
        name: "frames dropped, share".to_string(),
        statistic: Statistic::Mean,
        margin_floor: MARGIN_DROPPED,
        rounds: rounds.each_ref().map(|rounds| {
            let each = rounds.iter();
            each.map(|round| round.iter().map(is_dropped).collect())
                .collect()
        }),
    });
    figures
}

impl Figure {
    fn is_enough(&self) -> bool {
        let least = self.statistic.values_min();
        let counts = self
            .rounds
            .each_ref()
            .map(|rounds| rounds.iter().map(Vec::len).sum::<usize>());
        counts.iter().all(|&count| count >= least)
    }
}

fn judge(figure: &Figure, confidence: f64, options: &CompareOptions, random: &mut Random) -> Row {
    let is_enough = figure.is_enough();
    let resamples = if is_enough { options.resamples } else { 0 };
    let [a, b] = figure
        .rounds
        .each_ref()
        .map(|rounds| scatter(rounds, figure.statistic, resamples, random));
    let (low, high) = if is_enough {
        interval(&a, &b, confidence, options.start_scatter)
    } else {
        (f64::NEG_INFINITY, f64::INFINITY)
    };
    let margin = (options.margin * a.value.abs()).max(figure.margin_floor);
    let verdict = if !is_enough {
        Verdict::TooFewFrames
    } else if low > margin {
        Verdict::Higher
    } else if high < -margin {
        Verdict::Lower
    } else {
        Verdict::Noise
    };
    Row {
        figure: figure.name.clone(),
        a: a.value,
        b: b.value,
        difference: b.value - a.value,
        low,
        high,
        verdict,
    }
}

impl Comparison {
    /// As text for a terminal.
    pub fn table(&self, names: [&str; 2]) -> String {
        let mut text = format!(
            "A: {} ({} frames)\nB: {} ({} frames)\n\n",
            names[0], self.frames[0], names[1], self.frames[1]
        );
        text += &format!(
            "{:24}{:>12}{:>12}{:>12}{:>9}   {:26}\n",
            "", "A", "B", "B - A", "%", "interval of B - A"
        );
        for row in &self.rows {
            text += &row.line();
        }
        text + &format!("\n{}\n", self.sentence())
    }

    /// The verdict in words.
    pub fn sentence(&self) -> String {
        let of = |wanted: Verdict| -> Vec<&str> {
            let rows = self.rows.iter().filter(|row| row.verdict == wanted);
            rows.map(|row| row.figure.as_str()).collect()
        };
        let (lower, higher) = (of(Verdict::Lower), of(Verdict::Higher));
        match (lower.is_empty(), higher.is_empty()) {
            (true, true) => "equal: every difference is within the noise of these runs".to_string(),
            (false, true) => format!("different: B is lower in {}", lower.join("; ")),
            (true, false) => format!("different: B is higher in {}", higher.join("; ")),
            (false, false) => format!(
                "different: B is lower in {}, and higher in {}",
                lower.join("; "),
                higher.join("; ")
            ),
        }
    }
}

impl Row {
    fn line(&self) -> String {
        let digits = if self.figure.ends_with("us") { 0 } else { 3 };
        let percent = match self.a {
            0.0 => String::new(),
            a => format!("{:+.1}", 100.0 * self.difference / a),
        };
        let (interval, word) = match self.verdict {
            Verdict::TooFewFrames => ("-".to_string(), "too few frames"),
            verdict => {
                let word = match verdict {
                    Verdict::Lower => "LOWER",
                    Verdict::Higher => "HIGHER",
                    _ => "noise",
                };
                (
                    format!("{:+.digits$} to {:+.digits$}", self.low, self.high),
                    word,
                )
            }
        };
        format!(
            "{:24}{:12.digits$}{:12.digits$}{:+12.digits$}{percent:>9}   {interval:26} {word}\n",
            self.figure, self.a, self.b, self.difference
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame::testing::{dropped, frame};

    /// Runs of 10 ms a stage that scatter by a tenth, slower by `more_us`.
    fn run(frames: u64, seed: u64, more_us: i64) -> Vec<FrameRecord> {
        let mut random = Random::from_state(seed);
        (0..frames)
            .map(|sequence| frame(sequence, 10_000 + more_us + random.below(1000) as i64))
            .collect()
    }

    fn verdict_of(comparison: &Comparison, figure: &str) -> Verdict {
        comparison
            .rows
            .iter()
            .find(|row| row.figure == figure)
            .unwrap()
            .verdict
    }

    #[test]
    fn equal_runs_are_equal_and_a_shift_is_found() {
        let options = CompareOptions::default();
        let equal = (0..40)
            .filter(|&n| {
                compare(&run(200, 2 * n, 0), &run(200, 2 * n + 1, 0), &options)
                    .unwrap()
                    .is_equal
            })
            .count();
        assert!(equal >= 38, "{equal} of 40");
        let shifted = compare(&run(200, 1, 0), &run(200, 2, 1500), &options).unwrap();
        assert_eq!(verdict_of(&shifted, "end to end p50, us"), Verdict::Higher);
        assert_eq!(
            verdict_of(&shifted, "backbone run p50, us"),
            Verdict::Higher
        );
        assert_eq!(
            verdict_of(&shifted, "backbone queue p50, us"),
            Verdict::Noise
        );
        assert!(
            shifted
                .sentence()
                .starts_with("different: B is higher in end to end p50")
        );
        let back = compare(&run(200, 2, 1500), &run(200, 1, 0), &options).unwrap();
        assert_eq!(verdict_of(&back, "end to end p50, us"), Verdict::Lower);
    }

    #[test]
    fn a_difference_that_nobody_would_act_on_is_noise() {
        let comparison = compare(
            &run(3000, 1, 0),
            &run(3000, 2, 60),
            &CompareOptions::default(),
        )
        .unwrap();
        assert!(comparison.is_equal, "{}", comparison.table(["a", "b"]));
    }

    #[test]
    fn dropped_frames_are_a_difference() {
        let mut losing = run(200, 1, 0);
        for sequence in (0..200).step_by(5) {
            losing[sequence] = dropped(sequence as u64);
        }
        let comparison = compare(&run(200, 2, 0), &losing, &CompareOptions::default()).unwrap();
        assert_eq!(
            verdict_of(&comparison, "frames dropped, share"),
            Verdict::Higher
        );
        assert_eq!(
            verdict_of(&comparison, "end to end p90, us"),
            Verdict::Higher
        );
        assert_eq!(verdict_of(&comparison, "head run p50, us"), Verdict::Noise);
    }

    #[test]
    fn too_few_frames_are_said() {
        let error =
            compare(&run(19, 1, 0), &run(30, 2, 0), &CompareOptions::default()).unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("19 measured") && text.contains("at least 20"),
            "{text}"
        );
        let few = compare(&run(200, 1, 0), &run(200, 2, 0), &CompareOptions::default()).unwrap();
        assert_eq!(
            verdict_of(&few, "end to end p99, us"),
            Verdict::TooFewFrames
        );
        let many = compare(&run(600, 1, 0), &run(600, 2, 0), &CompareOptions::default()).unwrap();
        assert_eq!(verdict_of(&many, "end to end p99, us"), Verdict::Noise);
    }

    #[test]
    fn the_same_reports_give_the_same_words() {
        let (a, b) = (run(200, 1, 0), run(200, 2, 100));
        let once = || {
            compare(&a, &b, &CompareOptions::default())
                .unwrap()
                .table(["a", "b"])
        };
        assert_eq!(once(), once());
    }
}
