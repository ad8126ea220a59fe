//! The judgement on recorded runs: the same program, seven times on the same machine, and the same with a known change.

use super::{CompareOptions, Comparison, FrameRecord, Verdict, compare, read_frames};

const RUNS: [&str; 7] = [
    include_str!("../../tests/recorded/run_0.csv"),
    include_str!("../../tests/recorded/run_1.csv"),
    include_str!("../../tests/recorded/run_2.csv"),
    include_str!("../../tests/recorded/run_3.csv"),
    include_str!("../../tests/recorded/run_4.csv"),
    include_str!("../../tests/recorded/run_5.csv"),
    include_str!("../../tests/recorded/run_6.csv"),
];

/// Share of the cores that other processes took during these runs: the worst case, and a stage's figures scatter by a tenth.
const OTHERS: f64 = 0.65;

fn runs() -> [Vec<FrameRecord>; 7] {
    RUNS.map(|text| read_frames(text).expect("a recorded run"))
}

fn judged(a: &[FrameRecord], b: &[FrameRecord]) -> Comparison {
    compare(a, b, &CompareOptions::on_machines([OTHERS; 2])).expect("enough frames")
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
    let pairs: Vec<_> = (0..runs.len())
        .flat_map(|a| (a + 1..runs.len()).map(move |b| (a, b)))
        .collect();
    let mut different = vec![];
    for &(a, b) in &pairs {
        let comparison = judged(&runs[a], &runs[b]);
        if !comparison.is_equal {
            different.push(format!("{a} {b}: {}", comparison.sentence()));
        }
    }
    let all = pairs.len();
    assert!(
        all >= 20 && 20 * different.len() <= all,
        "of {all}: {different:#?}"
    );
}

#[test]
fn halves_of_one_run_are_equal() {
    for mut run in runs() {
        run.retain(|frame| !frame.is_warm_up);
        let (first, second) = run.split_at(run.len() / 2);
        let comparison = judged(first, second);
        let table = comparison.table(["first half", "second half"]);
        assert!(comparison.is_equal, "{table}");
    }
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
    assert!(equal.is_equal, "{}", equal.table(["a", "b"]));
    let slower = judged(&a, &slower(&b, 0.35));
    assert!(is_found(&slower), "{}", slower.table(["a", "b"]));
}
