//! Other thresholds while a run is on: read and checked first; then all stages take them from one frame on, or none does.

use std::sync::atomic::Ordering;

use anyhow::bail;
use mluc_ipc_types::RunDescription;
use mluc_model::{Model, ScoreMin};
use toml::{Table, Value};

use super::Supervisor;
use crate::control::Reload;
use crate::model;
use crate::resolve::below;
use crate::settings::Settings;
use crate::stages::describe_run;

/// What may change. Processes, ports and memory were made for the rest.
const MAY_CHANGE: &str = "lambda, unknown_min, profile, min_score, min_unknown_score";
/// Scans that may be sent until the stages are told: two periods of the sensor at least.
const FRAMES_AHEAD: u64 = 3;

impl Supervisor {
    /// Not before the first frame of the last reload came.
    pub(super) fn reload_if_asked(&mut self) {
        let last = self.control.reload.as_ref();
        let last = last.filter(|last| last.run_id == self.run.run_id);
        let is_under_way = last.is_some_and(|last| self.next_sequence <= last.from_sequence);
        if is_under_way || !self.is_asked_to_reload.swap(false, Ordering::Relaxed) {
            return;
        }
        let (is_refused, text) = match self.reload() {
            Ok(text) => (false, text),
            Err(error) => (true, format!("refused, the old settings stay: {error:#}")),
        };
        tracing::warn!("reload: {text}");
        self.control.answer = (self.control.answer.0 + 1, is_refused, text);
        self.tell_stages();
    }

    fn reload(&mut self) -> anyhow::Result<String> {
        let mut settings = Settings::resolve(self.args.clone())?;
        let model = model::load_for(&settings)?;
        settings.complete_from(&model);
        let changed = self.changed_keys(&settings, &model)?;
        if changed.is_empty() {
            return Ok("nothing has changed".to_string());
        }
        self.take_scans()?;
        let from_sequence = self.scans.count_sent().max(self.next_sequence) + FRAMES_AHEAD;
        let mut control = self.control.clone();
        control.reload = Some(Reload {
            run_id: self.run.run_id,
            from_sequence,
            old: thresholds(&self.settings),
            new: thresholds(&settings),
        });
        control.write(&self.settings.instance)?;
        (self.control, self.settings) = (control, settings);
        self.run = RunDescription {
            run_id: self.run.run_id,
            started_ns: self.run.started_ns,
            ..describe_run(&self.settings, &model)
        };
        self.shell.describe_run(&self.run)?;
        self.take_scans()?;
        if self.scans.count_sent() > from_sequence {
            tracing::warn!("frame {from_sequence} was sent before all stages were told");
        }
        let keys = changed.join(", ");
        Ok(format!("from frame {from_sequence} on: {keys}"))
    }

    /// Refuses what may not change, by name.
    fn changed_keys(&self, new: &Settings, model: &Model) -> anyhow::Result<Vec<String>> {
        let mut changed = Vec::new();
        let [old, new] = [&self.settings, new].map(Table::try_from);
        find_changes(&old?, &new?, "", &mut changed);
        if model.fingerprint != self.run.model_fingerprint {
            changed.push("the model".to_string());
        }
        let may_change = |key: &&String| MAY_CHANGE.split(", ").any(|own| own == *key);
        if let Some(key) = changed.iter().find(|key| !may_change(key)) {
            bail!("{key} cannot change while the pipeline runs (only {MAY_CHANGE} can)");
        }
        Ok(changed)
    }
}

fn thresholds(settings: &Settings) -> (f32, ScoreMin) {
    // A model has one of them.
    let gate = settings.lambda.or(settings.unknown_min);
    (gate.unwrap_or_default() as f32, settings.refiner.score_min)
}

/// Paths of the keys that differ.
fn find_changes(old: &Table, new: &Table, path: &str, found: &mut Vec<String>) {
    let added = new.keys().filter(|key| !old.contains_key(*key));
    for key in old.keys().chain(added) {
        match (old.get(key), new.get(key)) {
            (Some(Value::Table(old)), Some(Value::Table(new))) => {
                find_changes(old, new, &below(path, key), found);
            }
            (old, new) if old != new => found.push(below(path, key)),
            _ => (),
        }
    }
}
