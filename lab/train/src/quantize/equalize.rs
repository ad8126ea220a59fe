//! The ranges of a level's channels against the weights that read them.
//!
//! A byte's unit goes into the weights (as the backbone does it), and a layer's weights of one output channel share one step.
//! A channel with a range of its own is rounded finely, but one that is rarely large then makes its weights large, and the
//! step coarse for all others. One range for the whole level is the other extreme. Ranges between them are r^a R^(1 - a):
//! r the channel's, R the level's largest. The exponent a is the one for which the readers' outputs move least, by the
//! square errors of rounded values and of rounded weights, each output channel's over its own power. Then channel after
//! channel is moved a little to either side as long as that helps.

use mluc_model::Folded;

use super::histogram::{BINS, STEPS, error, largest, power};

/// Exponents tried: these many steps from 0 to 1.
const TRIES: usize = 8;
/// Times that each channel is moved, and by how much.
const PASSES: usize = 3;
const FACTORS: [f64; 2] = [0.8, 1.25];
/// Of a channel's least range over the largest value seen. Scans to come hold larger ones; what is cut from them costs far
/// more than finer steps would gain.
const MARGIN: f64 = 1.25;
/// Steps of a weight on either side of 0.
const WEIGHT_STEPS: f64 = 127.0;

/// What was seen of one channel.
struct Channel<'a> {
    counts: &'a [u64; BINS],
    /// The least that it may be: nothing seen is cut, nor what is a little larger. None where every value was 0.
    range: Option<f64>,
    /// Sum of the squares.
    power: f64,
}

impl<'a> Channel<'a> {
    fn new(counts: &'a [u64; BINS]) -> Channel<'a> {
        Channel {
            counts,
            range: largest(counts).map(|largest| MARGIN * largest),
            power: power(counts),
        }
    }
}

/// Of one reader: sums over its taps.
struct Reader {
    cout: usize,
    /// `[cin][cout]`: the largest weight, and the sum of the squares.
    largest: Vec<f64>,
    squares: Vec<f64>,
    taps: f64,
}

impl Reader {
    fn new(layer: &Folded) -> Reader {
        let size = layer.cin * layer.cout;
        let (mut largest, mut squares) = (vec![0.0_f64; size], vec![0.0; size]);
        for tap in layer.weights.chunks_exact(size.max(1)) {
            for (at, weight) in tap.iter().enumerate() {
                let weight = f64::from(weight.abs());
                largest[at] = largest[at].max(weight);
                squares[at] += weight * weight;
            }
        }
        Reader {
            cout: layer.cout,
            largest,
            squares,
            taps: layer.taps as f64,
        }
    }

    /// Mean over the output channels of the square error that roundings make, over the power. `ranges`: each with the square
    /// error of its channel's values.
    fn error(&self, channels: &[Channel], ranges: &[(f64, f64)]) -> f64 {
        let of = |o: usize| {
            let (mut step, mut values, mut signal, mut counts) = (0.0_f64, 0.0, 0.0, 0.0);
            for (i, channel) in channels.iter().enumerate() {
                let (at, unit) = (i * self.cout + o, ranges[i].0 / STEPS);
                step = step.max(self.largest[at] * unit / WEIGHT_STEPS);
                values += self.squares[at] * ranges[i].1;
                signal += self.squares[at] * channel.power;
                counts += channel.power / (unit * unit);
            }
            let weights = step * step / 12.0 * self.taps * counts;
            if signal > 0.0 {
                (values + weights) / signal
            } else {
                0.0
            }
        };
        (0..self.cout).map(of).sum::<f64>() / self.cout as f64
    }
}

/// A range for each channel, by its histogram; none where every value was 0.
pub(crate) fn equalized(counts: &[[u64; BINS]], readers: &[Folded]) -> Option<Vec<f32>> {
    let channels: Vec<Channel> = counts.iter().map(Channel::new).collect();
    let largest = channels.iter().filter_map(|channel| channel.range);
    let largest = largest.reduce(f64::max)?;
    let readers: Vec<Reader> = readers.iter().map(Reader::new).collect();
    // Ranges, each with the square error of its channel's values, and the errors of the readers.
    let rated = |ranges: Vec<(f64, f64)>| {
        let readers = readers.iter();
        let errors = readers.map(|reader| reader.error(&channels, &ranges));
        (errors.sum::<f64>(), ranges)
    };
    let tried = (0..=TRIES).map(|number| {
        let exponent = number as f64 / TRIES as f64;
        let range = |channel: &Channel| {
            let own = channel.range.unwrap_or(largest);
            largest * (own / largest).powf(exponent)
        };
        let ranges: Vec<f64> = channels.iter().map(range).collect();
        let pairs = channels.iter().zip(&ranges);
        let errors = pairs.map(|(channel, range)| error(channel.counts, *range));
        rated(ranges.iter().copied().zip(errors).collect())
    });
    let mut best = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    for _ in 0..PASSES {
        for (number, channel) in channels.iter().enumerate() {
            for factor in FACTORS {
                let mut ranges = best.1.clone();
                let range = ranges[number].0 * factor;
                if channel.range.is_some_and(|least| range < least) {
                    continue;
                }
                ranges[number] = (range, error(channel.counts, range));
                let found = rated(ranges);
                if found.0 < best.0 {
                    best = found;
                }
            }
        }
    }
    Some(best.1.iter().map(|(range, _)| *range as f32).collect())
}

#[cfg(test)]
mod tests {
    use super::super::histogram::bin;
    use super::*;

    fn histogram(values: &[(f32, u64)]) -> [u64; BINS] {
        let mut counts = [0; BINS];
        for (value, count) in values {
            counts[bin(*value).expect("a bin")] += count;
        }
        counts
    }

    fn reader(weights: &[f32]) -> Folded {
        Folded {
            taps: 1,
            cin: weights.len(),
            cout: 1,
            weights: weights.to_vec(),
            bias: vec![0.0],
        }
    }

    #[test]
    fn a_channel_that_is_rarely_large_gets_a_smaller_share_of_the_weights_steps() {
        let common = histogram(&[(1.0, 10_000)]);
        let rare = histogram(&[(0.01, 10_000), (100.0, 1)]);
        let channels = [common, rare];
        let equal = equalized(&channels, &[reader(&[1.0, 1.0])]).expect("ranges");
        // Both channels matter: with a range each of its own, the weight of the common one would be 1 of 127.
        let small = equalized(&channels, &[reader(&[1.0, 1e-3])]).expect("ranges");
        let ratio = |ranges: &[f32]| ranges[1] / ranges[0];
        assert!(ratio(&equal) < 50.0, "{equal:?}");
        assert!(ratio(&small) > ratio(&equal), "{small:?}");
    }

    #[test]
    fn nothing_seen_gives_no_range_and_a_silent_channel_the_largest() {
        let (silent, some) = (histogram(&[]), histogram(&[(2.0, 5)]));
        assert_eq!(equalized(&[silent], &[reader(&[1.0])]), None);
        let ranges = equalized(&[silent, some], &[reader(&[0.0, 1.0])]).expect("ranges");
        let mut inside = ranges.iter().map(|range| (1.5..3.0).contains(range));
        assert!(inside.all(|inside| inside), "{ranges:?}");
    }
}
