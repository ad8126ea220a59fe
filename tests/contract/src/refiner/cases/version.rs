//! A side that was built with another contract, or runs another model.

use anyhow::{Context, bail, ensure};
use mluc_ipc_types::WIRE_VERSION;
use mluc_runtime::{Instance, Membership};

use super::Outcome;
use crate::program::Program;
use crate::refiner::scene::usual;
use crate::refiner::session::{Reaction, Session};

pub(super) fn wrong_version(session: &mut Session<'_>) -> Outcome {
    let reason = wrong_messages(session)?;
    let words = wrong_instance(session)?;
    let line = words.lines().last().unwrap_or("").trim();
    Ok(format!("message: '{reason}'; instance: '{line}'"))
}

fn names_both(text: &str, other: u32) -> bool {
    let numbers: Vec<&str> = text
        .split(|c: char| !c.is_ascii_digit())
        .filter(|word| !word.is_empty())
        .collect();
    [WIRE_VERSION, other]
        .iter()
        .all(|version| numbers.contains(&version.to_string().as_str()))
}

/// Messages of another version, and of another model.
fn wrong_messages(session: &mut Session<'_>) -> anyhow::Result<String> {
    session.ready()?;
    let (points, detections) = usual();
    let mut frame = session.player.frame(points.clone(), detections.clone());
    let other = WIRE_VERSION + 41;
    frame.header.wire_version = other;
    let reason = match session.provoke(&frame)? {
        Reaction::Answered(_) => bail!("detections of wire version {other} were answered"),
        Reaction::Refused(reason) => reason,
    };
    ensure!(
        names_both(&reason, other),
        "detections of wire version {other} were refused with the reason '{reason}': it should name both versions, \
         {WIRE_VERSION} and {other}"
    );
    let sound = session.player.frame(points.clone(), detections.clone());
    session.ask(&sound).context("the sound frame after it")?;
    let mut frame = session.player.frame(points.clone(), detections.clone());
    frame.header.model_fingerprint ^= 0xffff;
    if let Reaction::Answered(_) = session.provoke(&frame)? {
        bail!("detections of another model (fingerprint) were answered");
    }
    let sound = session.player.frame(points, detections);
    session.ask(&sound).context("the sound frame after it")?;
    Ok(reason)
}

/// An instance whose contract file tells another version.
fn wrong_instance(session: &mut Session<'_>) -> anyhow::Result<String> {
    let instance = Instance::new(&format!("suite-w-{}", std::process::id()))?;
    let member = Membership::join(&instance, "refiner-test")?;
    let other = WIRE_VERSION + 41;
    let text = format!(
        "wire={other} version=99.0.0 by=ingest pid={}\n",
        std::process::id()
    );
    std::fs::write(instance.root().join("contract"), text).context("writing the contract file")?;
    let command = session.options.command_for(&instance);
    let environment = session.options.environment(&instance);
    let mut program = Program::start(&command, &environment)?;
    let ended = program.end_within(session.options.patience);
    let words = program.last_words();
    drop(program);
    drop(member);
    match ended {
        None => bail!("it joined an instance of wire version {other} and stayed"),
        Some(status) if status.success() => {
            bail!("it left an instance of wire version {other} without an error")
        }
        Some(_) => (),
    }
    ensure!(
        names_both(&words, other),
        "it left an instance of wire version {other} without naming both versions on stderr: {words}"
    );
    Ok(words)
}
