//! How well a straight line describes cost over size.

use serde::Serialize;

/// cost = at_zero + slope * size, by least squares.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Fit {
    /// What against what.
    pub(crate) of: String,
    /// ms.
    pub(crate) at_zero_ms: f64,
    /// us for one more.
    pub(crate) us_each: f64,
    /// Share of the costs' variance that the line explains: 1 is a perfect line.
    pub(crate) r_squared: f64,
}

impl Fit {
    /// `points`: size and cost in ms.
    pub(crate) fn through(of: String, points: &[(f64, f64)]) -> Fit {
        let count = points.len().max(1) as f64;
        let x_mean = points.iter().map(|(x, _)| x).sum::<f64>() / count;
        let y_mean = points.iter().map(|(_, y)| y).sum::<f64>() / count;
        let off = points.iter().map(|(x, y)| (x - x_mean, y - y_mean));
        let [xx, xy, yy] = off.fold([0.0; 3], |[xx, xy, yy], (x, y)| {
            [xx + x * x, xy + x * y, yy + y * y]
        });
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        Fit {
            of,
            at_zero_ms: y_mean - slope * x_mean,
            us_each: 1e3 * slope,
            r_squared: if xx * yy > 0.0 {
                xy * xy / (xx * yy)
            } else {
                1.0
            },
        }
    }
}

impl std::fmt::Display for Fit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}: {:.2} ms + {:.3} us each, R^2 {:.4}",
            self.of, self.at_zero_ms, self.us_each, self.r_squared
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_and_a_bend_is_told() {
        let line: Vec<_> = (0..10).map(|x| (x as f64, 3.0 + 0.5 * x as f64)).collect();
        let fit = Fit::through("line".into(), &line);
        assert!((fit.at_zero_ms - 3.0).abs() < 1e-9 && (fit.us_each - 500.0).abs() < 1e-6);
        assert!((fit.r_squared - 1.0).abs() < 1e-9);
        let bend: Vec<_> = (0..10).map(|x| (x as f64, (x * x * x) as f64)).collect();
        assert!(Fit::through("bend".into(), &bend).r_squared < 0.9);
        assert_eq!(Fit::through("nothing".into(), &[]).us_each, 0.0);
    }
}
