//! What a program that stands in a stage's place finds in its environment, beside the instance.

use crate::{Instance, RuntimeError};

/// Of which model its frames are: `MLUC_CLASSES` (names by class id, with commas between) and `MLUC_MODEL_FINGERPRINT`
/// (decimal).
pub fn model_environment(classes: &[String], fingerprint: u64) -> [(&'static str, String); 2] {
    [
        ("MLUC_CLASSES", classes.join(",")),
        ("MLUC_MODEL_FINGERPRINT", fingerprint.to_string()),
    ]
}

/// The other side of [`model_environment`] and [`Instance::environment`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StageEnvironment {
    /// `MLUC_INSTANCE`, or [`Instance::DEFAULT`].
    pub instance: Instance,
    /// `MLUC_CLASSES`; empty when it is not set.
    pub classes: Vec<String>,
    /// `MLUC_MODEL_FINGERPRINT`; 0 when it is not set: any model's frames are taken.
    pub fingerprint: u64,
}

impl StageEnvironment {
    /// Reads this process's environment.
    pub fn read() -> Result<StageEnvironment, RuntimeError> {
        let value = |key: &str| std::env::var(key).unwrap_or_default();
        let instance = match value("MLUC_INSTANCE") {
            name if name.is_empty() => Instance::new(Instance::DEFAULT)?,
            name => Instance::new(&name)?,
        };
        let classes = value("MLUC_CLASSES");
        Ok(StageEnvironment {
            instance,
            classes: classes
                .split(',')
                .filter(|name| !name.is_empty())
                .map(str::to_string)
                .collect(),
            fingerprint: value("MLUC_MODEL_FINGERPRINT").parse().unwrap_or(0),
        })
    }
}
