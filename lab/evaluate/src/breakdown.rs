//! Average precision by a property of the objects: their range, or the number of the sensor's rings that hit them.
//!
//! A label counts only in its own bin; in other bins it may be found or not. A detection that matches no label is wrong only in its own bin.

use crate::frame::range_m;
use crate::matching::{Binned, match_frame};
use crate::report::{ApEntry, render};
use crate::{ClassRule, Difficulty, LabelledFrame, Metric, curve::Curve, rings::FrameRings};
use mluc_dataset::Label;
use rayon::prelude::*;
use serde_json::{Map, Value, json};

/// Range bins, m: the end of each, and its name.
const RANGES_M: [(f64, &str); 4] =
    [(15.0, "0-15 m"), (30.0, "15-30 m"), (45.0, "30-45 m"), (f64::INFINITY, "45 m on")];

/// Bins by rings on an object: the maximum, and the name.
const RINGS: [(usize, &str); 6] =
    [(0, "0"), (1, "1"), (2, "2"), (4, "3-4"), (8, "5-8"), (usize::MAX, "9 on")];

/// AP of each class in each bin (3D boxes, difficulty hard).
#[derive(Clone, Debug)]
pub struct Breakdown {
    /// `range` or `rings`.
    pub by: &'static str,
    /// Names of the bins.
    pub bins: Vec<&'static str>,
    /// Each class with its figures by bin, in the order of the rules.
    pub classes: Vec<(String, Vec<ApEntry>)>,
}

impl Breakdown {
    /// AP by the distance of the box in the ground plane.
    pub fn by_range(frames: &[LabelledFrame], rules: &[ClassRule]) -> Breakdown {
        let bin = |label: &Label| {
            let range_m = range_m(&label.camera_box.upright());
            RANGES_M.iter().position(|(end, _)| range_m < *end).unwrap_or(3)
        };
        let binned = frames.iter().map(|frame| {
            [&frame.labels[..], &frame.detections].map(|all| all.iter().map(bin).collect())
        });
        let bins = RANGES_M.map(|(_, name)| name);
        Breakdown::of("range", &bins, frames, &binned.collect::<Vec<_>>(), rules)
    }

    /// AP by the rings on the box; `rings` are the rings of these frames.
    pub fn by_rings(set: &[LabelledFrame], rings: &[FrameRings], rules: &[ClassRule]) -> Breakdown {
        let found = |rings: &usize| RINGS.iter().position(|(most, _)| rings <= most);
        let bin = |rings: &usize| found(rings).unwrap_or(5);
        let binned = rings.iter().map(|frame| {
            [&frame.labels, &frame.detections].map(|all| all.iter().map(bin).collect())
        });
        let bins = RINGS.map(|(_, name)| name);
        Breakdown::of("rings", &bins, set, &binned.collect::<Vec<_>>(), rules)
    }

    fn of(
        by: &'static str,
        bins: &[&'static str],
        frames: &[LabelledFrame],
        binned: &[Binned],
        rules: &[ClassRule],
    ) -> Breakdown {
        let entry = |rule: &ClassRule, bin: usize| {
            let matched = |(frame, binned): (&LabelledFrame, &Binned)| {
                let bin = Some((binned, bin));
                match_frame(frame, rule, Metric::Space, Difficulty::Hard, bin)
            };
            let parts: Vec<Curve> = frames.par_iter().zip(binned).map(matched).collect();
            ApEntry::of(&Curve::of(&parts))
        };
        let class = |rule: &ClassRule| {
            let entries = (0..bins.len()).map(|bin| entry(rule, bin));
            (rule.name.clone(), entries.collect())
        };
        Breakdown { by, bins: bins.to_vec(), classes: rules.iter().map(class).collect() }
    }

    /// `{"car": {"0-15 m": {"labels": .., "ap_r40": .., "ap_all": .., "recall": ..}, ..}, ..}`, percent.
    pub fn to_json(&self) -> Value {
        let figures = |e: &ApEntry| json!({"labels": e.truth_count, "ap_r40": e.ap.r40, "ap_all": e.ap.all, "recall": e.recall_percent});
        let class = |(name, entries): &(String, Vec<ApEntry>)| {
            let named = self.bins.iter().zip(entries);
            let named = named.map(|(bin, entry)| ((*bin).to_owned(), figures(entry)));
            (name.clone(), Value::Object(named.collect()))
        };
        Value::Object(self.classes.iter().map(class).collect::<Map<_, _>>())
    }

    /// AP over all points, recall and labels, one row per class; `-` where no label counts.
    pub fn to_table(&self) -> String {
        let values = json!({"by": self.by, "bins": self.bins, "classes": self.classes});
        render(include_str!("breakdown.txt"), values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{found, frame, label};

    /// A car at this distance ahead.
    fn car(z_m: f64) -> Label {
        let mut label = label("Car", 0.0);
        label.camera_box.location_m = [0.0, 1.7, z_m];
        label
    }

    #[test]
    fn labels_count_and_false_detections_hurt_in_their_own_bin_alone() {
        let (near, far, ghost) = (car(10.0), car(29.9), car(40.0));
        let mut pushed = found(&far, "car", 0.8);
        // Found by a box whose own centre is in the next range bin.
        pushed.camera_box.location_m[2] = 30.2;
        let detections = vec![found(&near, "car", 0.9), pushed, found(&ghost, "car", 0.95)];
        let frames = [frame(vec![near, far], detections)];
        let rules = [ClassRule::known("car", 0.5)];
        let by_range = Breakdown::by_range(&frames, &rules);
        let figures = |b: &Breakdown| -> Vec<(usize, f64)> {
            b.classes[0].1.iter().map(|e| (e.truth_count, e.ap.all)).collect()
        };
        let expected = [(1, 100.0), (1, 100.0), (0, 0.0), (0, 0.0)];
        assert_eq!(figures(&by_range), expected);
        // The ghost has as many rings as the far car, and a higher score.
        let rings = [FrameRings { labels: vec![8, 1], detections: vec![9, 0, 1] }];
        let by_rings = Breakdown::by_rings(&frames, &rings, &rules);
        let mut expected = [(0, 0.0); 6];
        (expected[1], expected[4]) = ((1, 50.0), (1, 100.0));
        assert_eq!(figures(&by_rings), expected);
        assert_eq!(by_rings.to_json()["car"]["5-8"]["labels"], 1);
        assert!(by_rings.to_table().contains("50.0, 100.0 (1)"));
    }
}
