//! Percentiles of all values, none of them binned.

use mluc_geometry::quantile;
use serde::Serialize;

/// Of one quantity, us.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatencyPercentiles {
    /// Values.
    pub count: usize,
    /// Half are at most this.
    pub p50_us: f64,
    /// 90 in 100.
    pub p90_us: f64,
    /// 99 in 100.
    pub p99_us: f64,
    /// 999 in 1000.
    pub p999_us: f64,
    /// All.
    pub max_us: f64,
}

impl LatencyPercentiles {
    /// By nearest rank; zeros without values.
    pub fn of_ns(values_ns: &[u64]) -> LatencyPercentiles {
        let mut ascending: Vec<f64> = values_ns.iter().map(|&ns| ns as f64 / 1e3).collect();
        ascending.sort_unstable_by(f64::total_cmp);
        let at = |q: f64| quantile(&ascending, q).unwrap_or(0.0);
        LatencyPercentiles {
            count: ascending.len(),
            p50_us: at(0.5),
            p90_us: at(0.9),
            p99_us: at(0.99),
            p999_us: at(0.999),
            max_us: at(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zeros_without_values() {
        assert_eq!(
            LatencyPercentiles::of_ns(&[]),
            LatencyPercentiles::default()
        );
        let two = LatencyPercentiles::of_ns(&[9000, 7000]);
        assert_eq!((two.count, two.p50_us, two.max_us), (2, 7.0, 9.0));
    }
}
