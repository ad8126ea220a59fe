//! What is measured on, the same on every machine: candidates, the shipped model.

use std::path::Path;

use anyhow::Result;
use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, DetectionKind};
use mluc_model::{Manifest, Model, WeightSet};

/// An unknown's candidate as the head hands it over.
pub fn candidate(shape: &Box3, eds: f32) -> Detection {
    Detection {
        center_m: shape.center_m.map(|value| value as f32),
        size_m: shape.size_m.map(|value| value as f32),
        yaw_rad: shape.yaw_rad as f32,
        kind: DetectionKind::Candidate as u32,
        objectness: 0.5,
        score: 0.3,
        eds,
        ..Detection::default()
    }
}

/// The paper's model `kitti`: real candidates, as a robot meets them.
pub fn shipped() -> Result<(Manifest, WeightSet)> {
    let bench = Path::new(env!("CARGO_MANIFEST_DIR"));
    let model = Model::read(&bench.join("../weights/paper/kitti.safetensors"))?;
    Ok((model.manifest, model.weights))
}
