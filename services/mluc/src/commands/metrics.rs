//! The metrics of `mluc monitor`, in Prometheus' text format (version 0.0.4).

use super::observe::Snapshot;
use mluc_ipc_types::{Stage, Status, StatusState};

/// One metric per line: name, type, meaning.
const METRICS: &str = include_str!("metrics.txt");

/// The page. Labels are fixed words: nothing in them needs an escape.
pub(super) fn metrics(snapshot: &Snapshot) -> String {
    let mut samples = Vec::new();
    of_pipeline(snapshot, &mut samples);
    of_stages(snapshot, &mut samples);
    let mut text = String::new();
    for line in METRICS.lines() {
        let mut words = line.splitn(3, ' ');
        let [name, kind, help] = std::array::from_fn(|_| words.next().unwrap_or(""));
        let mut own = samples.iter().filter(|sample| sample.0 == name).peekable();
        if own.peek().is_some() {
            text += &format!("# HELP {name} {help}\n# TYPE {name} {kind}\n");
        }
        for (_, labels, value) in own {
            text += &format!("{name}{labels} {value}\n");
        }
    }
    text
}

type Sample = (&'static str, String, f64);

fn of_pipeline(snapshot: &Snapshot, samples: &mut Vec<Sample>) {
    let state = snapshot.state();
    for word in StatusState::NAMES {
        let is_it = state.is_some_and(|state| state.name() == word);
        let labels = format!("{{state=\"{word}\"}}");
        samples.push(("mluc_state", labels, is_it.into()));
    }
    let mut single = |name, value: f64| samples.push((name, String::new(), value));
    single("mluc_sees", state.is_some_and(StatusState::sees).into());
    let Some(status) = &snapshot.status else {
        return;
    };
    let degrees = status.blind_sectors.count_ones() * 360 / Status::SECTORS as u32;
    single("mluc_frames_in_total", status.frames_in as f64);
    single("mluc_frames_out_total", status.frames_out as f64);
    single("mluc_frames_dropped_total", status.frames_dropped as f64);
    single("mluc_frames_late_total", status.frames_late as f64);
    single("mluc_result_age_seconds", status.age_s());
    single("mluc_blind_degrees", degrees.into());
    single("mluc_not_finite_share", status.not_finite_share.into());
    single("mluc_ground_lost", status.is_ground_lost.into());
    let set_aside = snapshot.control.set_aside.len();
    single("mluc_scans_set_aside", set_aside as f64);
}

fn of_stages(snapshot: &Snapshot, samples: &mut Vec<Sample>) {
    for (stage, health) in Stage::ALL.into_iter().zip(&snapshot.stages) {
        let mut add = |name, label: &str, value: f64| {
            let labels = format!("{{stage=\"{}\"{label}}}", stage.name());
            samples.push((name, labels, value));
        };
        add("mluc_stage_up", "", health.is_some().into());
        if let Some(health) = health {
            let refused = health.messages_refused as f64;
            add("mluc_stage_refused_total", "", refused);
            add("mluc_stage_dropped_total", "", health.frames_dropped as f64);
            let us = [health.run_p50_us, health.run_p99_us, health.run_max_us];
            for (quantile, us) in ["0.5", "0.99", "1"].iter().zip(us) {
                let label = format!(",quantile=\"{quantile}\"");
                add("mluc_stage_run_seconds", &label, f64::from(us) / 1e6);
            }
        }
        if snapshot.status.is_some() {
            let restarts = snapshot.control.restarts[stage as usize];
            add("mluc_stage_restarts_total", "", restarts.into());
        }
        let hop = snapshot.status.map(|status| status.hop(stage));
        for (way, count) in ["in", "out", "late"].iter().zip(hop.into_iter().flatten()) {
            let label = format!(",way=\"{way}\"");
            add("mluc_stage_frames_total", &label, count as f64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::observe::tests::snapshot;
    use super::*;

    #[test]
    fn samples_say_what_was_seen() {
        let text = metrics(&snapshot(StatusState::Blind));
        for line in include_str!("metrics_of_a_snapshot.txt").lines() {
            assert!(text.lines().any(|found| found == line), "{line}: {text}");
        }
        let nobody = metrics(&Snapshot::default());
        assert!(nobody.contains("mluc_sees 0\n") && !nobody.contains("mluc_frames"));
    }
}
