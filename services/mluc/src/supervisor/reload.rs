//! New thresholds during a run: they are read and checked first; then all stages use them from one frame on, or none does.
//!
//! All stages first make another model ready, while they run with the old one. Then ingest gives the new fingerprint to the next
//! frame. Each stage computes a frame with the model of the frame's fingerprint, or not at all.

use super::Supervisor;
use crate::{control::Reload, control::Thresholds, document, model};
use crate::{model::PinnedModel, resolve::below, settings::Settings, stages::describe_run};
use anyhow::{bail, ensure};
use mluc_ipc_types::{RunDescription, Stage};
use mluc_model::Model;
use std::{sync::atomic::Ordering, time::Duration, time::Instant};
use toml::{Table, Value};

/// The keys that may change. Processes, ports and memory were made for the values of the others.
const MAY_CHANGE: &str = "model, lambda, unknown_min, profile, min_score, min_unknown_score";
/// Scans that may be sent before the stages know of the change: two periods of the sensor at least.
const FRAMES_AHEAD: u64 = 3;
/// Time until all stages have made another model ready. It takes about 0.5 s; the limit is a guess for slow and busy machines.
const READY_MAX: Duration = Duration::from_secs(60);

/// A model that the stages make ready.
pub(super) struct ModelChange {
    next: PinnedModel,
    /// The settings with this model.
    settings: Settings,
    run: RunDescription,
    keys: String,
    begun: Instant,
}

impl Supervisor {
    /// Starts a reload that was requested, but not before the first frame of the last reload came.
    pub(super) fn reload_if_asked(&mut self) {
        let last = self.control.reload.as_ref();
        let last = last.filter(|last| last.run_id == self.run.run_id);
        let is_under_way = last.is_some_and(|last| self.next_sequence <= last.from_sequence);
        let is_asked = !is_under_way && self.is_asked_to_reload.load(Ordering::Relaxed);
        let answer = match self.model_change.take() {
            Some(change) => self.go_on_changing(change),
            None if is_asked => self.reload(),
            None => return,
        };
        let (is_refused, text) = match answer {
            Ok(None) => return,
            Ok(Some(text)) => (false, text),
            Err(error) => (true, format!("refused, the old settings stay: {error:#}")),
        };
        if is_refused {
            // Removes the copy of the model that is refused.
            PinnedModel::remove(&self.settings.instance, self.control.answer.0 + 1);
        }
        if let Some(reload) = &mut self.control.reload
            && reload.model.take_if(|next| *next != self.model).is_some()
        {
            reload.new = reload.old;
        }
        tracing::warn!("reload: {text}");
        self.control.answer = (self.control.answer.0 + 1, is_refused, text);
        self.tell_stages();
    }

    /// Reads the settings again. Returns the result in words; `None`: no result yet, the model is being changed.
    fn reload(&mut self) -> anyhow::Result<Option<String>> {
        self.is_asked_to_reload.store(false, Ordering::Relaxed);
        let mut settings = Settings::resolve(self.args.clone())?;
        let model = model::load_for(&settings)?;
        let has_scores = settings.complete_from(&model);
        let changed = self.changed_keys(&settings, &model)?;
        if changed.is_empty() {
            return Ok(Some("nothing has changed".to_string()));
        }
        let why = ["; no scores for the profile", ""][usize::from(has_scores)];
        let keys = changed.join(", ") + why;
        let mut next = None;
        if model.fingerprint != self.run.model_fingerprint {
            // From now on, frames of both models are valid.
            self.run.other_model_fingerprint = model.fingerprint;
            self.shell.describe_run(&self.run)?;
            ensure!(self.shell.run() == Some(&self.run), "model: another process began the run");
            let number = self.control.answer.0 + 1;
            next = Some(PinnedModel::new(&mut settings, &model, number)?);
        }
        self.take_scans()?;
        let from_sequence = self.scans.count_sent().max(self.next_sequence) + FRAMES_AHEAD;
        let mut control = self.control.clone();
        control.reload = Some(Reload {
            run_id: self.run.run_id,
            from_sequence,
            model: next.clone(),
            old: thresholds(&self.settings),
            new: thresholds(&settings),
        });
        control.write(&self.settings.instance)?;
        self.control = control;
        let run = RunDescription {
            run_id: self.run.run_id,
            started_ns: self.run.started_ns,
            other_model_fingerprint: self.run.model_fingerprint,
            ..describe_run(&settings, &model)
        };
        if let Some(next) = next {
            let begun = Instant::now();
            self.model_change = Some(ModelChange { next, settings, run, keys, begun });
            return Ok(None);
        }
        (self.run, self.settings) = (run, settings);
        self.shell.describe_run(&self.run)?;
        self.take_scans()?;
        if self.scans.count_sent() > from_sequence {
            tracing::warn!(
                "frame {from_sequence} was sent before all stages had the new thresholds"
            );
        }
        Ok(Some(format!("from frame {from_sequence} on: {keys}")))
    }

    fn go_on_changing(&mut self, change: ModelChange) -> anyhow::Result<Option<String>> {
        for stage in Stage::ALL {
            let (own, name) = (&self.settings.stages[stage], stage.name());
            // Backbone and head are always our programs, whoever starts them.
            let is_ours = !own.external && own.command.is_none();
            // The living process: the report of a process that has died since does not count.
            let pid = match self.children[stage as usize].pid() {
                pid if is_ours => pid,
                _ => self.health.of(stage).map_or(0, |health| health.pid),
            };
            let report = change.next.file.with_file_name(pid.to_string());
            let said = std::fs::read_to_string(report).unwrap_or_default();
            if said.is_empty() && (is_ours || [Stage::Backbone, Stage::Head].contains(&stage)) {
                let is_early = change.begun.elapsed() < READY_MAX;
                let hint = "it prepares one only while frames come";
                ensure!(is_early, "model: {name} is not ready after {READY_MAX:?}; {hint}");
                self.model_change = Some(change);
                return Ok(None);
            }
            ensure!(["", "ready"].contains(&&*said), "model: {name}: {said}");
        }
        let keys = change.keys;
        self.document = document::publish(&change.settings)?;
        self.shell.describe_run(&change.run)?;
        (self.run, self.settings) = (change.run, change.settings);
        let before = std::mem::replace(&mut self.model, change.next);
        let _ = std::fs::remove_dir_all(before.file.with_file_name(""));
        let by_sequence = self.scans.count_sent() + FRAMES_AHEAD;
        // A second reload waits for this frame.
        let reload = self.control.reload.iter_mut();
        reload.for_each(|reload| reload.from_sequence = by_sequence);
        let fingerprint = self.model.fingerprint;
        let text = format!("by frame {by_sequence}: {keys}, model {fingerprint:016x}");
        Ok(Some(text))
    }

    /// Refuses what may not change, by name.
    fn changed_keys(&self, new: &Settings, model: &Model) -> anyhow::Result<Vec<String>> {
        let mut changed = Vec::new();
        let has_pace = self.settings.pace == new.pace;
        let [old, new] = [&self.settings, new].map(Table::try_from);
        find_changes(&old?, &new?, "", &mut changed);
        // The settings name a copy, so the fingerprints are compared below.
        changed.retain(|key| key != "model");
        // The default of the budget depends on the pace: if the pace changed, only the pace is named.
        changed.retain(|key| key != "budget_ms" || has_pace);
        // A replay has no loop, whatever a file says.
        changed.retain(|key| key != "loop" || self.settings.repeat);
        if model.fingerprint != self.run.model_fingerprint {
            changed.push("model".to_string());
        }
        let (expected, found) = (&self.classes, model.manifest.class_names());
        if found != *expected {
            // Consumers know the classes by number.
            bail!("model: expected classes {expected:?}, found {found:?}: start anew for others");
        }
        let may_change = |key: &&String| MAY_CHANGE.split(", ").any(|own| own == *key);
        if let Some(key) = changed.iter().find(|key| !may_change(key)) {
            bail!("{key} cannot change while the pipeline runs (only {MAY_CHANGE} can)");
        }
        Ok(changed)
    }
}

fn thresholds(settings: &Settings) -> Thresholds {
    // A model has one of the two thresholds.
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
