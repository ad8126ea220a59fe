//! From evaluations to the rows of a report.

use crate::{evaluated::Evaluated, report::MethodFigures, report::SpreadKind};
use mluc_evaluate::{KNOWN_KEPT_MIN, SweepPoint};
use mluc_geometry::mean_and_spread;
use std::collections::BTreeMap;

/// One row from the evaluations of its seeds: the spread is over seeds where there are several, else over resamples of the frames.
pub(crate) fn combine(seeds: &[Evaluated]) -> Option<MethodFigures> {
    let first = seeds.first()?;
    // Points that keep nine tenths of the first point's mAP.
    let closed = first.curve.first().map_or(0.0, |point| point.map_known);
    let keeps = |point: &&SweepPoint| point.map_known >= KNOWN_KEPT_MIN * closed;
    let over_seeds = |of: &dyn Fn(&Evaluated) -> Vec<(String, f64)>| {
        let mut values: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        for (name, value) in seeds.iter().flat_map(of) {
            values.entry(name).or_default().push(value);
        }
        values.into_iter().map(|(name, v)| (name, mean_and_spread(&v))).collect()
    };
    let (spread, figures) = if seeds.len() > 1 {
        (SpreadKind::Seeds, over_seeds(&Evaluated::named))
    } else {
        // Figures without a bootstrap have a deviation of 0.
        let with_spread = |(name, value): (String, f64)| {
            let spread = first.bootstrap.get(&name).map_or(0.0, |f| f[1]);
            (name, [value, spread])
        };
        let figures = first.named().into_iter().map(with_spread);
        (SpreadKind::Bootstrap, figures.collect())
    };
    Some(MethodFigures {
        network: first.network.clone(),
        spread,
        seeds: seeds.iter().map(|e| e.seed).collect(),
        thresholds: seeds.iter().map(|e| e.threshold).collect(),
        classes: over_seeds(&|e| {
            e.figures.classes.iter().map(|c| (c.class.clone(), c.ap.r40)).collect()
        }),
        honest: over_seeds(&|e| {
            let honest = e.honest.iter().flat_map(|h| &h.figures);
            honest.map(|(name, value)| (name.clone(), *value)).collect()
        }),
        curve: first.curve.iter().filter(keeps).copied().collect(),
        figures,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evaluated(seed: u64, map_known: f64) -> Evaluated {
        let point = |map_known: f64| SweepPoint { map_known, ..SweepPoint::default() };
        let mut evaluated = Evaluated {
            seed,
            bootstrap: [("map_known".to_owned(), [map_known, 0.7])].into(),
            curve: [80.0, 75.0, 72.0, 71.0].map(point).to_vec(),
            ..Evaluated::default()
        };
        evaluated.figures.known.r40 = map_known;
        evaluated
    }

    #[test]
    fn one_seed_has_the_bootstraps_spread_and_several_have_their_own() {
        let one = combine(&[evaluated(1, 80.0)]).expect("a row");
        let two = combine(&[evaluated(1, 80.0), evaluated(2, 82.0)]).expect("a row");
        let kinds = [SpreadKind::Bootstrap, SpreadKind::Seeds];
        assert_eq!([one.spread, two.spread], kinds);
        assert_eq!(one.figures["map_known"], [80.0, 0.7]);
        assert_eq!(two.figures["map_known"], [81.0, 2f64.sqrt()]);
        assert_eq!((one.curve.len(), two.seeds), (3, vec![1, 2]));
        assert!(combine(&[]).is_none());
    }
}
