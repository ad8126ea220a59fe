//! Quantile and bootstrap (Efron 1979; circular blocks: Politis and Romano 1992), and the mean with the standard deviation.

use crate::Random;

/// The smallest value that at least a share `q` of all values does not exceed (nearest rank). `ascending` is sorted; `None` when it is empty.
pub fn quantile(ascending: &[f64], q: f64) -> Option<f64> {
    // The small number absorbs rounding: 0.9 of 10 values is rank 9, not 10.
    let rank = (q * ascending.len() as f64 - 1e-9).ceil().max(1.0) as usize;
    ascending.get(rank - 1).copied()
}

/// [`quantile`] of values in any order.
pub fn quantile_of(mut values: Vec<f64>, q: f64) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    quantile(&values, q)
}

/// Draws `count` indices in runs of `block` neighbours (1 to `count`). A run begins anywhere and continues from the last index at the first, so
/// that every index is equally likely. A run keeps dependent neighbours together. Runs of 1 are the plain bootstrap.
pub fn resample(count: usize, block: usize, random: &mut Random) -> Vec<usize> {
    let mut drawn = Vec::with_capacity(count);
    while drawn.len() < count {
        let first = random.below(count);
        drawn.extend((first..first + block.min(count - drawn.len())).map(|at| at % count));
    }
    drawn
}

/// Mean and standard deviation (n - 1) of some values; the deviation of fewer than two is 0.
pub fn mean_and_spread(values: &[f64]) -> [f64; 2] {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    [mean, (squares / (count - 1.0).max(1.0)).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_draw_has_as_many_in_runs_and_depends_on_the_seed() {
        let draw = |seed, block| resample(1000, block, &mut Random::from_state(seed));
        let mut seen = draw(1, 1);
        seen.sort_unstable();
        seen.dedup();
        // 1 - 1/e of them: 632 on average, with a standard deviation of 10.
        assert!((587..=677).contains(&seen.len()), "{}", seen.len());
        assert!(draw(1, 1) == draw(1, 1) && draw(1, 1) != draw(2, 1));
        let runs = draw(1, 70);
        assert_eq!(runs.len(), 1000);
        let joins = |pair: &[usize]| (pair[0] + 1) % 1000 == pair[1];
        assert!(runs.chunks(70).all(|run| run.windows(2).all(joins)));
        assert!(resample(0, 1, &mut Random::from_state(1)).is_empty());
    }

    #[test]
    fn quantiles_are_by_nearest_rank() {
        let thousand: Vec<f64> = (1..=1000).rev().map(f64::from).collect();
        for (q, expected) in [(0.5, 500.0), (0.9, 900.0), (0.999, 999.0), (1.0, 1000.0)] {
            assert_eq!(quantile_of(thousand.clone(), q), Some(expected));
        }
        assert_eq!(quantile(&[7.0], 0.0), Some(7.0));
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(quantile(&[1.0, 2.0], 0.5), Some(1.0));
        assert_eq!(quantile(&[1.0, 2.0], 0.51), Some(2.0));
    }
}
