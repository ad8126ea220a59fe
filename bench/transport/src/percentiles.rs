//! Percentiles of all values, none of them binned.

use serde::Serialize;

/// Of one quantity, us.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
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

impl Percentiles {
    /// By nearest rank; zeros without values.
    pub fn of_ns(mut values_ns: Vec<u64>) -> Percentiles {
        values_ns.sort_unstable();
        let count = values_ns.len();
        let at = |share: f64| {
            let rank = (share * count as f64).ceil() as usize;
            let value = values_ns.get(rank.clamp(1, count.max(1)) - 1);
            value.copied().unwrap_or(0) as f64 / 1e3
        };
        Percentiles {
            count,
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
    fn nearest_rank() {
        let hundred = Percentiles::of_ns((1..=100).rev().map(|us| us * 1000).collect());
        let found = [
            hundred.p50_us,
            hundred.p90_us,
            hundred.p99_us,
            hundred.max_us,
        ];
        assert_eq!(found, [50.0, 90.0, 99.0, 100.0]);
        let one = Percentiles::of_ns(vec![7000]);
        assert_eq!((one.count, one.p50_us, one.p99_us), (1, 7.0, 7.0));
        assert_eq!(Percentiles::of_ns(vec![]), Percentiles::default());
    }
}
