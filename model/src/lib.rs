//! The network as data, and the model file.
//!
//! [`Network`] describes every layer; the trainer and the vehicle use the same description. [`Manifest`] records what a model was trained for.
//! [`Model`] is a file that passed every check. [`Folded`] is a layer in the order that the kernels read. Nothing here computes a network.

mod architectures;
mod error;
mod file;
mod fold;
mod formula;
mod manifest;
mod network;
mod sensor;
mod tensors;
mod untrained;
mod validate;

pub use error::ModelError;
pub use file::{Model, model_bytes, read_tensors};
pub use fold::{BATCH_NORM_EPS, Folded};
pub use formula::{formula_uniform, formula_weights};
pub use manifest::{
    AnchorClass, Beams, Manifest, Probabilities, Profiles, Provenance, RangeBand, ScoreMin, Takes,
    Thresholds,
};
pub use network::{
    DenseLayer, Grid, HeadKind, Network, SparseLayer, UpLayer, VoxelInput, calibrated_layers,
};
pub use sensor::{BlindSector, SensorProfile, SensorUnit, Wave, degrees_off};
pub use tensors::{
    BASELINE, CLUSTER_SCORER, CLUSTER_SCORER_VALUES, CLUSTER_SCORER_WIDTHS, Tensor, WeightSet,
    calibration_tensor, expected_tensors,
};
pub use validate::{
    BOXES_MAX, CLASS_NAME_MAX, CLASSES_MAX, FEATURE_CHANNELS_MAX, KERNEL_MAX, MAP_CELLS_MAX,
    VOXELS_MAX,
};
