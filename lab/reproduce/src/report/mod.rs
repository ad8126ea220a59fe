//! The report of a reproduction: tables beside the paper's, figures, pictures, and every number as JSON.
//!
//! [`ReproductionReport`] is plain data (`report.json`); [`page`] writes it as Markdown, [`figure5`] draws the curves, [`figure6`]
//! the scenes. Nothing here trains, detects or judges.

mod data;
pub(crate) mod figure5;
mod page;
mod pages;

pub(crate) use data::{MethodFigures, ReproductionReport, SpreadKind};
pub(crate) use page::page;
pub(crate) use pages::{DrawnScene, Panel, figure6};
