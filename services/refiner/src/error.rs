//! What can be wrong with a refiner's settings.

/// Settings or a sensor that no refiner can work with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RefinerError {
    /// A length, angle or share outside of what makes sense.
    #[error("refiner setting {name}: expected {expected}, found {found}")]
    Setting {
        /// The setting's key.
        name: &'static str,
        /// In words, with the unit.
        expected: &'static str,
        /// The value given.
        found: f64,
    },
    /// Clusters shall be scored, which the model has not learned.
    #[error("scores of clusters: expected a model with the tensor {tensor}, found none in it")]
    NoClusterScorer {
        /// The tensor.
        tensor: &'static str,
    },
    /// The model's beam table cannot make a range image.
    #[error("the model's beams: expected {expected}, found {found}")]
    Beams {
        /// In words.
        expected: &'static str,
        /// The entry.
        found: f64,
    },
}

impl RefinerError {
    /// The first setting that is out of its range: name, what is expected, value, whether that fits.
    pub(crate) fn unless_all<const COUNT: usize>(
        rules: [(&'static str, &'static str, f64, bool); COUNT],
    ) -> Result<(), RefinerError> {
        match rules.into_iter().find(|(.., fits)| !fits) {
            Some((name, expected, found, _)) => Err(RefinerError::Setting {
                name,
                expected,
                found,
            }),
            None => Ok(()),
        }
    }
}
