//! One JSON line per frame, for the robot, the evaluator and `jq`. `docs/output.md` describes it,
//! `docs/objects.schema.json` checks it.

use mluc_ipc_types::{
    CandidateCounts, Disposition, Flags, FrameHeader, Health, NO_PROBABILITY, Object, ObjectKind,
    Stage, Status, StatusState, WIRE_VERSION,
};
use serde::{Serialize, Serializer};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A frame's line.
#[derive(Debug, Serialize)]
pub struct Line<'a> {
    /// Wire version.
    pub wire: u32,
    /// Counts the frames of a run from 0.
    pub sequence: u64,
    /// The frame's name.
    pub frame: &'a str,
    /// The sensor's own time, ns.
    pub stamp_ns: u64,
    /// Fingerprint of the model that made it, 16 hexadecimal digits.
    pub model: String,
    /// Published objects.
    pub objects: Vec<ObjectLine<'a>>,
    /// Objects that are not published, and why.
    pub suppressed: Vec<SuppressedLine<'a>>,
    /// Latency by stage.
    #[serde(serialize_with = "by_name")]
    pub stages: [StageTimes; 4],
    /// From the scan's arrival to the objects' publication, us.
    pub latency_us: u64,
    /// Names of the flags that are set: what is unusual about the frame.
    pub flags: Vec<&'static str>,
    /// Name of the [`StatusState`] when the frame left.
    pub state: &'static str,
    /// Age of the newest result when the frame left: time since its scan arrived, ms. `None`: no result yet.
    pub age_ms: Option<u64>,
    /// Directions without returns where there should be some: from and to, degrees.
    pub blind_deg: Vec<[usize; 2]>,
    /// Share of the newest scan's points that are not finite.
    pub not_finite_share: f32,
    /// True: the ground was found earlier in this run and is not found any more.
    pub ground_lost: bool,
}

/// An object.
#[derive(Debug, Serialize)]
pub struct ObjectLine<'a> {
    kind: &'static str,
    pub(crate) label: &'a str,
    score: f32,
    /// Probability that it is of its kind; `None`: the model gives none.
    probability: Option<f32>,
    center_m: [f32; 3],
    size_m: [f32; 3],
    yaw_rad: f32,
    eds: f32,
    eds_normalised: f32,
    /// Probability that it is of no known class; `None`: the model gives none.
    unknown_probability: Option<f32>,
    points: u32,
    /// Number of its track, if unknown objects are tracked. Then: whether the track is confirmed, its age, and its speed over the ground.
    track: Option<u32>,
    confirmed: Option<bool>,
    age_scans: Option<u32>,
    speed_mps: Option<f32>,
    /// The frame's time budget ended before the object was refined: its box is the proposal's.
    unrefined: bool,
    /// A piece of a cluster larger than any road user.
    split: bool,
    footprint_m: Vec<[f32; 2]>,
}

/// An object that is not published.
#[derive(Debug, Serialize)]
pub struct SuppressedLine<'a> {
    #[serde(flatten)]
    object: ObjectLine<'a>,
    /// Name of its [`Disposition`].
    reason: &'static str,
    /// Index in the line's `objects` of the object that suppresses it.
    by: Option<usize>,
    /// How much the suppressing object covers it, 0 to 1.
    overlap: f32,
}

/// Latency of one stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct StageTimes {
    /// From its input's publication by the stage before (ingest: from when the scan was due) to the start of computing, us.
    pub queue_us: u64,
    /// From the start of computing to the publication of its result, us.
    pub run_us: u64,
}

fn by_name<S: Serializer>(times: &[StageTimes; 4], to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(Stage::ALL.map(Stage::name).into_iter().zip(times))
}

/// Times of a stage from the header's stamps. A foreign stage may leave stamps that do not ascend; the time is then 0.
pub fn stage_times(header: &FrameHeader, stage: Stage) -> StageTimes {
    let own = header.stages[stage as usize];
    let input_ns = match (stage as usize).checked_sub(1) {
        Some(before) => header.stages[before].published_ns,
        None => own.received_ns,
    };
    StageTimes {
        queue_us: own.started_ns.saturating_sub(input_ns) / 1000,
        run_us: own.published_ns.saturating_sub(own.started_ns) / 1000,
    }
}

/// From the scan's arrival to the objects' publication, us.
pub fn latency_us(header: &FrameHeader) -> u64 {
    let [ingest, .., refiner] = header.stages;
    refiner.published_ns.saturating_sub(ingest.received_ns) / 1000
}

/// The line for a change of state. `wire` is the only key that it shares with a frame's line.
pub fn status_line(status: &Status) -> Value {
    json!({"wire": WIRE_VERSION, "status": status_words(status)})
}

/// A status as JSON; `state` is `?` if the state is not valid.
pub fn status_words(status: &Status) -> Value {
    let by_name = |counts: [u64; 4]| {
        Stage::ALL.map(Stage::name).into_iter().zip(counts).collect::<BTreeMap<_, _>>()
    };
    json!({
        "state": state_word(status),
        "reason": status.reason(),
        "sequence": (status.sequence != Status::NONE).then_some(status.sequence),
        "age_ms": age_ms(status),
        "frames_in": status.frames_in,
        "frames_out": status.frames_out,
        "frames_dropped": status.frames_dropped,
        "frames_late": status.frames_late,
        "stages_out": by_name(status.stages_out),
        "stages_late": by_name(status.stages_late),
        "blind_deg": blind_deg(status.blind_sectors),
        "not_finite_share": status.not_finite_share,
        "ground_lost": status.is_ground_lost != 0,
    })
}

fn state_word(status: &Status) -> &'static str {
    status.checked().map_or("?", StatusState::name)
}

fn age_ms(status: &Status) -> Option<u64> {
    let is_known = status.age_ns != Status::NONE;
    is_known.then_some(status.age_ns / 1_000_000)
}

/// Name of a stage's state; `?` if the heartbeat is not valid.
pub fn health_state(health: &Health) -> &'static str {
    health.checked().map_or("?", |(_, state)| state.name())
}

/// Names and values of the counts that are not zero.
pub fn counted(counts: &CandidateCounts) -> impl Iterator<Item = (&'static str, u64)> {
    counts.named().filter(|(_, count)| *count > 0)
}

/// A stage's heartbeat as JSON; `health` is `None` if the stage is silent.
pub fn stage_words(stage: Stage, health: Option<&Health>) -> Value {
    let Some(health) = health else {
        return json!({"stage": stage.name(), "state": "silent"});
    };
    json!({
        "stage": stage.name(),
        "process": health.pid,
        "state": health_state(health),
        "frames_in": health.frames_in,
        "frames_out": health.frames_out,
        "frames_dropped": health.frames_dropped,
        "messages_refused": health.messages_refused,
        "run_p50_us": health.run_p50_us,
        "run_p99_us": health.run_p99_us,
        "run_max_us": health.run_max_us,
        "candidates": counted(&health.candidates).collect::<BTreeMap<_, _>>(),
        "reason": health.reason(),
    })
}

/// Ranges of the blind sectors, degrees. Neighbouring sectors become one range.
fn blind_deg(sectors: u64) -> Vec<[usize; 2]> {
    let mut ranges: Vec<[usize; 2]> = Vec::new();
    let width = 360 / Status::SECTORS;
    for from in (0..Status::SECTORS).filter(|sector| sectors >> sector & 1 == 1) {
        let from = from * width;
        match ranges.last_mut() {
            Some([_, to]) if *to == from => *to += width,
            _ => ranges.push([from, from + width]),
        }
    }
    ranges
}

/// The line of a frame. `objects` must have passed [`Object::checked`] with as many `classes`.
pub fn line<'a>(
    header: &'a FrameHeader,
    objects: &[Object],
    classes: &'a [String],
    status: &Status,
) -> Line<'a> {
    let (published, suppressed): (Vec<usize>, Vec<usize>) =
        (0..objects.len()).partition(|index| objects[*index].is_published());
    let suppressed = suppressed.into_iter().map(|index| {
        let object = &objects[index];
        let disposition = Disposition::NAMES.get(object.disposition as usize);
        SuppressedLine {
            object: object_line(object, classes),
            reason: disposition.unwrap_or(&"?"),
            // Index of the suppressing object in the line.
            by: (published.binary_search(&(object.suppressed_by as usize))).ok(),
            overlap: object.overlap,
        }
    });
    let suppressed = suppressed.collect();
    let objects = published.iter().map(|index| &objects[*index]);
    let objects = objects.map(|object| object_line(object, classes));
    Line {
        wire: WIRE_VERSION,
        sequence: header.sequence,
        frame: header.name(),
        stamp_ns: header.sensor_stamp_ns,
        model: format!("{:016x}", header.model_fingerprint),
        objects: objects.collect(),
        suppressed,
        stages: Stage::ALL.map(|stage| stage_times(header, stage)),
        latency_us: latency_us(header),
        flags: Flags(header.flags).names().collect(),
        state: state_word(status),
        age_ms: age_ms(status),
        blind_deg: blind_deg(status.blind_sectors),
        not_finite_share: status.not_finite_share,
        ground_lost: status.is_ground_lost != 0,
    }
}

pub(crate) fn object_line<'a>(object: &Object, classes: &'a [String]) -> ObjectLine<'a> {
    let is_known = object.kind == ObjectKind::Known as u32;
    let class = classes.get(object.class_id as usize).map_or("?", String::as_str);
    let news = object.track();
    let corners = (object.footprint_count as usize).min(object.footprint_m.len());
    ObjectLine {
        kind: if is_known { "known" } else { "unknown" },
        label: if is_known { class } else { "unknown" },
        score: object.score,
        probability: object.probability(),
        center_m: object.center_m,
        size_m: object.size_m,
        yaw_rad: object.yaw_rad,
        eds: object.eds,
        eds_normalised: object.eds_normalised,
        unknown_probability: (object.unknown_probability != NO_PROBABILITY)
            .then_some(object.unknown_probability),
        points: object.points_count,
        track: (object.track_id != Object::NONE).then_some(object.track_id),
        // A refiner may confirm a track without telling its age.
        confirmed: (object.track_id != Object::NONE)
            .then_some(object.flags & Object::CONFIRMED != 0),
        age_scans: news.map(|news| news.age_scans),
        speed_mps: news.and_then(|news| news.speed_mps),
        unrefined: object.flags & Object::UNREFINED != 0,
        split: object.flags & Object::SPLIT != 0,
        footprint_m: object.footprint_m[..corners].to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_ipc_types::{FOOTPRINT_MAX, GateKind, StageStamps};

    fn object(kind: ObjectKind, disposition: Disposition, suppressed_by: u32) -> Object {
        let mut footprint_m = [[0.0; 2]; FOOTPRINT_MAX];
        footprint_m[1] = [2.0, 0.5];
        Object {
            kind: kind as u32,
            disposition: disposition as u32,
            suppressed_by,
            class_id: 1,
            score: 0.5,
            center_m: [10.0, -2.0, -1.0],
            size_m: [4.0, 2.0, 1.5],
            yaw_rad: 0.25,
            eds: 18.0,
            eds_normalised: 1.5,
            unknown_probability: NO_PROBABILITY,
            gate: GateKind::Eds as u32,
            threshold: 1.2,
            points_first: 0,
            points_count: 42,
            flags: Object::UNREFINED | Object::CONFIRMED | 10 << 8 | 3 << 16 | 255 << 24,
            track_id: 7,
            overlap: 0.0,
            footprint_count: 2,
            footprint_m,
        }
    }

    fn written(objects: &[Object]) -> Value {
        let mut header = FrameHeader::new(8, "000008");
        (header.sensor_stamp_ns, header.model_fingerprint) = (77, 0xab0);
        header.flag(Flags::RESENT);
        for (number, stamps) in header.stages.iter_mut().enumerate() {
            let begin = 1_000_000 * number as u64;
            *stamps = StageStamps {
                received_ns: begin + 20_000,
                started_ns: begin + 50_000,
                published_ns: begin + 900_000,
            };
        }
        let classes = ["car", "pedestrian"].map(String::from);
        let status = Status {
            wire_version: WIRE_VERSION,
            state: StatusState::Blind as u32,
            run_id: 1,
            age_ns: Status::NONE,
            blind_sectors: 0b11,
            is_ground_lost: 1,
            ..Status::default()
        };
        serde_json::to_value(line(&header, objects, &classes, &status)).unwrap()
    }

    /// Each place of `expected` holds what is said there.
    fn assert_has(line: &Value, expected: &str) {
        assert_eq!(line["wire"], WIRE_VERSION);
        let expected: BTreeMap<String, Value> = serde_json::from_str(expected).unwrap();
        for (place, value) in &expected {
            assert_eq!(line.pointer(place), Some(value), "{place}");
        }
    }

    #[test]
    fn a_frame_is_written_as_documented() {
        let mut told = object(ObjectKind::Unknown, Disposition::TooFewPoints, Object::NONE);
        told.unknown_probability = 0.75;
        let line = written(&[
            object(ObjectKind::Unknown, Disposition::OverlapsKnown, 2),
            object(ObjectKind::Unknown, Disposition::Published, Object::NONE),
            object(ObjectKind::Known, Disposition::Published, Object::NONE),
            told,
        ]);
        assert_eq!(line["objects"].as_array().map(Vec::len), Some(2));
        assert_has(&line, include_str!("lines/frame.json"));
    }

    #[test]
    fn a_status_is_written_as_documented() {
        let status = Status {
            wire_version: WIRE_VERSION,
            state: StatusState::Degraded as u32,
            run_id: 1,
            sequence: Status::NONE,
            age_ns: 12_345_678,
            stages_late: [0, 3, 0, 0],
            blind_sectors: 0b1011 | 1 << 35,
            ..Status::default()
        };
        assert_has(&status_line(&status), include_str!("lines/status.json"));
    }

    #[test]
    fn stamps_that_go_back_give_no_garbage() {
        let mut header = FrameHeader::new(0, "a");
        header.stages[1].started_ns = 5;
        header.stages[0].published_ns = 10;
        let times = stage_times(&header, Stage::Backbone);
        assert_eq!((times.queue_us, times.run_us), (0, 0));
    }
}
