//! Quantiles of what was measured, every value kept: no histogram rounds the tail.

use mluc_geometry::quantile;
use serde::Serialize;

/// Quantiles and the largest value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Percentiles {
    pub(crate) p50: f64,
    pub(crate) p90: f64,
    pub(crate) p99: f64,
    /// 999 of 1000 are at most this; with fewer than 1000 values: the largest.
    pub(crate) p999: f64,
    pub(crate) max: f64,
}

impl Percentiles {
    /// Of any number of values in any order; `None` without values.
    pub(crate) fn of(values: &[f64]) -> Option<Percentiles> {
        let ascending = sorted(values);
        // Thousandths are beyond any clock here.
        let at = |q: f64| Some((quantile(&ascending, q)? * 1000.0).round() / 1000.0);
        Some(Percentiles {
            p50: at(0.50)?,
            p90: at(0.90)?,
            p99: at(0.99)?,
            p999: at(0.999)?,
            max: at(1.0)?,
        })
    }
}

/// Ascending.
pub(crate) fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted
}
