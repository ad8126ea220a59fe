//! The judgement on recorded runs: the same program, seven times on the same machine, and the same with a known change.

use mluc_bench::report::{CompareOptions, Comparison, FrameRecord, Verdict, compare, read_frames};

const RUNS: [&str; 7] = [
    include_str!("recorded/run_0.csv"),
    include_str!("recorded/run_1.csv"),
    include_str!("recorded/run_2.csv"),
    include_str!("recorded/run_3.csv"),
    include_str!("recorded/run_4.csv"),
    include_str!("recorded/run_5.csv"),
    include_str!("recorded/run_6.csv"),
];

/// Share of the cores that other processes took during these runs: the worst case, and a stage's figures scatter by a tenth.
const OTHERS: f64 = 0.65;

fn runs() -> Vec<Vec<FrameRecord>> {
    RUNS.iter()
        .map(|text| read_frames(text).expect("a recorded run"))
        .collect()
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

fn verdict(comparison: &Comparison, figure: &str) -> Verdict {
    let row = comparison.rows.iter().find(|row| row.figure == figure);
    row.expect("a figure of that name").verdict
}

#[test]
fn runs_of_one_program_are_equal_in_19_of_20_pairs() {
    let runs = runs();
    let pairs = || (0..runs.len()).flat_map(|a| (a + 1..runs.len()).map(move |b| (a, b)));
    let different: Vec<String> = pairs()
        .map(|(a, b)| (a, b, judged(&runs[a], &runs[b])))
        .filter(|(.., comparison)| !comparison.is_equal)
        .map(|(a, b, comparison)| format!("{a} {b}: {}", comparison.sentence()))
        .collect();
    let all = pairs().count();
    assert!(
        all >= 20 && 20 * different.len() <= all,
        "{} of {all}: {different:#?}",
        different.len()
    );
}

#[test]
fn halves_of_one_run_are_equal() {
    for run in runs() {
        let measured: Vec<FrameRecord> =
            run.into_iter().filter(|frame| !frame.is_warm_up).collect();
        let (first, second) = measured.split_at(measured.len() / 2);
        let comparison = judged(first, second);
        assert!(
            comparison.is_equal,
            "{}",
            comparison.table(["first half", "second half"])
        );
    }
}

/// Whether the backbone and the whole are found slower, and the head is not.
fn is_found(comparison: &Comparison) -> bool {
    verdict(comparison, "backbone run p50, us") == Verdict::Higher
        && verdict(comparison, "end to end p50, us") == Verdict::Higher
        && verdict(comparison, "head run p50, us") == Verdict::Noise
}

#[test]
fn one_start_on_a_busy_machine_tells_a_multiple() {
    let runs = runs();
    let found = (0..runs.len() - 1)
        .filter(|&a| is_found(&judged(&runs[a], &slower(&runs[a + 1], 1.5))))
        .count();
    assert_eq!(found, runs.len() - 1);
}

/// Four starts each: what differs between starts is seen, and needs not be assumed.
#[test]
fn four_starts_tell_much_less() {
    let runs = runs();
    let rounds = |numbers: [usize; 4]| -> Vec<FrameRecord> {
        let each = numbers.iter().enumerate().flat_map(|(round, &number)| {
            runs[number].iter().cloned().map(move |frame| FrameRecord {
                round: round as u32,
                ..frame
            })
        });
        each.collect()
    };
    let (a, b) = (rounds([0, 2, 4, 6]), rounds([1, 3, 5, 0]));
    let equal = judged(&a, &b);
    assert!(equal.is_equal, "{}", equal.table(["a", "b"]));
    let slower = judged(&a, &slower(&b, 0.35));
    assert!(is_found(&slower), "{}", slower.table(["a", "b"]));
}
