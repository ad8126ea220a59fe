//! The report of a reproduction: tables beside the paper's, figures, pictures, and every number as JSON.
//!
//! [`ReproductionReport`] is plain data (`report.json`); [`document`] writes it as Markdown, [`figure5`] draws the curves, [`figure6`]
//! the scenes, [`worst_page`] the frames that went wrong. Nothing here trains, detects or judges.

mod canvas_backend;
mod data;
mod document;
pub mod figure5;
mod pages;
mod perspective;
mod scene;
mod tables;

pub use data::{
    AblationRow, DataOrigin, Details, MeanSpread, MethodFigures, NetworkDetails, Provenance,
    RealRow, ReproductionReport, SpreadKind,
};
pub use document::document;
pub use pages::{figure6, worst_page};
pub use scene::{DrawnScene, Panel, SceneBox};
