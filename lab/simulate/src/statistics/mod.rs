//! What a KITTI-format data set holds: sizes, distances and points of its objects, class by class, beside published figures of another.

mod collect;
mod reference;
mod table;

pub use collect::{Statistics, collect};
pub use reference::{Reference, read_reference};
pub use table::table;

/// Mean, deviation and percentiles of a list of numbers.
pub(crate) struct Summary {
    sorted: Vec<f64>,
}

impl Summary {
    /// From values in any order; those that are not finite are left out.
    pub(crate) fn new(mut values: Vec<f64>) -> Summary {
        values.retain(|v| v.is_finite());
        values.sort_by(f64::total_cmp);
        Summary { sorted: values }
    }

    /// How many.
    pub(crate) fn count(&self) -> usize {
        self.sorted.len()
    }

    /// Mean, 0 when empty.
    pub(crate) fn mean(&self) -> f64 {
        self.sorted.iter().sum::<f64>() / self.count().max(1) as f64
    }

    /// Standard deviation of the values themselves (not of a sample), 0 when empty.
    pub(crate) fn deviation(&self) -> f64 {
        let mean = self.mean();
        let squares: f64 = self.sorted.iter().map(|v| (v - mean) * (v - mean)).sum();
        (squares / self.count().max(1) as f64).sqrt()
    }

    /// Percentile 0..100, linear between neighbours; None when empty.
    pub(crate) fn percentile(&self, percent: f64) -> Option<f64> {
        let last = self.count().checked_sub(1)?;
        let at = (percent / 100.0).clamp(0.0, 1.0) * last as f64;
        let low = self.sorted[at.floor() as usize];
        let high = self.sorted[at.ceil() as usize];
        Some(low + (high - low) * at.fract())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summaries_of_known_numbers() {
        let s = Summary::new(vec![4.0, 2.0, f64::NAN, 6.0]);
        assert_eq!((s.count(), s.mean()), (3, 4.0));
        assert!((s.deviation() - (8.0f64 / 3.0).sqrt()).abs() < 1e-12);
        let percentiles = [0.0, 25.0, 50.0, 100.0].map(|p| s.percentile(p));
        assert_eq!(percentiles, [2.0, 3.0, 4.0, 6.0].map(Some));
        assert_eq!(Summary::new(vec![]).percentile(50.0), None);
    }
}
