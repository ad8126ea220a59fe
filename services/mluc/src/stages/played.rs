//! A stage that computes nothing: it publishes its messages from a recording of `mluc record --stages`.

use super::{backbone::BackboneStage, backbone::blocks_max, head::HeadStage};
use crate::settings::Settings;
use anyhow::{Context, ensure};
use mluc_gateway::ros2::{BYTES_AT, stage_topic};
use mluc_ipc_types::{DETECTIONS_MAX, Flags, FrameHeader, Point, Stage};
use mluc_model::Model;
use mluc_runtime::{Algorithm, Shell, StageError, run_stage};
use mluc_sources::{Recorded, place};

/// Stands in for the stage `A`.
struct Played<A: Algorithm> {
    /// `None`: no later stage computes with what this one publishes.
    recorded: Option<Recorded>,
    shard: Option<[u32; 2]>,
    sequence: Option<u64>,
    /// The recorded message of `sequence`; `None`: it was not recorded.
    message: Option<(FrameHeader, Vec<A::Output>)>,
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
            let blocks = blocks_max(&model.manifest.network);
            let played = Played::<BackboneStage>::new(recorded, shard);
            run_stage(shell, blocks, played)
        }
        _ => {
            let played = Played::<HeadStage>::new(recorded, shard);
            run_stage(shell, DETECTIONS_MAX, played)
        }
    }?)
}

/// The messages of a stage in a recording.
pub(crate) fn open(path: &std::path::Path, stage: Stage) -> anyhow::Result<Recorded> {
    Recorded::open(path, stage_topic(stage).name, "mluc record --stages")
}

/// Header and elements of a recorded message of this wire version, for a model.
pub(crate) fn parse<O: bytemuck::Pod>(
    message: &[u8],
    model: u64,
) -> anyhow::Result<(FrameHeader, Vec<O>)> {
    let bytes = message.get(BYTES_AT..).unwrap_or_default();
    let parts = bytes.split_at_checked(size_of::<FrameHeader>());
    let (header, rest) = parts.context("recorded message: expected a header, found less")?;
    let header: FrameHeader = bytemuck::pod_read_unaligned(header);
    header.checked().context("recorded message")?;
    header.check_model(model).context("recorded message")?;
    let (size, found) = (size_of::<O>(), rest.len());
    ensure!(
        found.is_multiple_of(size),
        "recorded message: expected elements of {size} bytes, found {found} bytes"
    );
    let elements = rest.chunks_exact(size).map(bytemuck::pod_read_unaligned);
    Ok((header, elements.collect()))
}

impl<A: Algorithm> Played<A> {
    fn new(recorded: Option<Recorded>, shard: Option<[u32; 2]>) -> Played<A> {
        Played { recorded, shard, sequence: None, message: None }
    }
}

impl<A: Algorithm> Algorithm for Played<A> {
    const STAGE: Stage = A::STAGE;
    type Input = A::Input;
    type Output = A::Output;

    fn run(
        &mut self,
        header: &mut FrameHeader,
        _: &[A::Input],
        _: Option<&[Point]>,
    ) -> Result<usize, StageError> {
        let Some(recorded) = &mut self.recorded else {
            return Ok(0);
        };
        if self.sequence != Some(header.sequence) {
            let failed = |error: anyhow::Error| StageError::Failed(error.into());
            let message = recorded.of(place(self.shard, header.sequence)).map_err(failed)?;
            let parsed = message.map(|bytes| parse(&bytes, header.model_fingerprint));
            self.message = parsed.transpose().map_err(failed)?;
            self.sequence = Some(header.sequence);
        }
        let Some((recorded, elements)) = &self.message else {
            header.flag(Flags::DEGRADED);
            return Ok(0);
        };
        header.ego = recorded.ego;
        header.flag(Flags(recorded.flags));
        header.points_out_of_range = recorded.points_out_of_range;
        header.feature_rows = recorded.feature_rows;
        header.feature_channels = recorded.feature_channels;
        header.limit_dropped = recorded.limit_dropped;
        Ok(elements.len())
    }

    fn write(&mut self, output: &mut [A::Output]) -> Result<(), StageError> {
        if let Some((_, elements)) = &self.message {
            output.copy_from_slice(elements);
        }
        Ok(())
    }
}
