//! What a run says of itself to all stages and consumers.

use std::time::Duration;

use anyhow::bail;
use mluc_head::gate::{main_gate, threshold_of};
use mluc_ipc_types::{CLASS_NAME_MAX, CLASSES_MAX, RunDescription, Text, WIRE_VERSION};
use mluc_model::{HeadKind, Model};
use mluc_runtime::{Shell, random_run_id, wall_clock_ns};

use crate::settings::Settings;

/// How long the process that began a run may take to describe it.
const PATIENCE: Duration = Duration::from_secs(3);

/// Begins a run, or joins the one that another process of the instance has begun. `None`: asked to end.
pub(crate) fn begin_or_join_run(
    shell: &mut Shell,
    settings: &Settings,
    model: &Model,
) -> anyhow::Result<Option<RunDescription>> {
    let own = describe_run(settings, model);
    if shell.begin_run(&own)? {
        return Ok(Some(own));
    }
    shell.await_run(PATIENCE)?;
    let instance = settings.instance.name();
    match shell.run() {
        _ if shell.is_stopping() => Ok(None),
        None => bail!("instance '{instance}': the process that began the run does not describe it"),
        Some(run) if run.model_fingerprint == own.model_fingerprint => Ok(Some(*run)),
        Some(run) => bail!(
            "instance '{instance}' runs the model '{}' (fingerprint {:016x}), this process '{}' ({:016x}): start all with \
             the same --model",
            run.model_name(),
            run.model_fingerprint,
            own.model_name(),
            own.model_fingerprint
        ),
    }
}

/// A new run's description.
pub fn describe_run(settings: &Settings, model: &Model) -> RunDescription {
    let (manifest, thresholds) = (&model.manifest, &model.manifest.thresholds);
    let is_open = manifest.network.head == HeadKind::Open;
    let gate = main_gate(is_open, thresholds);
    let mut class_names = [[0; CLASS_NAME_MAX]; CLASSES_MAX];
    for (to, class) in class_names.iter_mut().zip(&manifest.classes) {
        *to = Text::pack(&class.name);
    }
    RunDescription {
        wire_version: WIRE_VERSION,
        classes_count: manifest.classes.len() as u32,
        run_id: random_run_id(),
        started_ns: wall_clock_ns(),
        model_fingerprint: model.fingerprint,
        base_from_sensor: settings.sensor.extrinsics,
        sensor_height_m: manifest.sensor_height_m,
        objectness_min: thresholds.objectness_min,
        gate: gate as u32,
        gate_threshold: threshold_of(gate, thresholds),
        model_name: Text::pack(&manifest.name),
        sensor_name: Text::pack(&settings.sensor.name),
        class_names,
        known_score: Text::pack("objectness x probability of the class, 0 to 1"),
        unknown_score: Text::pack(if is_open {
            "objectness x probability of being none of the known, lowered for unlikely shapes, 0 to 1"
        } else {
            "orders unknown objects among each other; its scale depends on the refiner"
        }),
    }
}
