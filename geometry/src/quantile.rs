//! The one quantile of the workspace.

/// The smallest value that at least a share `q` of all values does not exceed (nearest rank). `ascending` is sorted; `None` when it
/// is empty.
pub fn quantile(ascending: &[f64], q: f64) -> Option<f64> {
    // The small number absorbs rounding: 0.9 of 10 values is rank 9, not 10.
    let rank = (q * ascending.len() as f64 - 1e-9).ceil().max(1.0) as usize;
    ascending.get(rank - 1).copied()
}

/// The same of values in any order.
pub fn quantile_of(mut values: Vec<f64>, q: f64) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    quantile(&values, q)
}

#[cfg(test)]
mod tests {
    use super::*;

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
