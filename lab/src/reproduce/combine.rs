//! From evaluations to the rows of a report.

use super::evaluated::Evaluated;
use crate::evaluate::mean_and_spread;
use crate::report::{CurvePoint, MethodFigures, SpreadKind};
use std::collections::BTreeMap;

/// Part of the closed set's mAP that a point of a curve must keep.
const KNOWN_KEPT_MIN: f64 = 0.9;

/// One row from the evaluations of its seeds: the spread is over seeds where there are several, else over draws of the frames.
pub(super) fn combine(seeds: &[Evaluated]) -> Option<MethodFigures> {
    let first = seeds.first()?;
    let several = seeds.len() > 1;
    let over_seeds = |of: &dyn Fn(&Evaluated) -> Vec<(String, f64)>| -> BTreeMap<String, [f64; 2]> {
        let mut values: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        for (name, value) in seeds.iter().flat_map(of) {
            values.entry(name).or_default().push(value);
        }
        values
            .into_iter()
            .map(|(name, v)| (name, mean_and_spread(&v)))
            .collect()
    };
    Some(MethodFigures {
        network: first.network.clone(),
        spread: match several {
            true => SpreadKind::Seeds,
            false => SpreadKind::Bootstrap,
        },
        seeds: seeds.iter().map(|e| e.seed).collect(),
        thresholds: seeds.iter().map(|e| e.threshold).collect(),
        classes: over_seeds(&|e| {
            e.figures
                .classes
                .iter()
                .map(|c| (c.class.clone(), c.ap.r40))
                .collect()
        }),
        honest: over_seeds(&|e| {
            let honest = e.honest.iter().flat_map(|h| &h.figures);
            honest.map(|(name, value)| (name.clone(), *value)).collect()
        }),
        curve: kept(&first.curve),
        figures: match several {
            true => over_seeds(&Evaluated::named),
            false => with_bootstrap(first),
        },
    })
}

/// Every figure; those that the bootstrap was not taken of have a deviation of 0.
fn with_bootstrap(evaluated: &Evaluated) -> BTreeMap<String, [f64; 2]> {
    let spread = |name: &str| {
        evaluated
            .bootstrap
            .get(name)
            .map_or(0.0, |figure| figure[1])
    };
    let named = evaluated.named().into_iter();
    named
        .map(|(name, value)| (name.clone(), [value, spread(&name)]))
        .collect()
}

/// Points that keep nine tenths of the first one's mAP.
fn kept(curve: &[CurvePoint]) -> Vec<CurvePoint> {
    let closed = curve.first().map_or(0.0, |point| point.map_known);
    let keeps = |point: &&CurvePoint| point.map_known >= KNOWN_KEPT_MIN * closed;
    curve.iter().filter(keeps).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{AveragePrecision, OpenSetFigures};

    fn evaluated(seed: u64, map_known: f64) -> Evaluated {
        let figures = OpenSetFigures {
            known: AveragePrecision {
                r40: map_known,
                ..AveragePrecision::default()
            },
            ..OpenSetFigures::default()
        };
        let point = |map_known: f64| CurvePoint {
            map_known,
            ..CurvePoint::default()
        };
        Evaluated {
            key: String::new(),
            method: "naive".into(),
            network: "softmax".into(),
            seed,
            threshold: 0.5,
            bootstrap: [("map_known".to_owned(), [map_known, 0.7])].into(),
            figures,
            strict: OpenSetFigures::default(),
            honest: None,
            curve: [80.0, 75.0, 72.0, 71.0].map(point).to_vec(),
            separation: Vec::new(),
            unknown_score_min: None,
            objects: Vec::new(),
        }
    }

    #[test]
    fn one_seed_has_the_bootstraps_spread_and_several_have_their_own() {
        let one = combine(&[evaluated(1, 80.0)]).expect("a row");
        assert_eq!(
            (one.spread, one.figures["map_known"]),
            (SpreadKind::Bootstrap, [80.0, 0.7])
        );
        assert_eq!(one.curve.len(), 3);
        let two = combine(&[evaluated(1, 80.0), evaluated(2, 82.0)]).expect("a row");
        assert_eq!(
            (two.spread, two.seeds.clone()),
            (SpreadKind::Seeds, vec![1, 2])
        );
        assert_eq!(two.figures["map_known"], [81.0, 2f64.sqrt()]);
        assert!(combine(&[]).is_none());
    }
}
