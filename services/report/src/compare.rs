//! Whether two runs differ, or whether it is noise.

use serde::Serialize;

use crate::ReportError;
use crate::bootstrap::{Statistic, interval, scatter};
use crate::frame::{Frame, STAGES};
use crate::random::Random;
use crate::series::series;

/// How to judge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// With this probability none of the intervals misses, all rows together.
    pub confidence: f64,
    /// A difference below this share of the figure is noise to whoever decides, however sure it is.
    pub margin: f64,
    /// Relative standard deviation between two starts of the same program, where a report holds fewer than four starts: it
    /// cannot be seen in one. See [`Options::on_machines`].
    pub start_scatter: f64,
    /// Leaves the stages' own figures out: one of the runs has none.
    pub end_to_end_only: bool,
    /// Draws of the bootstrap.
    pub resamples: usize,
    /// Of the draws.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Options {
        Options {
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

impl Options {
    /// For runs during which other processes took these shares of all cores.
    pub fn on_machines(others: [f64; 2]) -> Options {
        let others = others[0].max(others[1]).clamp(0.0, 1.0);
        Options {
            start_scatter: START_SCATTER + START_SCATTER_BUSY * others,
            ..Options::default()
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
    is_end_to_end: bool,
    statistic: Statistic,
    margin_floor: f64,
    rounds: [Vec<Vec<f64>>; 2],
}

/// Judges B against A by their measured frames, each in the order of rounds and sequences.
pub fn compare(a: &[Frame], b: &[Frame], options: &Options) -> Result<Comparison, ReportError> {
    let rounds = [rounds(a), rounds(b)];
    let frames = rounds
        .each_ref()
        .map(|rounds| rounds.iter().map(Vec::len).sum());
    if let Some(&fewest) = frames.iter().min()
        && fewest < FRAMES_MIN
    {
        return Err(ReportError::TooFew {
            expected: FRAMES_MIN,
            frames: fewest,
        });
    }
    let mut figures = figures(&rounds);
    figures.retain(|figure| figure.is_end_to_end || !options.end_to_end_only);
    let judged = figures.iter().filter(|figure| figure.is_enough()).count();
    // Bonferroni: with so many rows one would stray by chance.
    let confidence = 1.0 - (1.0 - options.confidence) / judged.max(1) as f64;
    let mut random = Random(options.seed);
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
fn rounds(frames: &[Frame]) -> Vec<Vec<Frame>> {
    let mut rounds: Vec<Vec<Frame>> = Vec::new();
    for frame in frames.iter().filter(|frame| !frame.is_warm_up) {
        match rounds.last_mut() {
            Some(round) if round[0].round == frame.round => round.push(frame.clone()),
            _ => rounds.push(vec![frame.clone()]),
        }
    }
    rounds
}

fn figures(rounds: &[Vec<Vec<Frame>>; 2]) -> Vec<Figure> {
    let all = rounds.each_ref().map(|rounds| {
        let each = rounds.iter().map(|round| series(round));
        each.collect::<Vec<_>>()
    });
    let mut figures = Vec::new();
    let mut add =
        |name: String, statistic, margin_floor, pick: &dyn Fn(&crate::Series) -> Vec<f64>| {
            let rounds = all.each_ref().map(|rounds| {
                let picked = rounds.iter().map(pick);
                picked
                    .filter(|values| !values.is_empty())
                    .collect::<Vec<_>>()
            });
            figures.push(Figure {
                is_end_to_end: name.starts_with("end to end"),
                name,
                statistic,
                margin_floor,
                rounds,
            });
        };
    let mut frame_us = all[0]
        .iter()
        .flat_map(|s| s.latency_us.clone())
        .collect::<Vec<_>>();
    let margin_us = MARGIN_US.max(MARGIN_OF_FRAME * Statistic::Quantile(0.5).of(&mut frame_us));
    for (word, q) in [("p50", 0.5), ("p90", 0.9), ("p99", 0.99)] {
        add(
            format!("end to end {word}, us"),
            Statistic::Quantile(q),
            margin_us,
            &|s| s.latency_us.clone(),
        );
    }
    for (stage, name) in STAGES.iter().enumerate() {
        for (word, q) in [("p50", 0.5), ("p99", 0.99)] {
            add(
                format!("{name} run {word}, us"),
                Statistic::Quantile(q),
                margin_us,
                &|s| s.run_us[stage].clone(),
            );
        }
    }
    for (stage, name) in STAGES.iter().enumerate().skip(1) {
        add(
            format!("{name} queue p50, us"),
            Statistic::Quantile(0.5),
            margin_us,
            &|s| s.queue_us[stage].clone(),
        );
    }
    let dropped = rounds.each_ref().map(|rounds| {
        let of_round = |round: &Vec<Frame>| {
            round
                .iter()
                .map(|f| f64::from(u8::from(!f.is_out())))
                .collect()
        };
        rounds.iter().map(of_round).collect::<Vec<Vec<f64>>>()
    });
    figures.push(Figure {
        name: "frames dropped, share".to_string(),
        is_end_to_end: true,
        statistic: Statistic::Mean,
        margin_floor: MARGIN_DROPPED,
        rounds: dropped,
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

fn judge(figure: &Figure, confidence: f64, options: &Options, random: &mut Random) -> Row {
    let is_enough = figure.is_enough();
    let resamples = if is_enough { options.resamples } else { 0 };
    let [a, b] = figure
        .rounds
        .each_ref()
        .map(|rounds| scatter(rounds, figure.statistic, resamples, random));
    let (low, high) = match is_enough {
        true => interval(&a, &b, confidence, options.start_scatter),
        false => (f64::NEG_INFINITY, f64::INFINITY),
    };
    let margin = (options.margin * a.value.abs()).max(figure.margin_floor);
    let verdict = match () {
        () if !is_enough => Verdict::TooFewFrames,
        () if low > margin => Verdict::Higher,
        () if high < -margin => Verdict::Lower,
        () => Verdict::Noise,
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
    use crate::frame::testing::{dropped, frame};

    /// Runs of 10 ms a stage that scatter by a tenth, slower by `more_us`.
    fn run(frames: u64, seed: u64, more_us: i64) -> Vec<Frame> {
        let mut random = Random(seed);
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
        let options = Options::default();
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
        let comparison = compare(&run(3000, 1, 0), &run(3000, 2, 60), &Options::default()).unwrap();
        assert!(comparison.is_equal, "{}", comparison.table(["a", "b"]));
    }

    #[test]
    fn dropped_frames_are_a_difference() {
        let mut losing = run(200, 1, 0);
        for sequence in (0..200).step_by(5) {
            losing[sequence] = dropped(sequence as u64);
        }
        let comparison = compare(&run(200, 2, 0), &losing, &Options::default()).unwrap();
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
        let error = compare(&run(19, 1, 0), &run(30, 2, 0), &Options::default()).unwrap_err();
        assert_eq!(
            error,
            ReportError::TooFew {
                expected: 20,
                frames: 19
            }
        );
        let few = compare(&run(200, 1, 0), &run(200, 2, 0), &Options::default()).unwrap();
        assert_eq!(
            verdict_of(&few, "end to end p99, us"),
            Verdict::TooFewFrames
        );
        let many = compare(&run(600, 1, 0), &run(600, 2, 0), &Options::default()).unwrap();
        assert_eq!(verdict_of(&many, "end to end p99, us"), Verdict::Noise);
    }

    #[test]
    fn the_same_reports_give_the_same_words() {
        let (a, b) = (run(200, 1, 0), run(200, 2, 100));
        let once = || {
            compare(&a, &b, &Options::default())
                .unwrap()
                .table(["a", "b"])
        };
        assert_eq!(once(), once());
    }
}
