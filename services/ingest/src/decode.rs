//! Decoder of KITTI's `.bin`: x, y, z (m, sensor frame) and reflectance (0 to 1) as little-endian f32, point after point, no header.

use mluc_ipc_types::{Flags, POINTS_MAX, Point};

/// Bytes per point in the file.
pub const POINT_BYTES: usize = 16;

/// Counts of a file's points: read, kept and dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecodeReport {
    /// Whole points in the file.
    pub points_in: u32,
    /// Points kept.
    pub points_out: u32,
    /// Points dropped because a coordinate is NaN or infinite.
    pub dropped_not_finite: u32,
    /// Finite points dropped because they are beyond [`POINTS_MAX`] or the caller's memory.
    pub dropped_over_limit: u32,
    /// Bytes after the last whole point; more than 0 where the file was cut short.
    pub trailing_bytes: u32,
}

impl DecodeReport {
    /// Number of all dropped points.
    pub fn dropped(&self) -> u32 {
        self.dropped_not_finite + self.dropped_over_limit
    }

    /// The frame's flags.
    pub fn flags(&self) -> Flags {
        let flags = [
            (self.dropped_not_finite > 0, Flags::NOT_FINITE),
            (self.dropped_over_limit > 0, Flags::TRUNCATED),
            (self.trailing_bytes > 0, Flags::DAMAGED_INPUT),
            (self.points_out == 0, Flags::EMPTY),
        ];
        let set = flags.into_iter().filter(|(is_set, _)| *is_set);
        set.fold(Flags::default(), |all, (_, flag)| all.with(flag))
    }
}

/// Every whole point of a file, unchanged; the points that [`decode_bin`] drops are included.
pub fn bin_points(bytes: &[u8]) -> impl Iterator<Item = Point> {
    bytes.as_chunks::<POINT_BYTES>().0.iter().map(point)
}

/// Counts points without writing them. `points_out` is the number of points that [`decode_bin`] needs memory for.
pub fn inspect_bin(bytes: &[u8]) -> DecodeReport {
    decode_with(bytes, POINTS_MAX, |_, _| ())
}

/// Reads points into `out`, in file order. Keeps at most `out.len()` points, and at most [`POINTS_MAX`]. Elements beyond
/// `points_out` are not touched.
pub fn decode_bin(bytes: &[u8], out: &mut [Point]) -> DecodeReport {
    decode_with(bytes, out.len().min(POINTS_MAX), |index, point| out[index] = point)
}

fn decode_with(bytes: &[u8], most: usize, mut keep: impl FnMut(usize, Point)) -> DecodeReport {
    let (whole, trailing) = bytes.as_chunks::<POINT_BYTES>();
    let mut report = DecodeReport {
        points_in: whole.len() as u32,
        trailing_bytes: trailing.len() as u32,
        ..DecodeReport::default()
    };
    let mut kept = 0;
    for chunk in whole {
        let point = point(chunk);
        if !point.is_finite() {
            report.dropped_not_finite += 1;
        } else if kept == most {
            report.dropped_over_limit += 1;
        } else {
            keep(kept, point);
            kept += 1;
        }
    }
    report.points_out = kept as u32;
    report
}

fn point(bytes: &[u8; POINT_BYTES]) -> Point {
    let (numbers, _) = bytes.as_chunks();
    let [x, y, z, intensity] = std::array::from_fn(|i| f32::from_le_bytes(numbers[i]));
    // A missing intensity is no reason to lose a place.
    let intensity = if intensity.is_finite() { intensity } else { 0.0 };
    bytemuck::cast([x, y, z, intensity])
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_dataset::scan_bytes as bytes;

    fn decoded(bytes: &[u8]) -> (DecodeReport, Vec<Point>) {
        let report = inspect_bin(bytes);
        let mut out = vec![Point::default(); report.points_out as usize];
        // `inspect_bin` and `decode_bin` give the same report.
        assert_eq!(decode_bin(bytes, &mut out), report);
        (report, out)
    }

    #[test]
    fn points_come_out_in_file_order_but_those_that_are_not_finite() {
        let sound = [[1.0, 2.0, 3.0, 0.5], [-4.0, 5.0, -6.0, 0.25]];
        let (report, points) = decoded(&bytes(&sound));
        assert_eq!(report.flags(), Flags::default());
        let [nan, infinite] = [f32::NAN, f32::NEG_INFINITY];
        let bad = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|n| if n == i { infinite } else { 0.0 }));
        let among = [&[[nan; 4], sound[0]], &bad[..], &[sound[1]]].concat();
        let (report_among, points_among) = decoded(&bytes(&among));
        let counts =
            [report, report_among].map(|r| [r.points_in, r.points_out, r.dropped_not_finite]);
        assert_eq!(counts, [[2, 2, 0], [7, 3, 4]]);
        assert_eq!(report_among.flags(), Flags::NOT_FINITE);
        let numbers = points.iter().map(|p| [p.x_m, p.y_m, p.z_m, p.intensity]);
        // An intensity that is not finite is 0.
        let kept = [points[0], Point::default(), points[1]];
        assert!(numbers.eq(sound) && points_among == kept);
    }

    #[test]
    fn a_cut_file_gives_its_whole_points_and_an_empty_one_none() {
        let whole = bytes(&[[1.0; 4], [2.0; 4]]);
        for cut in 1..16 {
            let (report, points) = decoded(&whole[..32 - cut]);
            assert_eq!((report.trailing_bytes, points.len()), (16 - cut as u32, 1));
            assert_eq!(report.flags(), Flags::DAMAGED_INPUT);
        }
        assert_eq!(decoded(&[]).0.flags(), Flags::EMPTY);
    }

    #[test]
    fn a_million_points_are_cut_at_the_limit() {
        let mut million = vec![[1.0, 0.0, 0.0, 0.0]; 1_000_000];
        million[5][2] = f32::NAN;
        let (report, points) = decoded(&bytes(&million));
        assert_eq!(points.len(), POINTS_MAX);
        let dropped = report.dropped_over_limit as usize;
        assert_eq!(dropped, 1_000_000 - POINTS_MAX - 1);
        assert_eq!(report.flags(), Flags::NOT_FINITE.with(Flags::TRUNCATED));
        assert_eq!(report.points_in, report.points_out + report.dropped());
    }
}
