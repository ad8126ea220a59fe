//! Quantiles of what was measured, every value kept: no histogram rounds the tail.

use serde::{Deserialize, Serialize};

/// Quantiles and the largest value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 90 of 100 are at most this.
    pub p90: f64,
    /// 99 of 100.
    pub p99: f64,
    /// 999 of 1000; with fewer than 1000 values: the largest.
    pub p999: f64,
    /// Largest.
    pub max: f64,
}

impl Percentiles {
    /// Of any number of values in any order; `None` without values.
    pub fn of(values: &[f64]) -> Option<Percentiles> {
        let sorted = sorted(values);
        Some(
            Percentiles {
                p50: quantile(&sorted, 0.50)?,
                p90: quantile(&sorted, 0.90)?,
                p99: quantile(&sorted, 0.99)?,
                p999: quantile(&sorted, 0.999)?,
                max: *sorted.last()?,
            }
            .rounded(),
        )
    }

    /// Thousandths are beyond any clock here.
    fn rounded(self) -> Percentiles {
        let round = |v: f64| (v * 1000.0).round() / 1000.0;
        Percentiles {
            p50: round(self.p50),
            p90: round(self.p90),
            p99: round(self.p99),
            p999: round(self.p999),
            max: round(self.max),
        }
    }
}

/// Ascending.
pub(crate) fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// The smallest value that at least a share `q` of all values does not exceed (nearest rank), of ascending values.
pub fn quantile(ascending: &[f64], q: f64) -> Option<f64> {
    let rank = (q * ascending.len() as f64 - 1e-9).ceil().max(1.0) as usize;
    ascending.get(rank - 1).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_by_nearest_rank() {
        let thousand: Vec<f64> = (1..=1000).rev().map(f64::from).collect();
        let all = Percentiles::of(&thousand).unwrap();
        assert_eq!(
            (all.p50, all.p90, all.p99, all.p999, all.max),
            (500.0, 900.0, 990.0, 999.0, 1000.0)
        );
        let one = Percentiles::of(&[7.0]).unwrap();
        assert_eq!((one.p50, one.p999, one.max), (7.0, 7.0, 7.0));
        assert_eq!(Percentiles::of(&[]), None);
        assert_eq!(quantile(&[1.0, 2.0], 0.5), Some(1.0));
        assert_eq!(quantile(&[1.0, 2.0], 0.51), Some(2.0));
    }
}
