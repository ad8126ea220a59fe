//! Feature rows to detections (paper section 3.2).

use super::models::Models;
use mluc_head::{Head, stand_on_ground};
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, FeatureBlock, FeatureRows, Flags, FrameHeader, Point, Stage,
};
use mluc_model::Model;
use mluc_runtime::{Algorithm, Shell, StageError, run_stage};

pub(super) struct HeadStage {
    /// Each head with the numbers of cells of the map, channels and nodes of the ground.
    models: Models<(Head, [usize; 3])>,
    detections: Vec<Detection>,
}

pub(crate) fn run(shell: &mut Shell, model: &Model) -> anyhow::Result<()> {
    let make = |model: &Model| {
        let network = &model.manifest.network;
        let cells = network.map_shape().iter().product();
        let shape = [cells, network.feature_channels(), network.ground_nodes()];
        Ok((Head::new(&model.manifest, &model.weights)?, shape))
    };
    let stage = HeadStage {
        models: Models::new(shell, model, make(model)?, make),
        detections: Vec::with_capacity(DETECTIONS_MAX),
    };
    Ok(run_stage(shell, DETECTIONS_MAX, stage)?)
}

impl Algorithm for HeadStage {
    const STAGE: Stage = Stage::Head;
    type Input = FeatureBlock;
    type Output = Detection;

    fn run(
        &mut self,
        header: &mut FrameHeader,
        elements: &[FeatureBlock],
        _: Option<&[Point]>,
    ) -> Result<usize, StageError> {
        let ((head, [cells, channels, ground_nodes]), thresholds) = self.models.of_frame(header)?;
        if let Some((gate, _)) = thresholds {
            head.set_gate(gate);
        }
        // A played recording lacks this frame's features.
        if elements.is_empty() && Flags(header.flags).contains(Flags::DEGRADED) {
            self.detections.clear();
            return Ok(0);
        }
        let features = FeatureRows::checked(header, elements, *cells, *channels, *ground_nodes)?;
        let FeatureRows { cells, rows, .. } = features;
        let counts = head.run(cells, rows, &mut self.detections);
        let counts = counts.map_err(StageError::failed)?;
        stand_on_ground(&mut self.detections, features.ground_m);
        header.count_over(Flags::LIMIT_CANDIDATES, counts.over_candidates_max);
        if counts.boxes_max_reached {
            header.flag(Flags::LIMIT_DETECTIONS);
        }
        if counts.non_finite > 0 {
            header.flag(Flags::DEGRADED);
        }
        Ok(self.detections.len())
    }

    fn write(&mut self, output: &mut [Detection]) -> Result<(), StageError> {
        output.copy_from_slice(&self.detections);
        Ok(())
    }
}
