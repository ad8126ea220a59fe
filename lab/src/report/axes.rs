//! A panel with axes: from figures to places.

use super::drawing::{Anchor, Drawing};
use mluc_gateway::picture::Color;

const INK: Color = [40, 40, 40];
const GRID: Color = [226, 226, 226];

/// A panel: where it lies and what its axes span. The one across begins at 0.
#[derive(Clone, Debug)]
pub(super) struct Axes {
    /// Upper left corner of the plotted area, px.
    pub low: [f32; 2],
    /// Lower right corner, px.
    pub high: [f32; 2],
    /// Right end of x.
    pub x_max: f64,
    /// Lower end of y.
    pub y_min: f64,
    /// Upper end of y.
    pub y_max: f64,
}

impl Axes {
    /// The place of a figure; what lies beyond an end is put onto it.
    pub(super) fn at(&self, x: f64, y: f64) -> [f32; 2] {
        let share = |v: f64, max: f64| (v / max).clamp(0.0, 1.0) as f32;
        let (across, up) = (
            share(x, self.x_max),
            share(y - self.y_min, self.y_max - self.y_min),
        );
        [
            self.low[0] + (self.high[0] - self.low[0]) * across,
            self.high[1] - (self.high[1] - self.low[1]) * up,
        ]
    }

    /// Grid, numbers, and the names of the axes: y's above it, x's below where `x_name` is not empty.
    pub(super) fn draw(&self, drawing: &mut Drawing, x_name: &str, y_name: &str) {
        for tick in ticks(self.y_max - self.y_min)
            .iter()
            .map(|t| t + self.y_min)
        {
            let (left, right) = (self.at(0.0, tick), self.at(self.x_max, tick));
            drawing.path(&[left, right], 1.0, GRID);
            let at = [left[0] - 8.0, left[1]];
            drawing.text(at, &number(tick), 8.0, INK, Anchor::End);
        }
        for tick in ticks(self.x_max) {
            let (bottom, top) = (self.at(tick, self.y_min), self.at(tick, self.y_max));
            drawing.path(&[bottom, top], 1.0, GRID);
            let at = [bottom[0], bottom[1] + 12.0];
            drawing.text(at, &number(tick), 8.0, INK, Anchor::Middle);
        }
        let corner = self.at(0.0, self.y_min);
        drawing.path(
            &[
                self.at(0.0, self.y_max),
                corner,
                self.at(self.x_max, self.y_min),
            ],
            1.4,
            INK,
        );
        let at = [self.low[0] - 30.0, self.low[1] - 16.0];
        drawing.text(at, y_name, 9.0, INK, Anchor::Start);
        let middle = (self.low[0] + self.high[0]) / 2.0;
        drawing.text(
            [middle, self.high[1] + 30.0],
            x_name,
            9.0,
            INK,
            Anchor::Middle,
        );
    }
}

fn number(tick: f64) -> String {
    if tick.fract() == 0.0 {
        format!("{tick:.0}")
    } else {
        format!("{tick:.1}")
    }
}

/// Round numbers from 0 to `max`, at most six of them.
fn ticks(max: f64) -> Vec<f64> {
    let step = step_of(max);
    let count = (max / step + 1e-9).floor() as usize;
    (0..=count).map(|i| i as f64 * step).collect()
}

/// 1, 2 or 5 times a power of ten, at least a fifth of `max`.
fn step_of(max: f64) -> f64 {
    let wanted = max / 5.0;
    let power = 10f64.powf(wanted.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .find(|m| m * power >= wanted * 0.999);
    step.unwrap_or(10.0) * power
}

/// An end for an axis: a round number that is not below `value`, at least `least`, at most 100.
pub(super) fn end_of(value: f64, least: f64) -> f64 {
    let value = value.max(least).min(100.0);
    let step = step_of(value);
    ((value / step - 1e-9).ceil() * step).min(100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_and_ticks_are_round() {
        assert_eq!(end_of(43.0, 5.0), 50.0);
        assert_eq!(end_of(0.0, 5.0), 5.0);
        assert_eq!(end_of(99.5, 5.0), 100.0);
        assert_eq!(end_of(7.2, 5.0), 8.0);
        assert_eq!(ticks(100.0), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(ticks(8.0), [0.0, 2.0, 4.0, 6.0, 8.0]);
    }

    #[test]
    fn figures_land_in_the_panel() {
        let axes = Axes {
            low: [10.0, 10.0],
            high: [110.0, 60.0],
            x_max: 100.0,
            y_min: 0.0,
            y_max: 50.0,
        };
        assert_eq!(axes.at(0.0, 0.0), [10.0, 60.0]);
        assert_eq!(axes.at(100.0, 50.0), [110.0, 10.0]);
        assert_eq!(axes.at(50.0, 500.0), [60.0, 10.0]);
        let raised = Axes {
            y_min: 40.0,
            ..axes
        };
        assert_eq!(raised.at(0.0, 45.0), [10.0, 35.0]);
    }
}
