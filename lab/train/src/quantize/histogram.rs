//! Counts of values by the logarithm of their size, and what rounding to bytes would cost them.

/// Bins an octave: the top bits of the fraction of an f32.
const FRACTION_BITS: u32 = 4;
/// Smaller values count as 0.
const EXPONENT_MIN: i32 = -24;
/// Larger values count as the largest.
const EXPONENT_MAX: i32 = 24;
/// Of a histogram.
pub(crate) const BINS: usize = ((EXPONENT_MAX - EXPONENT_MIN) as usize) << FRACTION_BITS;
/// Steps of a byte.
pub(crate) const STEPS: f64 = 255.0;

/// The bin of a value above 0.
pub(crate) fn bin(value: f32) -> Option<usize> {
    let first = ((EXPONENT_MIN + 127) as u32) << FRACTION_BITS;
    let at = (value.to_bits() >> (23 - FRACTION_BITS)).checked_sub(first)? as usize;
    (value > 0.0).then(|| at.min(BINS - 1))
}

/// The lower edge of a bin; the upper one of the bin before.
fn edge(bin: usize) -> f64 {
    let fraction = 1.0 + (bin % (1 << FRACTION_BITS)) as f64 / f64::from(1 << FRACTION_BITS);
    fraction * 2_f64.powi(EXPONENT_MIN + (bin >> FRACTION_BITS) as i32)
}

/// The upper edge of the last bin that counted a value.
pub(crate) fn largest(counts: &[u64]) -> Option<f64> {
    let last = counts.iter().rposition(|count| *count > 0)?;
    Some(edge(last + 1))
}

/// Sum of the square errors when values are rounded to steps of `range` and cut there.
pub(crate) fn error(counts: &[u64], range: f64) -> f64 {
    let step = range / STEPS;
    let seen = counts.iter().enumerate().filter(|bin| *bin.1 > 0);
    seen.map(|(bin, count)| {
        let value = middle(bin);
        let each = if value > range {
            (value - range).powi(2)
        } else if value < 0.5 * step {
            value.powi(2)
        } else {
            step.powi(2) / 12.0
        };
        *count as f64 * each
    })
    .sum()
}

/// The middle of a bin.
fn middle(bin: usize) -> f64 {
    0.5 * (edge(bin) + edge(bin + 1))
}

/// Sum of the squares of the values.
pub(crate) fn power(counts: &[u64]) -> f64 {
    let bins = counts.iter().enumerate();
    bins.map(|(bin, count)| *count as f64 * middle(bin).powi(2))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_hold_what_lies_between_their_edges() {
        for value in [1e-6, 0.03, 0.99, 1.0, 1.06, 17.3, 1e5_f32] {
            let bin = bin(value).expect("a bin");
            let edges = edge(bin)..edge(bin + 1);
            assert!(edges.contains(&f64::from(value)), "{value}");
        }
        for value in [0.0, -1.0, 1e-9, f32::MIN_POSITIVE] {
            assert_eq!(bin(value), None);
        }
        assert_eq!(bin(f32::INFINITY), Some(BINS - 1));
    }

    #[test]
    fn cutting_costs_the_square_and_rounding_a_twelfth_of_a_step() {
        let mut counts = vec![0; BINS];
        assert_eq!(largest(&counts), None);
        counts[bin(1.0).expect("a bin")] = 12;
        let top = largest(&counts).expect("values");
        assert!((1.0..1.1).contains(&top), "{top}");
        let step = 2.0 / STEPS;
        assert!((error(&counts, 2.0) - step * step).abs() < 1e-12);
        assert!((error(&counts, 0.5) - 12.0 * 0.53_f64.powi(2)).abs() < 0.2);
    }
}
