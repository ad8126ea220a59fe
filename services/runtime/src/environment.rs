//! What a program that stands in a stage's place finds in its environment, beside the instance.

use crate::{Instance, RuntimeError};

/// Which stage it is, and of which model its frames are: `MLUC_STAGE`, `MLUC_MODEL` (an embedded model's name or a file),
/// `MLUC_CLASSES` (names by class id, with commas between) and `MLUC_MODEL_FINGERPRINT` (decimal).
pub fn stage_environment(
    stage: &str,
    model: &str,
    classes: &[String],
    fingerprint: u64,
) -> [(String, String); 4] {
    [
        ("MLUC_STAGE", stage.to_string()),
        ("MLUC_MODEL", model.to_string()),
        ("MLUC_CLASSES", classes.join(",")),
        ("MLUC_MODEL_FINGERPRINT", fingerprint.to_string()),
    ]
    .map(|(key, value)| (key.to_string(), value))
}

/// The other side of [`stage_environment`] and [`Instance::environment`].
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
