//! The rows of the paper's tables (section 4.4), and ours: what each makes of the boxes that its network kept.
//!
//! [`run_method`] gives the objects of every frame at every threshold of a method; figures are made of them elsewhere. A
//! threshold is always one below which a box is held for unknown; the first of a sweep is 0, where nothing is: the closed
//! set of that network.

mod boxes;
mod dbscan;
mod error;
mod improved;
mod osis;
mod osis_embedding;
mod refined;
mod scores;

pub use error::MethodError;
pub use improved::{ImprovedSettings, improved_steps};
pub use scores::UnknownScore;

use crate::pipeline::{DetectedFrame, FoundObject, FrameSet, THRESHOLDS, class_names};
use crate::train::Kind as NetworkKind;
use mluc_model::{HeadKind, Model};
use mluc_refiner::Mode;

/// A row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// SECOND: nothing is unknown.
    ClosedSet,
    /// SECOND that learned the unknown classes too: the upper bound.
    Supervised,
    /// Unknown where the largest class probability is low; the box as it is.
    Naive,
    /// Points in no known box, clustered by a learned embedding (Wong et al., CoRL 2019, as the paper modified it).
    Osis,
    /// The same by place alone.
    OsisGeo,
    /// The paper's gate, the box as it is.
    MlOnly,
    /// The naive gate, the paper's clustering.
    UcOnly,
    /// The paper to the letter.
    MlucLiteral,
    /// The paper with the clustering's sign and ground corrected.
    MlucCorrected,
    /// The same on a network with the paper's head that learned from made-up unknown objects and from background: what training alone
    /// brings.
    MlucOpen,
    /// Ours.
    Improved,
}

impl Method {
    /// In the order of the paper's tables.
    pub const ALL: [Method; 11] = [
        Method::ClosedSet,
        Method::Supervised,
        Method::Naive,
        Method::Osis,
        Method::OsisGeo,
        Method::MlOnly,
        Method::UcOnly,
        Method::MlucLiteral,
        Method::MlucCorrected,
        Method::MlucOpen,
        Method::Improved,
    ];

    /// Its key in reports.
    pub fn name(self) -> &'static str {
        match self {
            Method::ClosedSet => "closed-set",
            Method::Supervised => "supervised",
            Method::Naive => "naive",
            Method::Osis => "osis",
            Method::OsisGeo => "osis-geo",
            Method::MlOnly => "ml-only",
            Method::UcOnly => "uc-only",
            Method::MlucLiteral => "mluc-literal",
            Method::MlucCorrected => "mluc-corrected",
            Method::MlucOpen => "mluc-open",
            Method::Improved => "improved",
        }
    }

    /// The network that it stands on.
    pub fn network(self) -> NetworkKind {
        match self {
            Method::ClosedSet => NetworkKind::Sigmoid,
            Method::Supervised => NetworkKind::Supervised,
            Method::Naive | Method::UcOnly | Method::OsisGeo => NetworkKind::Softmax,
            Method::Osis => NetworkKind::Osis,
            Method::MlOnly | Method::MlucLiteral | Method::MlucCorrected => NetworkKind::Metric,
            Method::MlucOpen => NetworkKind::MetricOpen,
            Method::Improved => NetworkKind::Improved,
        }
    }

    /// Whether it stands on this model. Without training ours works on the paper's network too, which tells what training brings.
    pub fn check(self, model: &Model) -> Result<(), MethodError> {
        let (expected, found) = (self.network().head(), model.manifest.network.head);
        if found == expected || (self == Method::Improved && found == HeadKind::Metric) {
            return Ok(());
        }
        Err(MethodError::OtherHead {
            method: self.name(),
            expected,
            found,
        })
    }
}

/// Objects at every threshold.
#[derive(Clone, Debug)]
pub struct MethodOutput {
    /// Thresholds; the first is the closed set.
    pub thresholds: Vec<f64>,
    /// Objects by frame, then by threshold.
    pub objects: Vec<Vec<Vec<FoundObject>>>,
    /// Classes that the objects count by.
    pub classes: Vec<String>,
}

/// What a method works on.
#[derive(Clone, Copy)]
pub(crate) struct Input<'a> {
    pub(crate) model: &'a Model,
    pub(crate) set: &'a FrameSet,
    pub(crate) frames: &'a [DetectedFrame],
    /// `None`: the method's own grid.
    pub(crate) thresholds: Option<&'a [f64]>,
    /// Called after each frame.
    pub(crate) step: &'a (dyn Fn() + Sync),
}

/// Runs a row. `frames`: [`crate::pipeline::detect_frames`] of the same model and set. `thresholds`: exactly these (the first
/// should be 0); `None`: 0 and a grid of [`THRESHOLDS`] quantiles. `step` is called after each frame. The result does not
/// depend on the number of threads.
pub fn run_method(
    method: Method,
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    thresholds: Option<&[f64]>,
    step: &(dyn Fn() + Sync),
) -> Result<MethodOutput, MethodError> {
    run_method_with(
        method,
        &ImprovedSettings::default(),
        model,
        set,
        frames,
        thresholds,
        step,
    )
}

/// [`run_method`] with other settings of `improved`, as its ablation has them.
pub fn run_method_with(
    method: Method,
    improved: &ImprovedSettings,
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    thresholds: Option<&[f64]>,
    step: &(dyn Fn() + Sync),
) -> Result<MethodOutput, MethodError> {
    let input = Input {
        model,
        set,
        frames,
        thresholds,
        step,
    };
    method.check(model)?;
    let objects = match method {
        Method::ClosedSet | Method::Supervised => boxes::all_known(&input),
        Method::Naive => boxes::gated(&input, UnknownScore::Msp),
        Method::MlOnly => boxes::gated(&input, UnknownScore::Eds),
        Method::UcOnly => refined::gated(&input, UnknownScore::Msp, Mode::Literal),
        Method::MlucLiteral => refined::gated(&input, UnknownScore::Eds, Mode::Literal),
        Method::MlucCorrected | Method::MlucOpen => {
            refined::gated(&input, UnknownScore::Eds, Mode::Corrected)
        }
        Method::Improved => improved::run(&input, improved),
        Method::Osis => osis::run(&input, true),
        Method::OsisGeo => osis::run(&input, false),
    };
    let (thresholds, objects) = objects?;
    Ok(MethodOutput {
        thresholds,
        objects,
        classes: class_names(model),
    })
}

/// Thresholds, and objects by frame and threshold.
pub(crate) type Swept = (Vec<f64>, Vec<Vec<Vec<FoundObject>>>);

impl Input<'_> {
    /// 0, then quantiles of `values`, at most `count`; or what was asked for.
    pub(crate) fn thresholds_over(&self, values: &[f64], count: usize) -> Vec<f64> {
        match self.thresholds {
            Some(asked) => asked.to_vec(),
            None => {
                let grid = crate::evaluate::quantile_grid(values, count.min(THRESHOLDS));
                [0.0].into_iter().chain(grid).collect()
            }
        }
    }
}
