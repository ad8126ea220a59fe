//! The rows of the paper's tables and its own figures ("Open-set 3D Object Detection", tables 1 and 2; percent).

/// The paper's mAP of the known, AP of the unknown and their harmonic mean.
pub type PaperFigures = [f64; 3];

/// A row of the tables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MethodRow {
    /// Key in `report.json`.
    pub key: &'static str,
    /// Name for people.
    pub title: &'static str,
    /// Where it stands: metric learning, unsupervised clustering (table 1); `None` in table 2 alone.
    pub ablation: Option<[bool; 2]>,
    /// The paper's figures on its industrial park and on KITTI; rows that it does not have are `None`.
    pub paper: [Option<PaperFigures>; 2],
    /// Colour in figures, red, green, blue.
    pub color: [u8; 3],
}

/// Every row, in the order of the tables.
pub const METHODS: [MethodRow; 11] = [
    MethodRow {
        key: "closed-set",
        title: "Closed set",
        ablation: None,
        paper: [Some([78.9, 0.0, 0.0]), Some([70.5, 0.0, 0.0])],
        color: [120, 120, 120],
    },
    MethodRow {
        key: "supervised",
        title: "Supervised (upper bound)",
        ablation: None,
        paper: [Some([78.4, 61.7, 69.1]), Some([76.6, 80.6, 78.5])],
        color: [20, 20, 20],
    },
    MethodRow {
        key: "naive",
        title: "Naive",
        ablation: Some([false, false]),
        paper: [Some([75.3, 3.0, 5.7]), Some([63.8, 3.9, 7.3])],
        color: [230, 159, 0],
    },
    MethodRow {
        key: "osis",
        title: "OSIS, modified",
        ablation: None,
        paper: [Some([74.1, 1.1, 2.1]), Some([65.9, 1.1, 2.2])],
        color: [148, 103, 189],
    },
    MethodRow {
        key: "osis-geo",
        title: "OSIS, geometry alone",
        ablation: None,
        paper: [None, None],
        color: [197, 176, 213],
    },
    MethodRow {
        key: "ml-only",
        title: "ML only",
        ablation: Some([true, false]),
        paper: [Some([78.7, 8.3, 15.1]), Some([66.1, 5.8, 10.6])],
        color: [86, 180, 233],
    },
    MethodRow {
        key: "uc-only",
        title: "UC only",
        ablation: Some([false, true]),
        paper: [None, None],
        color: [140, 86, 75],
    },
    MethodRow {
        key: "mluc-literal",
        title: "MLUC, to the letter",
        ablation: Some([true, true]),
        paper: [Some([79.4, 13.2, 22.6]), Some([66.8, 9.7, 16.9])],
        color: [0, 158, 115],
    },
    MethodRow {
        key: "mluc-corrected",
        title: "MLUC, corrected",
        ablation: Some([true, true]),
        paper: [Some([79.4, 13.2, 22.6]), Some([66.8, 9.7, 16.9])],
        color: [0, 90, 181],
    },
    MethodRow {
        key: "mluc-open",
        title: "MLUC, our training",
        ablation: Some([true, true]),
        paper: [None, None],
        color: [204, 121, 167],
    },
    MethodRow {
        key: "improved",
        title: "Improved (ours)",
        ablation: None,
        paper: [None, None],
        color: [213, 40, 40],
    },
];

/// The row of a key.
pub fn method_row(key: &str) -> Option<&'static MethodRow> {
    METHODS.iter().find(|row| row.key == key)
}

/// The paper's figures for a row in the setting that this one stands for (`sim-udi`; `sim-kitti` and `kitti`).
pub fn paper_figures(row: &MethodRow, setting: &str) -> Option<PaperFigures> {
    row.paper[usize::from(setting.ends_with("kitti"))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::harmonic_mean;

    #[test]
    fn the_papers_harmonic_means_follow_from_its_other_figures() {
        for row in METHODS {
            for [known, unknown, harm] in row.paper.into_iter().flatten() {
                let mean = harmonic_mean(known, unknown);
                // The paper's inputs are rounded to 0.05.
                assert!(
                    (mean - harm).abs() < 0.11,
                    "{}: {mean} beside {harm}",
                    row.key
                );
            }
        }
    }
}
