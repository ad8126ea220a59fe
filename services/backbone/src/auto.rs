//! The choice of `auto`: the fastest precision on this processor whose measured cost in the model file is small.

use crate::precision::Precision;
use mluc_kernels::Level;
use mluc_model::{Manifest, WeightSet};

impl Precision {
    /// Maximum cost, against f32 on the validation split, of a precision that [`Precision::Auto`] chooses: mAP of the known classes and
    /// AP of the unknown, percentage points.
    pub const COST_MAX: [f64; 2] = [0.5, 1.0];

    /// Names of a precision's figures among the metrics of a model's provenance, in the order of [`Precision::COST_MAX`].
    pub fn metrics(self) -> [String; 2] {
        let suffix = match self {
            Precision::Auto | Precision::F32 => String::new(),
            other => format!("_{other}"),
        };
        ["map_known", "ap_unknown"].map(|name| format!("{name}{suffix}"))
    }

    /// This precision, or the one that [`Precision::Auto`] stands for; and the reason.
    pub fn chosen(self, manifest: &Manifest, weights: &WeightSet) -> (Precision, String) {
        if self != Precision::Auto {
            return (self, "asked for".into());
        }
        auto(Level::best().name(), manifest, weights.is_calibrated())
    }

    /// Percentage points lost against f32, in the order of [`Precision::COST_MAX`]; negative: gained.
    fn cost(self, manifest: &Manifest) -> Option<[f64; 2]> {
        let figures = |precision: Precision| {
            let metrics = &manifest.provenance.metrics;
            let [known, unknown] = precision.metrics();
            Some([*metrics.get(&known)?, *metrics.get(&unknown)?])
        };
        let [known, unknown] = figures(Precision::F32)?;
        let own = figures(self)?;
        Some([known - own[0], unknown - own[1]])
    }
}

/// The precisions that are faster than f32 on a processor with `level`, the fastest first (docs/PERFORMANCE.md).
fn faster(level: &str) -> &'static [Precision] {
    match level {
        "avx512bf16" => &[Precision::Int8, Precision::Bf16],
        "avx512vnni" | "avx512" | "avxvnni" | "avx2" | "neondot" => &[Precision::Int8],
        _ => &[],
    }
}

fn auto(level: &str, manifest: &Manifest, is_calibrated: bool) -> (Precision, String) {
    let mut why = format!("no other is faster with {level}");
    for precision in faster(level) {
        if *precision == Precision::Int8 && !is_calibrated {
            why = "the model has no calibration for int8".into();
            continue;
        }
        let Some([known, unknown]) = precision.cost(manifest) else {
            why = format!("the model file does not say what {precision} costs");
            continue;
        };
        why = format!(
            "{precision} costs {known:.1} points of mAP known and {unknown:.1} of AP unknown"
        );
        let [known_max, unknown_max] = Precision::COST_MAX;
        if known <= known_max && unknown <= unknown_max {
            return (*precision, format!("the fastest with {level}; {why}"));
        }
    }
    (Precision::F32, why)
}

#[cfg(test)]
mod tests {
    use super::*;
    use Precision::{Bf16, F32, Int8};
    use mluc_model::{Grid, Network};

    #[test]
    fn auto_is_the_fastest_that_is_measured_to_cost_little() {
        let network = Network::compact(Grid::kitti_compact(), 3);
        let mut manifest = Manifest::untrained("kitti", network);
        let chosen = |level, manifest: &Manifest| auto(level, manifest, true).0;
        assert_eq!(chosen("avx512bf16", &manifest), F32, "nobody measured it");
        // Figures (known, unknown) in f32, bf16, int8; the choice with bf16 instructions, and without.
        for (figures, with, without) in [
            ([80.0, 20.0, 80.0, 20.0, 79.6, 19.1], Int8, Int8),
            ([80.0, 20.0, 79.9, 19.9, 79.4, 20.0], Bf16, F32),
            ([80.0, 20.0, 79.4, 20.0, 80.0, 18.9], F32, F32),
        ] {
            let names = Precision::ALL.map(Precision::metrics).concat();
            manifest.provenance.metrics = names.into_iter().zip(figures).collect();
            assert_eq!(chosen("avx512bf16", &manifest), with, "{figures:?}");
            for level in ["avx512vnni", "avx512", "avxvnni", "avx2", "neondot"] {
                assert_eq!(chosen(level, &manifest), without, "{level} {figures:?}");
            }
            for level in ["neon", "portable"] {
                assert_eq!(chosen(level, &manifest), F32);
            }
            assert_ne!(auto("avxvnni", &manifest, false).0, Int8);
        }
    }
}
