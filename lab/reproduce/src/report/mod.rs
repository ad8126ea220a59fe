//! The report of a reproduction: tables with the paper's values, figures, pictures, and every number as JSON.
//!
//! [`ReproductionReport`] is plain data (`report.json`); [`page`] writes it as Markdown, [`figure5`] draws the curves, [`figure6`]
//! the scenes. This module does not train, detect or evaluate.

mod data;
pub(crate) mod figure5;
mod page;
mod pages;

pub(crate) use data::{MethodFigures, ReproductionReport, SpreadKind};
pub(crate) use page::page;
pub(crate) use pages::{DrawnScene, Panel, figure6};
