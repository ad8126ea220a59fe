//! Published figures to compare with: a JSON file with `train_split_3712.classes.NAME`.

use mluc_dataset::{DatasetError, read_text};
use serde_json::Value;
use std::path::Path;

/// Published figures.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference(Value);

/// Reads the file; a file that is not JSON or holds no classes is an error that says so.
pub fn read_reference(path: &Path) -> Result<Reference, DatasetError> {
    let fault = |expected, found| DatasetError::unexpected(path.display(), expected, found);
    let text = read_text(path)?;
    let not_json = |e| fault("JSON", format!("something else ({e})"));
    let root: Value = serde_json::from_str(&text).map_err(not_json)?;
    match root.pointer("/train_split_3712/classes") {
        Some(Value::Object(_)) => Ok(Reference(root)),
        _ => Err(fault(
            "an object at train_split_3712.classes",
            "none".into(),
        )),
    }
}

impl Reference {
    /// A list of numbers of a class (or one number), for example `range_m/mean`; None when the file has none.
    pub(super) fn numbers(&self, class: &str, place: &str) -> Option<Vec<f64>> {
        let place = format!("/train_split_3712/classes/{class}/{place}");
        match self.0.pointer(&place)? {
            Value::Array(items) => items.iter().map(Value::as_f64).collect(),
            other => Some(vec![other.as_f64()?]),
        }
    }

    /// Points of a scan: mean and deviation.
    pub(super) fn points_per_scan(&self) -> Option<[f64; 2]> {
        let scans = self.0.pointer("/points_per_scan/velodyne")?;
        Some([scans.get("mean")?.as_f64()?, scans.get("std")?.as_f64()?])
    }

    /// Objects of a frame: mean.
    pub(super) fn objects_per_frame(&self) -> Option<f64> {
        let place = "/train_split_3712/objects_per_frame_incl_misc_excl_dontcare/mean";
        self.0.pointer(place)?.as_f64()
    }
}
