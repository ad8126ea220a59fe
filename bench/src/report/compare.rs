//! Decides whether two runs differ or whether the difference is noise.

use super::bootstrap::{Statistic, interval, scatter};
use super::frame::{FrameRecord, STAGES, measured};
use super::{page::render, series::Series, series::series};
use anyhow::{Result, ensure};
use mluc_geometry::Random;
use serde::Serialize;
use serde_json::Value;

/// Family-wise confidence: the probability that no row's interval misses the true difference.
const CONFIDENCE: f64 = 0.95;
/// Draws of the bootstrap, and their seed.
const RESAMPLES: usize = 1000;
const SEED: u64 = 1;
/// Relative scatter between starts on a quiet machine: placement of pages and threads differs. Measured over starts: 1 to 2 %.
const START_SCATTER: f64 = 0.015;
/// Scatter that other work adds if it keeps all cores busy: contention for caches and the memory bus differs between runs.
/// Measured with two thirds of the cores taken: 6 % end to end.
const START_SCATTER_BUSY: f64 = 0.12;
/// Fewest measured frames for a comparison.
pub(crate) const FRAMES_MIN: usize = 20;
/// A difference of times below this is wake-up scatter, whatever its share, us.
const MARGIN_US: f64 = 10.0;
/// A difference of times below this share of a frame's latency is noise: nobody acts on it.
const MARGIN_OF_FRAME: f64 = 0.005;
/// Dropped frames: below this share no difference is reported.
const MARGIN_DROPPED: f64 = 0.01;
/// A difference below this share of the figure counts as noise, however certain it is.
const MARGIN: f64 = 0.02;

/// Verdict of a row: B versus A.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    /// The interval of the difference reaches into the margin around 0.
    Noise,
    /// B is lower: the whole interval lies below the margin around 0.
    Lower,
    Higher,
    /// Too few frames lie beyond this quantile.
    TooFewFrames,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Row {
    /// Which figure, with its unit.
    pub(crate) figure: String,
    pub(crate) a: f64,
    pub(crate) b: f64,
    pub(crate) difference: f64,
    /// Ends of the difference's interval.
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) verdict: Verdict,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Comparison {
    /// Measured frames of A and B.
    pub(crate) frames: [usize; 2],
    pub(crate) rows: Vec<Row>,
    /// No row's verdict is lower or higher.
    pub(crate) is_equal: bool,
}

struct Figure {
    name: String,
    statistic: Statistic,
    margin_floor: f64,
    rounds: [Vec<Vec<f64>>; 2],
}

/// Compares B with A by their measured frames, each in the order of rounds and sequences. `others`: share of all cores that other processes took in the
/// runs; it sets the assumed scatter between two starts of the same program for a report with fewer than four starts.
pub(crate) fn compare(runs: [&[FrameRecord]; 2], others: f64) -> Result<Comparison> {
    let runs = runs.map(measured);
    let frames = runs.each_ref().map(Vec::len);
    let fewest = frames[0].min(frames[1]);
    ensure!(
        fewest >= FRAMES_MIN,
        "{fewest} measured frames: at least {FRAMES_MIN} are needed for a comparison"
    );
    let rounds =
        runs.map(|frames| frames.chunk_by(|a, b| a.round == b.round).map(series).collect());
    let figures = figures(&rounds);
    let judged = figures.iter().filter(|figure| figure.is_enough()).count();
    // Bonferroni correction: with this many rows, one would differ by chance.
    let confidence = 1.0 - (1.0 - CONFIDENCE) / judged.max(1) as f64;
    let mut random = Random::from_state(SEED);
    let judge = |figure: Figure| figure.judge(confidence, others, &mut random);
    let rows: Vec<Row> = figures.into_iter().map(judge).collect();
    let differs = |row: &Row| matches!(row.verdict, Verdict::Lower | Verdict::Higher);
    Ok(Comparison { frames, is_equal: !rows.iter().any(differs), rows })
}

fn figures(runs: &[Vec<Series>; 2]) -> Vec<Figure> {
    let first = runs[0].iter().flat_map(|series| &series.latency_us);
    let frame_us = Statistic::Quantile(0.5).of(&mut first.copied().collect::<Vec<_>>());
    let margin_us = MARGIN_US.max(MARGIN_OF_FRAME * frame_us);
    let values = |pick: &dyn Fn(&Series) -> &Vec<f64>| {
        runs.each_ref().map(|rounds| {
            let picked = rounds.iter().map(|series| pick(series).clone());
            picked.filter(|values| !values.is_empty()).collect()
        })
    };
    let mut figures = Vec::new();
    let mut add_times = |name: &str, percents: &[u32], pick: &dyn Fn(&Series) -> &Vec<f64>| {
        figures.extend(percents.iter().map(|&percent| Figure {
            name: format!("{name} p{percent}, us"),
            statistic: Statistic::Quantile(f64::from(percent) / 100.0),
            margin_floor: margin_us,
            rounds: values(pick),
        }));
    };
    add_times("end to end", &[50, 90, 99], &|s| &s.latency_us);
    for (stage, name) in STAGES.iter().enumerate() {
        add_times(&format!("{name} run"), &[50, 99], &|s| &s.run_us[stage]);
    }
    for (stage, name) in STAGES.iter().enumerate().skip(1) {
        add_times(&format!("{name} queue"), &[50], &|s| &s.queue_us[stage]);
    }
    figures.push(Figure {
        name: "frames dropped, share".to_string(),
        statistic: Statistic::Mean,
        margin_floor: MARGIN_DROPPED,
        rounds: values(&|s| &s.is_dropped),
    });
    figures
}

impl Figure {
    fn is_enough(&self) -> bool {
        let least = self.statistic.values_min();
        let count = |rounds: &Vec<Vec<f64>>| rounds.iter().map(Vec::len).sum::<usize>();
        self.rounds.iter().all(|rounds| count(rounds) >= least)
    }

    fn judge(self, confidence: f64, others: f64, random: &mut Random) -> Row {
        let is_enough = self.is_enough();
        let resamples = if is_enough { RESAMPLES } else { 0 };
        let scatter = |rounds: &Vec<_>| scatter(rounds, self.statistic, resamples, random);
        let [a, b] = self.rounds.each_ref().map(scatter);
        let margin = (MARGIN * a.value.abs()).max(self.margin_floor);
        let all = (f64::NEG_INFINITY, f64::INFINITY);
        let start_scatter = START_SCATTER + START_SCATTER_BUSY * others;
        let interval = || interval([&a, &b], confidence, start_scatter);
        let (low, high) = is_enough.then(interval).unwrap_or(all);
        let verdict = match () {
            () if !is_enough => Verdict::TooFewFrames,
            () if low > margin => Verdict::Higher,
            () if high < -margin => Verdict::Lower,
            () => Verdict::Noise,
        };
        Row {
            figure: self.name,
            a: a.value,
            b: b.value,
            difference: b.value - a.value,
            low,
            high,
            verdict,
        }
    }
}

impl Comparison {
    pub(crate) fn sentence(&self) -> String {
        if self.is_equal {
            return "equal: no difference is surely beyond its margin".to_string();
        }
        let mut parts = Vec::new();
        for (verdict, word) in [(Verdict::Lower, "lower"), (Verdict::Higher, "higher")] {
            let rows = self.rows.iter().filter(|row| row.verdict == verdict);
            let figures: Vec<&str> = rows.map(|row| row.figure.as_str()).collect();
            if !figures.is_empty() {
                parts.push(format!("{word} in {}", figures.join("; ")));
            }
        }
        format!("different: B is {}", parts.join(", and "))
    }
}

/// The comparison for a terminal: the rows, the verdict as a sentence, and what weakens it.
pub(crate) fn comparison_table(value: Value) -> Result<String> {
    render("comparison.txt", include_str!("comparison.txt"), value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame::testing::{dropped, frame};

    /// Runs of 10 ms a stage that scatter by a tenth, slower by `more_us`.
    fn run(frames: u64, seed: u64, more_us: i64) -> Vec<FrameRecord> {
        let mut random = Random::from_state(seed);
        let mut run_us = || 10_000 + more_us + random.below(1000) as i64;
        let one = |sequence| frame(sequence, run_us());
        (0..frames).map(one).collect()
    }

    fn judged(a: &[FrameRecord], b: &[FrameRecord]) -> Comparison {
        compare([a, b], 0.0).unwrap()
    }

    fn assert_verdicts(comparison: &Comparison, expected: &[(&str, Verdict)]) {
        for (figure, verdict) in expected {
            let row = comparison.rows.iter().find(|row| row.figure == *figure);
            assert_eq!(row.unwrap().verdict, *verdict, "{figure}");
        }
    }

    #[test]
    fn a_shift_is_found_in_both_directions() {
        let (quick, slow) = (run(200, 1, 0), run(200, 2, 1500));
        let (shifted, back) = (judged(&quick, &slow), judged(&slow, &quick));
        assert_verdicts(&shifted, &[("backbone queue p50, us", Verdict::Noise)]);
        for figure in ["end to end p50, us", "backbone run p50, us"] {
            assert_verdicts(&shifted, &[(figure, Verdict::Higher)]);
            assert_verdicts(&back, &[(figure, Verdict::Lower)]);
        }
        let sentence = shifted.sentence();
        assert!(sentence.starts_with("different: B is higher in end to end p50"));
    }

    #[test]
    fn a_difference_that_nobody_would_act_on_is_noise() {
        let (a, b) = (run(3000, 1, 0), run(3000, 2, 60));
        let comparison = judged(&a, &b);
        assert!(comparison.is_equal, "{comparison:?}");
        assert_eq!(judged(&a, &b), comparison, "the same words every time");
    }

    #[test]
    fn dropped_frames_are_a_difference() {
        let mut losing = run(200, 1, 0);
        for sequence in (0..200).step_by(5) {
            losing[sequence] = dropped(sequence as u64);
        }
        let verdicts = [
            ("frames dropped, share", Verdict::Higher),
            ("end to end p90, us", Verdict::Higher),
            ("head run p50, us", Verdict::Noise),
        ];
        assert_verdicts(&judged(&run(200, 2, 0), &losing), &verdicts);
    }

    #[test]
    fn too_few_frames_are_said() {
        let error = compare([&run(19, 1, 0), &run(30, 2, 0)], 0.0);
        let text = error.unwrap_err().to_string();
        assert!(text.contains("19 measured frames: at least 20"), "{text}");
        for (frames, verdict) in [(200, Verdict::TooFewFrames), (600, Verdict::Noise)] {
            let comparison = judged(&run(frames, 1, 0), &run(frames, 2, 0));
            assert_verdicts(&comparison, &[("end to end p99, us", verdict)]);
        }
    }
}
