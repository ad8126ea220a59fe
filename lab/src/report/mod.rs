//! The report of a reproduction: tables beside the paper's, figures, pictures, and every number as JSON.
//!
//! [`Report`] is plain data (`report.json`); [`document`] writes it as Markdown, [`figure5`] draws the curves, [`figure6`] the scenes,
//! [`worst`] the frames that went wrong. Nothing here trains, detects or judges.

mod axes;
mod data;
mod document;
mod drawing;
pub mod figure5;
pub mod figure6;
mod paper;
mod perspective;
mod scene;
mod tables;
pub mod worst;

pub use data::{
    AblationRow, CurvePoint, Data, Details, MethodFigures, NetworkDetails, Provenance, RealRow,
    Report, ScoreFigures, SpreadKind,
};
pub use document::document;
pub use drawing::{Anchor, Drawing, Shape};
pub use paper::{METHODS, MethodRow, PaperFigures, method_row, paper_figures};
pub use scene::{Panel, Scene, SceneBox};
