//! Convolution on bytes against the plain version: the same bits, on every set of registers of this machine.

mod common;

use common::{Random, with_threads};
use mluc_kernels::{
    ABSENT, Bf16, Element, Epilogue, Gather, Level, WeightsInt8, convolve_int8, convolve_int8_at,
};

const CHANNELS: [usize; 13] = [1, 2, 3, 4, 15, 18, 48, 62, 63, 64, 84, 96, 128];
const ROWS: [usize; 8] = [1, 2, 7, 13, 95, 96, 97, 301];
const TAPS: [usize; 4] = [1, 4, 9, 27];

struct Case {
    cin: usize,
    cout: usize,
    gather: Gather,
    input: Vec<u8>,
    /// Whole numbers up to 127, which each output channel has: its scale is 1.
    weights: Vec<f32>,
    bias: Option<Vec<f32>>,
    relu: bool,
}

impl Case {
    fn random(seed: usize, cin: usize, cout: usize) -> Case {
        let mut random = Random(seed as u64);
        let (outputs, inputs) = (ROWS[random.below(8)], ROWS[random.below(8)]);
        let taps = TAPS[random.below(if cin * cout > 4096 { 2 } else { 4 })];
        let absent_percent = [0, 0, 50, 90, 100][random.below(5)];
        // Extremes are common: a product of bytes that saturates would be noticed.
        let byte = |random: &mut Random| [0, 255, 255, random.below(256)][random.below(4)] as u8;
        let weight = |random: &mut Random| {
            let any = random.below(255) as i32 - 127;
            [127, -127, any, any][random.below(4)] as f32
        };
        let mut weights: Vec<f32> = (0..taps * cin * cout)
            .map(|_| weight(&mut random))
            .collect();
        weights[..cout].fill(127.0);
        let with_bias = random.below(2) == 0;
        Case {
            gather: random.gather(outputs, taps, inputs, absent_percent),
            input: (0..inputs * cin).map(|_| byte(&mut random)).collect(),
            weights,
            bias: with_bias.then(|| {
                let whole = |value: &f32| (value * 1e6).round();
                random.values(cout).iter().map(whole).collect()
            }),
            relu: random.below(2) == 0,
            cin,
            cout,
        }
    }

    fn packed(&self) -> WeightsInt8 {
        WeightsInt8::pack(self.gather.taps, self.cin, self.cout, &self.weights)
    }

    fn epilogue(&self) -> Epilogue<'_> {
        Epilogue {
            bias: self.bias.as_deref(),
            relu: self.relu,
        }
    }

    /// Sums are whole numbers below 2^24 or rounded once, as an f32 of an i32 is, and once more with the bias.
    fn expected(&self) -> Vec<f32> {
        let Case { cin, cout, .. } = *self;
        let taps = self.gather.taps;
        let mut output = vec![];
        for index in self.gather.index.chunks_exact(taps) {
            for o in 0..cout {
                let mut sum = 0_i64;
                for (tap, &row) in index.iter().enumerate().filter(|(_, row)| **row != ABSENT) {
                    let row = &self.input[row as usize * cin..][..cin];
                    let weight = |i: usize| self.weights[(tap * cin + i) * cout + o] as i64;
                    sum += row
                        .iter()
                        .enumerate()
                        .map(|(i, x)| i64::from(*x) * weight(i))
                        .sum::<i64>();
                }
                let value = sum as f32 + self.bias.as_ref().map_or(0.0, |bias| bias[o]);
                output.push(if self.relu { value.max(0.0) } else { value });
            }
        }
        output
    }

    fn run<O: Element>(&self, level: Level, of: O) -> Vec<O> {
        let mut output = vec![of; self.gather.outputs() * self.cout];
        let weights = self.packed();
        convolve_int8_at(
            level,
            &self.input,
            &self.gather,
            &weights,
            self.epilogue(),
            None,
            &mut output,
        );
        output
    }
}

fn all_channels() -> impl Iterator<Item = Case> {
    let pairs = CHANNELS
        .iter()
        .flat_map(|&cin| CHANNELS.map(|cout| (cin, cout)));
    pairs
        .enumerate()
        .map(|(seed, (cin, cout))| Case::random(seed, cin, cout))
}

#[test]
fn every_level_gives_the_exact_sums() {
    let mut wide = 0;
    for case in all_channels() {
        let expected = case.expected();
        wide += expected.iter().filter(|value| value.abs() > 1e6).count();
        for level in Level::all() {
            let name = format!("{} {} -> {}", level.name(), case.cin, case.cout);
            assert!(case.run(level, f32::NAN) == expected, "{name}");
            let short = case.run(level, Bf16::default());
            let rounded = |x: &f32| Bf16::from_f32(*x);
            assert!(
                short == expected.iter().map(rounded).collect::<Vec<_>>(),
                "{name}, bf16"
            );
            let bytes = case.run(level, 7_u8);
            let rounded = |x: &f32| x.clamp(0.0, 255.0) as u8;
            assert!(
                bytes == expected.iter().map(rounded).collect::<Vec<_>>(),
                "{name}, u8"
            );
        }
    }
    assert!(wide > 1000, "{wide} large sums");
}

/// Every level has them, even where sums wrap on the way: processors of signed bytes add 128 times the weights.
#[test]
fn the_largest_sums_are_exact() {
    let (taps, cin, cout) = (9, 1024, 16);
    for (byte, weight) in [(255, 127.0), (255, -127.0), (0, 127.0)] {
        let weights = WeightsInt8::pack(taps, cin, cout, &vec![weight; taps * cin * cout]);
        let gather = Gather::new(taps, vec![0; 9 * 3]);
        for level in Level::all() {
            let mut output = vec![f32::NAN; 3 * cout];
            let input = vec![byte; cin];
            convolve_int8_at(
                level,
                &input,
                &gather,
                &weights,
                Epilogue::NONE,
                None,
                &mut output,
            );
            let expected = (i32::from(byte) * weight as i32 * (taps * cin) as i32) as f32;
            assert!(
                output.iter().all(|y| *y == expected),
                "{}: {output:?}",
                level.name()
            );
        }
    }
}

#[test]
fn weights_are_rounded_to_a_127th_of_their_channels_largest() {
    let (cin, cout) = (6, 5);
    let mut random = Random(4);
    let mut plain = random.values(cin * cout);
    (0..cin).for_each(|i| plain[i * cout + 2] = 0.0);
    let weights = WeightsInt8::pack(1, cin, cout, &plain);
    assert_eq!(weights.scale()[2], 0.0, "a channel of zeros");
    for i in 0..cin {
        let mut input = vec![0; cin];
        input[i] = 1;
        let mut output = vec![f32::NAN; cout];
        let gather = Gather::new(1, vec![0]);
        convolve_int8(&input, &gather, &weights, Epilogue::NONE, None, &mut output);
        for (o, (found, scale)) in output.iter().zip(weights.scale()).enumerate() {
            let error = (found - plain[i * cout + o]).abs();
            assert!(error <= 0.500_01 * scale, "{i} -> {o}: {error} of {scale}");
        }
    }
}

#[test]
fn output_rows_in_any_order() {
    for seed in 0..40 {
        let mut random = Random(seed);
        let case = Case::random(
            seed as usize,
            CHANNELS[random.below(13)],
            CHANNELS[random.below(13)],
        );
        let (outputs, cout, expected) = (case.gather.outputs(), case.cout, case.expected());
        let mut rows = random.permutation(2 * outputs);
        rows.truncate(outputs);
        if seed % 2 == 0 {
            rows.sort_unstable();
        }
        let mut output = vec![7.25; 2 * outputs * cout];
        let (weights, places) = (case.packed(), Some(&rows[..]));
        convolve_int8(
            &case.input,
            &case.gather,
            &weights,
            case.epilogue(),
            places,
            &mut output,
        );
        for (row, expected) in rows.iter().zip(expected.chunks_exact(cout)) {
            assert!(
                &output[*row as usize * cout..][..cout] == expected,
                "row {row}"
            );
        }
        let untouched = output.iter().filter(|y| **y == 7.25).count();
        assert_eq!(untouched, outputs * cout, "rows that are not named");
    }
}

#[test]
fn same_bits_with_any_number_of_threads() {
    let (cin, cout, taps) = (48, 96, 9);
    let mut random = Random(5);
    let gather = random.gather(3001, taps, 2000, 20);
    let input: Vec<u8> = (0..2000 * cin).map(|_| random.below(256) as u8).collect();
    let weights = WeightsInt8::pack(taps, cin, cout, &random.values(taps * cin * cout));
    let work = || {
        let mut output = vec![0.0; 3001 * cout];
        convolve_int8(&input, &gather, &weights, Epilogue::NONE, None, &mut output);
        output
    };
    let one = with_threads(1, work);
    assert!(one == with_threads(2, work) && one == with_threads(3, work));
}

#[test]
#[should_panic(expected = "input row 10 of 10")]
fn a_row_outside_the_input_is_refused() {
    let gather = Gather::new(1, vec![0, 10, ABSENT]);
    let weights = WeightsInt8::pack(1, 4, 16, &[1.0; 64]);
    let mut output = [0_u8; 48];
    with_threads(1, || {
        convolve_int8(
            &[0; 40],
            &gather,
            &weights,
            Epilogue::NONE,
            None,
            &mut output,
        )
    });
}
