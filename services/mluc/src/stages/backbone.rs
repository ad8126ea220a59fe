//! Points to feature rows (paper section 3.1).

use mluc_backbone::Backbone;
use mluc_ipc_types::{
    FeatureBlock, FeatureRows, Flags, HealthState, Point, Stage, Topic, feature_blocks,
};
use mluc_model::Model;
use mluc_runtime::Shell;

use super::frame::{begin, check_model, finish, refuse, stamp_published};
use super::instruments::{frame_span, run_span};
use crate::settings::Settings;

pub(crate) fn run(mut shell: Shell, settings: &Settings, model: &Model) -> anyhow::Result<()> {
    let mut backbone =
        Backbone::with_precision(&model.manifest, &model.weights, settings.precision)?;
    backbone.warm_up(&model.manifest)?;
    let channels = backbone.feature_channels();
    let cells = backbone.map_shape().iter().product();
    let mut output =
        shell.output::<FeatureBlock>(&Topic::FEATURES, feature_blocks(cells, channels))?;
    let mut input = shell.input::<Point>(&Topic::POINTS)?;
    shell.state(HealthState::WaitingInput, "waiting for points")?;
    while let Some(message) = shell.next(&mut input, &Topic::POINTS, || Ok(()))? {
        let mut header = begin(Stage::Backbone, message.header(), message.received_ns);
        let _frame = frame_span(&header);
        let checked = Point::checked(&header, message.elements());
        let points = match checked.and_then(|p| check_model(&header, model.fingerprint).map(|()| p))
        {
            Ok(points) => points,
            Err(error) => {
                refuse(&mut shell, &error.to_string())?;
                continue;
            }
        };
        let frame = run_span(|| backbone.run(bytemuck::cast_slice(points)));
        header.points_out_of_range = frame.points.out_of_range;
        header.limit_dropped += frame.points.over_voxels_max;
        if frame.points.over_voxels_max > 0 {
            header.flag(Flags::LIMIT_HIT);
        }
        header.feature_rows = frame.rows as u32;
        header.feature_channels = channels as u32;
        let mut draft = output.draft(&header, feature_blocks(frame.rows, channels))?;
        let (cells, rows) = FeatureRows::split_mut(draft.elements_mut(), frame.rows);
        backbone.write_rows(cells, rows)?;
        stamp_published(Stage::Backbone, draft.header_mut());
        draft.publish()?;
        shell.counters.frames_in += 1;
        shell.counters.frames_dropped = input.dropped();
        shell.counters.bytes_read = size_of_val(points) as u64;
        shell.counters.bytes_written = (feature_blocks(frame.rows, channels) * 64) as u64;
        shell.counters.mappings_verified = input.mappings_verified();
        finish(&mut shell, Stage::Backbone, &header)?;
    }
    Ok(shell.state(HealthState::Stopping, "")?)
}
