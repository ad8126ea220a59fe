//! The judgement on recorded runs: the same program, seven times on the same machine, and the same with a known change.

use super::{Comparison, FrameRecord, Verdict, compare, read_frames};

/// Share of the cores that other processes took during these runs: the worst case, and a stage's figures scatter by a tenth.
const OTHERS: f64 = 0.65;

fn runs() -> [Vec<FrameRecord>; 7] {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/recorded");
    [0, 1, 2, 3, 4, 5, 6].map(|number| {
        let text = std::fs::read_to_string(format!("{folder}/run_{number}.csv"));
        read_frames(&text.expect("a file")).expect("a recorded run")
    })
}

fn judged(a: &[FrameRecord], b: &[FrameRecord]) -> Comparison {
    compare([a, b], OTHERS).expect("enough frames")
}

/// The backbone takes `share` longer; everything behind it moves.
fn slower(frames: &[FrameRecord], share: f64) -> Vec<FrameRecord> {
    let mut slower = frames.to_vec();
    for frame in &mut slower {
        let Some(stamps) = &mut frame.stamps else {
            continue;
        };
        let more_ns = (share * (stamps[1].published_ns - stamps[1].started_ns) as f64) as i64;
        stamps[1].published_ns += more_ns;
        for stage in &mut stamps[2..] {
            stage.received_ns += more_ns;
            stage.started_ns += more_ns;
            stage.published_ns += more_ns;
        }
        frame.arrived_ns += more_ns;
    }
    slower
}

/// Whether the backbone and the whole are found slower, and the head is not.
fn is_found(comparison: &Comparison) -> bool {
    let verdict = |figure: &str| {
        let row = comparison.rows.iter().find(|row| row.figure == figure);
        row.expect("a figure of that name").verdict
    };
    verdict("backbone run p50, us") == Verdict::Higher
        && verdict("end to end p50, us") == Verdict::Higher
        && verdict("head run p50, us") == Verdict::Noise
}

#[test]
fn runs_of_one_program_are_equal_in_19_of_20_pairs() {
    let runs = runs();
    let mut sentences = vec![];
    for (number, b) in runs.iter().enumerate() {
        sentences.extend(runs[..number].iter().map(|a| judged(a, b).sentence()));
    }
    assert_eq!(sentences.len(), 21);
    sentences.retain(|sentence| !sentence.starts_with("equal"));
    assert!(sentences.len() <= 1, "{sentences:#?}");
}

#[test]
fn one_start_on_a_busy_machine_tells_a_multiple() {
    for pair in runs().windows(2) {
        assert!(is_found(&judged(&pair[0], &slower(&pair[1], 1.5))));
    }
}

/// Four starts each: what differs between starts is seen, and needs not be assumed.
#[test]
fn four_starts_tell_much_less() {
    let runs = runs();
    let rounds = |numbers: [usize; 4]| -> Vec<FrameRecord> {
        let mut all = vec![];
        for (round, number) in numbers.into_iter().enumerate() {
            let own = runs[number].iter().cloned();
            let round = round as u32;
            all.extend(own.map(|frame| FrameRecord { round, ..frame }));
        }
        all
    };
    let (a, b) = (rounds([0, 2, 4, 6]), rounds([1, 3, 5, 0]));
    let equal = judged(&a, &b);
    assert!(equal.is_equal, "{equal:?}");
    let slower = judged(&a, &slower(&b, 0.35));
    assert!(is_found(&slower), "{slower:?}");
}
