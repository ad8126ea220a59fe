//! Points to feature rows (paper section 3.1).

use super::models::Models;
use crate::settings::Settings;
use anyhow::{Result, ensure};
use mluc_backbone::{Backbone, Precision};
use mluc_ipc_types::{FeatureBlock, FeatureRows, Flags, FrameHeader, Point, Stage, feature_blocks};
use mluc_model::{Model, Network};
use mluc_runtime::{Algorithm, Shell, StageError, run_stage};

pub(super) struct BackboneStage {
    models: Models<Backbone>,
    rows: usize,
}

pub(crate) fn run(shell: &mut Shell, settings: &Settings, model: &Model, warm: bool) -> Result<()> {
    let precision = settings.precision;
    let backbone = make(model, precision, warm)?;
    let blocks = blocks_max(&model.manifest.network);
    let make_next = move |model: &Model| {
        let own = blocks_max(&model.manifest.network);
        ensure!(own <= blocks, "map of {own} blocks, at most {blocks} fit");
        make(model, precision, true)
    };
    let models = Models::new(shell, model, backbone, make_next);
    let stage = BackboneStage { models, rows: 0 };
    Ok(run_stage(shell, blocks, stage)?)
}

/// Blocks of the largest features message.
pub(super) fn blocks_max(network: &Network) -> usize {
    let cells = network.map_shape().iter().product();
    feature_blocks(cells, network.feature_channels(), network.ground_nodes())
}

fn make(model: &Model, precision: Precision, warms_up: bool) -> Result<Backbone> {
    let (manifest, weights) = (&model.manifest, &model.weights);
    let mut backbone = Backbone::with_precision(manifest, weights, precision)?;
    let (precision, why) = precision.chosen(manifest, weights);
    tracing::info!("precision {precision}: {why}");
    if warms_up {
        backbone.warm_up(manifest)?;
    }
    Ok(backbone)
}

impl Algorithm for BackboneStage {
    const STAGE: Stage = Stage::Backbone;
    type Input = Point;
    type Output = FeatureBlock;

    fn run(
        &mut self,
        header: &mut FrameHeader,
        elements: &[Point],
        _: Option<&[Point]>,
    ) -> Result<usize, StageError> {
        let points = Point::checked(header, elements)?;
        let (backbone, _) = self.models.of_frame(header)?;
        let frame = backbone.run(bytemuck::cast_slice(points));
        header.points_out_of_range = frame.points.out_of_range;
        header.count_over(Flags::LIMIT_VOXELS, frame.points.over_voxels_max);
        self.rows = frame.rows;
        header.feature_rows = frame.rows as u32;
        let channels = backbone.feature_channels();
        header.feature_channels = channels as u32;
        let ground_nodes = backbone.ground_m().len();
        Ok(feature_blocks(frame.rows, channels, ground_nodes))
    }

    fn write(&mut self, output: &mut [FeatureBlock]) -> Result<(), StageError> {
        let backbone = &self.models.made;
        let (cells, rows) = FeatureRows::split_mut(output, self.rows, backbone.ground_m());
        backbone.write_rows(cells, rows).map_err(StageError::failed)
    }
}
