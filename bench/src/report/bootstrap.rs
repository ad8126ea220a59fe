//! Estimates the scatter of a run's statistic by resampling blocks of consecutive frames.
//!
//! Neighbouring frames are correlated (a busy neighbour process lasts longer than a frame), so single frames must not be
//! drawn: the interval would be far too narrow. Drawing whole blocks keeps that dependence (circular block bootstrap, Politis and
//! Romano 1992). Blocks are a tenth of a round, so that slow drift within a run widens the interval as well.

use mluc_geometry::{Random, mean_and_spread, resample};

/// Blocks that make up a round; the degrees of freedom of the interval come from it.
const BLOCKS_PER_ROUND: usize = 10;
/// From this number of rounds on, whole rounds are drawn too: the interval then includes the scatter between process starts.
const ROUNDS_MIN: usize = 4;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Statistic {
    Quantile(f64),
    Mean,
}

impl Statistic {
    /// The statistic of values in any order, which are reordered; 0 without values.
    pub(crate) fn of(self, values: &mut [f64]) -> f64 {
        match self {
            _ if values.is_empty() => 0.0,
            Statistic::Mean => values.iter().sum::<f64>() / values.len() as f64,
            Statistic::Quantile(q) => {
                let rank = (q * values.len() as f64 - 1e-9).ceil().max(1.0) as usize;
                *values.select_nth_unstable_by(rank - 1, f64::total_cmp).1
            }
        }
    }

    /// Number of values that the statistic needs to be meaningful: five beyond the quantile.
    pub(crate) fn values_min(self) -> usize {
        match self {
            Statistic::Mean => 1,
            Statistic::Quantile(q) => (5.0 / (1.0 - q).min(q) - 1e-9).ceil() as usize,
        }
    }
}

/// A statistic over resamples.
pub(crate) struct Scatter {
    /// The statistic of the original values.
    pub(crate) value: f64,
    resampled: Vec<f64>,
    blocks: usize,
    /// Whole rounds were drawn: the scatter between starts is included.
    by_round: bool,
}

/// `rounds`: the values of each round in the order of time.
pub(crate) fn scatter(
    rounds: &[Vec<f64>],
    statistic: Statistic,
    resamples: usize,
    random: &mut Random,
) -> Scatter {
    let by_round = rounds.len() >= ROUNDS_MIN;
    let mut drawn: Vec<f64> = rounds.concat();
    let blocks =
        if by_round { rounds.len() } else { drawn.len().min(BLOCKS_PER_ROUND * rounds.len()) };
    let value = statistic.of(&mut drawn);
    let mut draw = |_| {
        drawn.clear();
        for mut round in rounds {
            if by_round {
                round = &rounds[random.below(rounds.len())];
            }
            let length = round.len().div_ceil(BLOCKS_PER_ROUND).max(1);
            let places = resample(round.len(), length, random);
            drawn.extend(places.iter().map(|&i| round[i]));
        }
        statistic.of(&mut drawn)
    };
    Scatter { value, resampled: (0..resamples).map(&mut draw).collect(), blocks, by_round }
}

/// The interval in which `b - a` lies with `confidence`; `a` and `b` were resampled independently. `start_scatter`: relative
/// standard deviation between starts, which one start cannot show.
pub(crate) fn interval(runs: [&Scatter; 2], confidence: f64, start_scatter: f64) -> (f64, f64) {
    let [a, b] = runs;
    let difference = b.value - a.value;
    let pairs = a.resampled.iter().zip(&b.resampled);
    let [_, spread] = mean_and_spread(&pairs.map(|(a, b)| b - a).collect::<Vec<_>>());
    // Resampling k blocks gives (k - 1) / k of the variance.
    let fewest = a.blocks.min(b.blocks).max(2) as f64;
    let seen = spread.powi(2) * fewest / (fewest - 1.0);
    let one_start = runs.into_iter().filter(|run| !run.by_round);
    let unseen: f64 = one_start.map(|run| (start_scatter * run.value).powi(2)).sum();
    let freedom = (a.blocks + b.blocks).max(4) as f64 - 2.0;
    let half = student(normal(0.5 + confidence / 2.0), freedom) * (seen + unseen).sqrt();
    (difference - half, difference + half)
}

/// The normal distribution's quantile (Abramowitz and Stegun 26.2.23, error below 4.5e-4), for `p` above 0.5.
fn normal(p: f64) -> f64 {
    let t = (-2.0 * (1.0 - p).max(1e-12).ln()).sqrt();
    let above = 2.515_517 + t * (0.802_853 + t * 0.010_328);
    let below = 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308));
    t - above / below
}

/// Student's quantile from the normal one (Abramowitz and Stegun 26.7.5, three terms).
fn student(z: f64, freedom: f64) -> f64 {
    let (z3, z5) = (z.powi(3), z.powi(5));
    z + (z3 + z) / (4.0 * freedom) + (5.0 * z5 + 16.0 * z3 + 3.0 * z) / (96.0 * freedom * freedom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_distributions_are_the_tables() {
        for (p, z) in [(0.975, 1.959_96), (0.995, 2.575_83), (0.999_5, 3.290_53)] {
            assert!((normal(p) - z).abs() < 1e-3, "{p}");
        }
        for (freedom, t) in [(8.0, 2.306), (18.0, 2.101), (38.0, 2.024)] {
            assert!((student(1.959_96, freedom) - t).abs() < 6e-3, "{freedom}");
        }
    }

    #[test]
    fn a_statistic_selects_by_rank_and_asks_for_enough() {
        let mut values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!(Statistic::Quantile(0.9).of(&mut values), 90.0);
        assert_eq!(Statistic::Mean.of(&mut values), 50.5);
        assert_eq!(Statistic::Quantile(0.5).of(&mut []), 0.0);
        let least = [0.5, 0.9, 0.99].map(|q| Statistic::Quantile(q).values_min());
        assert_eq!(least, [10, 50, 500]);
    }

    /// Values that drift like a machine whose other load comes and goes: the interval of single draws would be a third of what the runs really scatter.
    #[test]
    fn the_interval_of_dependent_values_covers_their_scatter() {
        let mut random = Random::from_state(7);
        let mut uniform = move || random.unit() - 0.5;
        let mut run = || -> Vec<f64> {
            let mut drift = 0.0;
            let value = |_| {
                drift = 0.8 * drift + uniform();
                100.0 + drift + uniform()
            };
            (0..200).map(value).collect()
        };
        let mut draws = Random::from_state(1);
        let mut covered = 0;
        let mut widths = Vec::new();
        for _ in 0..200 {
            let mut scatter = |run| scatter(&[run], Statistic::Quantile(0.5), 200, &mut draws);
            let [a, b] = [scatter(run()), scatter(run())];
            let (low, high) = interval([&a, &b], 0.95, 0.0);
            covered += usize::from(low <= 0.0 && 0.0 <= high);
            widths.push(high - low);
        }
        assert!((180..=200).contains(&covered), "{covered} of 200");
        let width = Statistic::Quantile(0.5).of(&mut widths);
        assert!(width < 2.0, "{width}");
    }
}
