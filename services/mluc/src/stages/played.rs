//! A stage that computes nothing: it publishes what a recording of `mluc record --stages` has of it.

use std::marker::PhantomData;

use anyhow::{Context, ensure};
use mluc_gateway::ros2::{BYTES_AT, stage_topic};
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, FeatureBlock, Flags, FrameHeader, Point, Stage, Topic,
};
use mluc_model::Model;
use mluc_runtime::{Algorithm, Frames, Payload, Scans, Shell, StageError, StageInput, run_stage};
use mluc_sources::{Recorded, place};

use super::backbone::blocks_max;
use crate::settings::Settings;

struct Played<I, O, const STAGE: usize> {
    /// `None`: no later stage computes with what this one publishes.
    recorded: Option<Recorded>,
    shard: Option<[u32; 2]>,
    sequence: Option<u64>,
    /// Of that sequence; `None`: it was not recorded.
    message: Option<(FrameHeader, Vec<O>)>,
    input: PhantomData<I>,
}

/// `to`: the first stage that computes. The recording is the input.
pub(super) fn run(
    shell: &mut Shell,
    settings: &Settings,
    model: &Model,
    stage: Stage,
    to: Option<Stage>,
) -> anyhow::Result<()> {
    let is_last = to.is_some_and(|to| to as usize == stage as usize + 1);
    let path = settings.input.as_deref().context("no recording")?;
    let shard = settings.layout.shard;
    let recorded = is_last.then(|| open(path, stage)).transpose()?;
    Ok(match stage {
        Stage::Backbone => {
            let output = shell.output(&Topic::FEATURES, blocks_max(&model.manifest.network))?;
            let frames = Frames::new(shell, &Topic::POINTS, None)?;
            let played =
                Played::<Point, FeatureBlock, { Stage::Backbone as usize }>::new(recorded, shard);
            run_stage(shell, frames, output, played)
        }
        _ => {
            let output = shell.output(&Topic::DETECTIONS, DETECTIONS_MAX)?;
            let frames = Frames::new(shell, &Topic::FEATURES, Some(Scans::open(shell, false)?))?;
            let played =
                Played::<FeatureBlock, Detection, { Stage::Head as usize }>::new(recorded, shard);
            run_stage(shell, frames, output, played)
        }
    }?)
}

/// What a recording has of a stage.
pub(crate) fn open(path: &std::path::Path, stage: Stage) -> anyhow::Result<Recorded> {
    Recorded::open(path, stage_topic(stage).name, "mluc record --stages")
}

/// Header and elements of a recorded message of this wire version, for a model.
pub(crate) fn parse<O: bytemuck::Pod>(
    message: &[u8],
    fingerprint: u64,
) -> anyhow::Result<(FrameHeader, Vec<O>)> {
    let bytes = message.get(BYTES_AT..).unwrap_or_default();
    let parts = bytes.split_at_checked(size_of::<FrameHeader>());
    let (header, elements) = parts.context("recorded message: expected a header, found less")?;
    let header: FrameHeader = bytemuck::pod_read_unaligned(header);
    header.checked().context("recorded message")?;
    header
        .check_model(fingerprint)
        .context("recorded message")?;
    let (size, found) = (size_of::<O>(), elements.len());
    ensure!(
        found.is_multiple_of(size),
        "recorded message: expected elements of {size} bytes, found {found} bytes"
    );
    let elements = elements
        .chunks_exact(size)
        .map(bytemuck::pod_read_unaligned);
    Ok((header, elements.collect()))
}

impl<I, O, const STAGE: usize> Played<I, O, STAGE> {
    fn new(recorded: Option<Recorded>, shard: Option<[u32; 2]>) -> Played<I, O, STAGE> {
        Played {
            recorded,
            shard,
            sequence: None,
            message: None,
            input: PhantomData,
        }
    }
}

impl<I: Payload, O: Payload, const STAGE: usize> Algorithm for Played<I, O, STAGE> {
    const STAGE: Stage = Stage::ALL[STAGE];
    type Input = I;
    type Output = O;

    fn run(
        &mut self,
        header: &mut FrameHeader,
        _input: StageInput<'_, I>,
    ) -> Result<usize, StageError> {
        let Some(recorded) = &mut self.recorded else {
            return Ok(0);
        };
        if self.sequence != Some(header.sequence) {
            let failed = |error: anyhow::Error| StageError::Failed(error.into());
            let message = recorded
                .of(place(self.shard, header.sequence))
                .map_err(failed)?;
            let parsed = message.map(|bytes| parse(&bytes, header.model_fingerprint));
            self.message = parsed.transpose().map_err(failed)?;
            self.sequence = Some(header.sequence);
        }
        let Some((recorded, elements)) = &self.message else {
            header.flag(Flags::DEGRADED);
            return Ok(0);
        };
        header.flag(Flags(recorded.flags));
        header.points_out_of_range = recorded.points_out_of_range;
        header.feature_rows = recorded.feature_rows;
        header.feature_channels = recorded.feature_channels;
        header.limit_dropped = recorded.limit_dropped;
        Ok(elements.len())
    }

    fn write(&mut self, output: &mut [O]) -> Result<(), StageError> {
        if let Some((_, elements)) = &self.message {
            output.copy_from_slice(elements);
        }
        Ok(())
    }
}
