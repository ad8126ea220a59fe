//! The open-set figures: known and unknown in one number.

use super::{Difficulty, Kind, Metric, Report};

/// Harmonic mean of two percentages; 0 when both are.
pub fn harmonic_mean(known: f64, unknown: f64) -> f64 {
    if known + unknown > 0.0 {
        2.0 * known * unknown / (known + unknown)
    } else {
        0.0
    }
}

/// Open-set figures in percent: volumes, moderate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// Mean AP (40 positions) of the known classes that have labels.
    pub map_known: f64,
    /// Unknown labels found by any unknown detection.
    pub recall_unknown: f64,
    /// AP (40 positions) of the unknown.
    pub ap_unknown: f64,
    /// Harmonic mean of the known classes' mean AP and the unknown's AP.
    pub map_harm: f64,
    /// As `map_known`, all points.
    pub map_known_all: f64,
    /// As `ap_unknown`, all points.
    pub ap_unknown_all: f64,
    /// As `map_harm`, all points.
    pub map_harm_all: f64,
}

impl Summary {
    /// From a report; `None` when it has no unknown group.
    pub(crate) fn of(report: &Report) -> Option<Summary> {
        let unknown = report
            .classes
            .iter()
            .find(|class| class.rule.kind == Kind::Unknown)?;
        let entry = |class: &super::ClassReport| *class.entry(Metric::Space, Difficulty::Moderate);
        let known: Vec<_> = report
            .classes
            .iter()
            .filter(|class| class.rule.kind == Kind::Known && entry(class).truth_count > 0)
            .map(|class| entry(class).ap)
            .collect();
        let mean = |of: fn(&super::AveragePrecision) -> f64| {
            known.iter().map(of).sum::<f64>() / known.len().max(1) as f64
        };
        let (map_known, map_known_all) = (mean(|ap| ap.r40), mean(|ap| ap.all));
        let found = entry(unknown);
        Some(Summary {
            map_known,
            recall_unknown: found.recall_percent,
            ap_unknown: found.ap.r40,
            map_harm: harmonic_mean(map_known, found.ap.r40),
            map_known_all,
            ap_unknown_all: found.ap.all,
            map_harm_all: harmonic_mean(map_known_all, found.ap.all),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harmonic_means_of_the_paper() {
        for (known, unknown, expected) in
            [(79.4, 13.2, 22.64), (66.8, 9.7, 16.94), (75.3, 3.0, 5.77)]
        {
            assert!((harmonic_mean(known, unknown) - expected).abs() < 0.005);
        }
        assert_eq!(harmonic_mean(0.0, 0.0), 0.0);
    }
}
