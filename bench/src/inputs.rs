//! Scans and models to measure on, the same on every machine: simulated, and with weights of a formula or shipped.

use std::path::PathBuf;

use anyhow::{Context, Result};
use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, DetectionKind, Object};
use mluc_model::{Grid, Manifest, Model, Network, WeightSet, formula_weights};
use mluc_refiner::Sensor;
use mluc_simulate::{Family, SimulatedFrame, Split, frame};
use mluc_train::hdl_64e;

/// Of all simulated scans here; another seed would do as well.
const SEED: u64 = 6;

/// A simulated frame of the test split, KITTI's view: some 60,000 points, 64 beams.
pub fn simulated(index: u32) -> Result<SimulatedFrame> {
    frame(Family::SimKitti, Split::Test, SEED, index)
        .with_context(|| format!("simulated frame {index}"))
}

/// A scan of exactly so many points: as many simulated scans over each other as it takes, thinned evenly.
pub fn scan_of(points: usize) -> Result<Vec<[f32; 4]>> {
    let mut all = vec![];
    let mut index = 0;
    while all.len() < points {
        all.extend(simulated(index)?.points);
        index += 1;
    }
    let step = all.len() as f64 / points.max(1) as f64;
    Ok((0..points)
        .map(|place| all[(place as f64 * step) as usize])
        .collect())
}

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

/// An object's box in the sensor frame.
pub fn box_of(object: &Object) -> Box3 {
    Box3::from_f32(object.center_m, object.size_m, object.yaw_rad)
}

/// The simulated scans' sensor, with its beams.
pub fn sensor() -> Sensor {
    Sensor {
        beams: Some(hdl_64e()),
        sees_all_around: false,
        ..Sensor::plain(&["car", "pedestrian", "cyclist"])
    }
}

/// The profile `compact` on KITTI's range, weights by formula.
pub fn compact() -> (Manifest, WeightSet) {
    let network = Network::compact(Grid::kitti_compact(), 3);
    let weights = formula_weights(&network);
    (Manifest::untrained("compact", network), weights)
}

/// The shipped `kitti` model: real candidates, as a robot meets them.
pub fn shipped() -> Result<(Manifest, WeightSet)> {
    let path = PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../weights/kitti.safetensors"
    ));
    let model = Model::read(&path)?;
    Ok((model.manifest, model.weights))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_has_as_many_points_as_asked_for_and_is_the_same_every_time() {
        for points in [0, 1, 10_000, 90_000] {
            let scan = scan_of(points).unwrap();
            assert_eq!(scan.len(), points);
            assert_eq!(scan, scan_of(points).unwrap());
        }
        let scan = scan_of(2000).unwrap();
        let far = scan.iter().filter(|p| p[0].hypot(p[1]) > 20.0).count();
        assert!(far > 100, "thinned evenly: {far} of 2000 beyond 20 m");
    }
}
