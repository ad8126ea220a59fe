//! Published figures to compare with: a JSON file with `train_split_3712.classes.NAME`.

use mluc_dataset::{DatasetError, read_text};
use serde_json::Value;
use std::path::Path;

/// Published figures.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    root: Value,
}

/// Reads the file; a file that is not JSON or holds no classes is an error that says so.
pub fn read_reference(path: &Path) -> Result<Reference, ReferenceError> {
    let text = read_text(path)?;
    let root: Value = serde_json::from_str(&text).map_err(|source| ReferenceError::Json {
        path: path.to_owned(),
        source,
    })?;
    let reference = Reference { root };
    if reference
        .root
        .pointer("/train_split_3712/classes")
        .is_some_and(Value::is_object)
    {
        Ok(reference)
    } else {
        Err(ReferenceError::NoClasses {
            path: path.to_owned(),
        })
    }
}

/// Why figures could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// The file cannot be read.
    #[error(transparent)]
    Read(#[from] DatasetError),
    /// Not JSON.
    #[error("{path}: expected JSON: {source}")]
    Json {
        /// Which file.
        path: std::path::PathBuf,
        /// Where it fails.
        source: serde_json::Error,
    },
    /// Another kind of file.
    #[error("{path}: expected an object at train_split_3712.classes, found none")]
    NoClasses {
        /// Which file.
        path: std::path::PathBuf,
    },
}

impl Reference {
    /// A list of numbers of a class (or one number), for example `range_m/mean`; None when the file has none.
    pub fn numbers(&self, class: &str, place: &str) -> Option<Vec<f64>> {
        let value = self
            .root
            .pointer(&format!("/train_split_3712/classes/{class}/{place}"))?;
        match value {
            Value::Array(items) => items.iter().map(Value::as_f64).collect(),
            other => Some(vec![other.as_f64()?]),
        }
    }

    /// Points of a scan: mean and deviation.
    pub fn points_per_scan(&self) -> Option<[f64; 2]> {
        let at = |name: &str| {
            self.root
                .pointer(&format!("/points_per_scan/velodyne/{name}"))?
                .as_f64()
        };
        Some([at("mean")?, at("std")?])
    }

    /// Objects of a frame: mean.
    pub fn objects_per_frame(&self) -> Option<f64> {
        self.root
            .pointer("/train_split_3712/objects_per_frame_incl_misc_excl_dontcare/mean")?
            .as_f64()
    }
}
