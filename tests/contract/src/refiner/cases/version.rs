//! A side that was built with another contract, or runs another model.

use anyhow::{Context, bail, ensure};
use mluc_ipc_types::WIRE_VERSION;
use mluc_runtime::{Instance, Membership};

use super::Outcome;
use crate::program::Program;
use crate::refiner::session::Session;

pub(super) fn wrong_version(session: &mut Session<'_>) -> Outcome {
    let reason = wrong_messages(session)?;
    let words = wrong_instance(session)?;
    let line = words.lines().last().unwrap_or("").trim();
    Ok(format!("message: '{reason}'; instance: '{line}'"))
}

fn names_both(text: &str, other: u32) -> bool {
    let numbers: Vec<&str> = text.split(|c: char| !c.is_ascii_digit()).collect();
    let versions = [WIRE_VERSION, other].map(|version| version.to_string());
    versions
        .iter()
        .all(|version| numbers.contains(&version.as_str()))
}

/// Messages of another version, and of another model.
fn wrong_messages(session: &mut Session<'_>) -> anyhow::Result<String> {
    session.ready()?;
    let mut frame = session.player.usual();
    let other = WIRE_VERSION + 41;
    frame.header.wire_version = other;
    let reason = session.must_refuse(&format!("detections of wire version {other}"), frame)?;
    ensure!(
        names_both(&reason, other),
        "detections of wire version {other} were refused with the reason '{reason}': it should name both versions, \
         {WIRE_VERSION} and {other}"
    );
    let mut frame = session.player.usual();
    frame.header.model_fingerprint ^= 0xffff;
    session.must_refuse("detections of another model (fingerprint)", frame)?;
    Ok(reason)
}

/// An instance whose contract file tells another version.
fn wrong_instance(session: &mut Session<'_>) -> anyhow::Result<String> {
    let instance = Instance::new(&format!("suite-w-{}", std::process::id()))?;
    let member = Membership::join(&instance, "refiner-test")?;
    let (other, pid) = (WIRE_VERSION + 41, std::process::id());
    let text = format!("wire={other} version=99.0.0 by=ingest pid={pid}\n");
    std::fs::write(instance.root().join("contract"), text).context("writing the contract file")?;
    let mut program = Program::start(&session.options.command, &instance)?;
    let ended = program.end_within(session.options.patience);
    let words = program.last_words()?;
    drop(program);
    drop(member);
    let place = format!("an instance of wire version {other}");
    match ended {
        None => bail!("it joined {place} and stayed"),
        Some(status) if status.success() => bail!("it left {place} without an error"),
        Some(_) if names_both(&words, other) => Ok(words),
        Some(_) => bail!("it left {place} without naming both versions on stderr: {words}"),
    }
}
