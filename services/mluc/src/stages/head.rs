//! Feature rows to detections (paper section 3.2).

use mluc_head::Head;
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, FeatureBlock, FeatureRows, Flags, HealthState, Stage, Topic,
};
use mluc_model::Model;
use mluc_runtime::Shell;

use super::frame::{begin, check_model, finish, refuse, stamp_published};
use super::instruments::{frame_span, run_span};

pub(crate) fn run(mut shell: Shell, model: &Model) -> anyhow::Result<()> {
    let mut head = Head::new(&model.manifest, &model.weights)?;
    let network = &model.manifest.network;
    let channels = network.feature_channels();
    let map_cells = network.map_shape().iter().product();
    let mut detections = Vec::with_capacity(DETECTIONS_MAX);
    let mut output = shell.output::<Detection>(&Topic::DETECTIONS, DETECTIONS_MAX)?;
    let mut input = shell.input::<FeatureBlock>(&Topic::FEATURES)?;
    shell.state(HealthState::WaitingInput, "waiting for features")?;
    while let Some(message) = shell.next(&mut input, &Topic::FEATURES, || Ok(()))? {
        let mut header = begin(Stage::Head, message.header(), message.received_ns);
        let _frame = frame_span(&header);
        let blocks = message.elements();
        let checked = FeatureRows::checked(&header, blocks, map_cells, channels);
        let features =
            match checked.and_then(|f| check_model(&header, model.fingerprint).map(|()| f)) {
                Ok(features) => features,
                Err(error) => {
                    refuse(&mut shell, &error.to_string())?;
                    continue;
                }
            };
        let counts = run_span(|| head.run(features.cells, features.rows, &mut detections))?;
        header.limit_dropped += counts.over_candidates_max;
        if counts.over_candidates_max > 0 || counts.boxes_max_reached {
            header.flag(Flags::LIMIT_HIT);
        }
        if counts.non_finite > 0 {
            header.flag(Flags::DEGRADED);
        }
        let mut draft = output.draft(&header, detections.len())?;
        draft.elements_mut().copy_from_slice(&detections);
        stamp_published(Stage::Head, draft.header_mut());
        draft.publish()?;
        shell.counters.frames_in += 1;
        shell.counters.frames_dropped = input.dropped();
        shell.counters.bytes_read = size_of_val(blocks) as u64;
        shell.counters.bytes_written = size_of_val(&detections[..]) as u64;
        shell.counters.mappings_verified = input.mappings_verified();
        finish(&mut shell, Stage::Head, &header)?;
    }
    Ok(shell.state(HealthState::Stopping, "")?)
}
