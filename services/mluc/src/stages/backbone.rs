//! Points to feature rows (paper section 3.1).

use mluc_backbone::Backbone;
use mluc_ipc_types::{
    FeatureBlock, FeatureRows, Flags, FrameHeader, Point, Stage, Topic, feature_blocks,
};
use mluc_model::Model;
use mluc_runtime::{Algorithm, Frames, Shell, StageError, StageInput, run_stage};

use crate::settings::Settings;

struct BackboneStage {
    backbone: Backbone,
    channels: usize,
    rows: usize,
}

pub(crate) fn run(
    shell: &mut Shell,
    settings: &Settings,
    model: &Model,
    warms_up: bool,
) -> anyhow::Result<()> {
    let (manifest, weights) = (&model.manifest, &model.weights);
    let mut backbone = Backbone::with_precision(manifest, weights, settings.precision)?;
    let (precision, why) = settings.precision.chosen(manifest, weights);
    tracing::info!("precision {precision}: {why}");
    if warms_up {
        backbone.warm_up(manifest)?;
    }
    let channels = backbone.feature_channels();
    let cells = backbone.map_shape().iter().product();
    let blocks = feature_blocks(cells, channels, manifest.network.ground_nodes());
    let output = shell.output(&Topic::FEATURES, blocks)?;
    let frames = Frames::new(shell, &Topic::POINTS, None)?;
    let stage = BackboneStage {
        backbone,
        channels,
        rows: 0,
    };
    Ok(run_stage(shell, frames, output, stage)?)
}

impl Algorithm for BackboneStage {
    const STAGE: Stage = Stage::Backbone;
    type Input = Point;
    type Output = FeatureBlock;

    fn run(
        &mut self,
        header: &mut FrameHeader,
        input: StageInput<'_, Point>,
    ) -> Result<usize, StageError> {
        let points = Point::checked(header, input.elements)?;
        let frame = self.backbone.run(bytemuck::cast_slice(points));
        header.points_out_of_range = frame.points.out_of_range;
        header.count_over(Flags::LIMIT_VOXELS, frame.points.over_voxels_max);
        self.rows = frame.rows;
        header.feature_rows = frame.rows as u32;
        header.feature_channels = self.channels as u32;
        let ground_nodes = self.backbone.ground_m().len();
        Ok(feature_blocks(frame.rows, self.channels, ground_nodes))
    }

    fn write(&mut self, output: &mut [FeatureBlock]) -> Result<(), StageError> {
        let (cells, rows) = FeatureRows::split_mut(output, self.rows, self.backbone.ground_m());
        let written = self.backbone.write_rows(cells, rows);
        written.map_err(StageError::failed)
    }
}
