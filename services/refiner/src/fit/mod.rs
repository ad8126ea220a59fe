//! A box around a cluster: rectangle seen from above, then height and the parts that the sensor cannot see.

mod closeness;
mod extend;
mod fitter;
mod footprint;

pub use closeness::Closeness;
pub use extend::{CutTop, EndFace, Extend, Side};
pub use fitter::{Fitter, axis_aligned, minimum_area};
pub use footprint::footprint;

use mluc_kernels::at_best;
use serde::{Deserialize, Serialize};

/// How a rectangle is laid around a cluster.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BoxFit {
    /// Sides along x and y.
    AxisAligned,
    /// The rectangle of least area.
    MinimumArea,
    /// The rectangle whose sides the points lie closest to (Zhang et al., 2017).
    #[default]
    Closeness,
}

/// Points of one cluster, in columns: x and y relative to an origin near them, z in the sensor frame, m.
#[derive(Debug)]
pub struct ClusterPoints {
    /// m.
    pub x_m: Vec<f32>,
    /// m.
    pub y_m: Vec<f32>,
    /// m.
    pub z_m: Vec<f32>,
    /// Headings are counted from here, rad from x,
    ahead_rad: f64,
    /// and the same as cosine and sine.
    ahead: [f32; 2],
}

impl Default for ClusterPoints {
    /// No points; headings are counted from x.
    fn default() -> ClusterPoints {
        ClusterPoints {
            x_m: Vec::new(),
            y_m: Vec::new(),
            z_m: Vec::new(),
            ahead_rad: 0.0,
            ahead: [1.0, 0.0],
        }
    }
}

impl ClusterPoints {
    /// Headings are counted from the sensor's line of sight to the points' origin, so that boxes turn with the scene and
    /// nothing else changes.
    pub fn look_at(&mut self, origin_m: [f64; 2]) {
        self.ahead_rad = origin_m[1].atan2(origin_m[0]);
        let (sin, cos) = self.ahead_rad.sin_cos();
        self.ahead = [cos as f32, sin as f32];
    }

    /// No points.
    pub fn clear(&mut self) {
        self.x_m.clear();
        self.y_m.clear();
        self.z_m.clear();
    }

    /// One more.
    pub fn push(&mut self, x_m: f32, y_m: f32, z_m: f32) {
        self.x_m.push(x_m);
        self.y_m.push(y_m);
        self.z_m.push(z_m);
    }

    /// Points.
    pub fn len(&self) -> usize {
        self.x_m.len()
    }

    /// No point.
    pub fn is_empty(&self) -> bool {
        self.x_m.is_empty()
    }

    /// Lowest and highest z, m; `None` without points.
    pub fn z_range_m(&self) -> Option<[f32; 2]> {
        (!self.z_m.is_empty()).then(|| {
            at_best(
                #[inline(always)]
                || ends(&self.z_m),
            )
        })
    }

    /// Lowest and highest coordinate along a direction, m.
    pub fn span_m(&self, direction: [f32; 2]) -> [f32; 2] {
        at_best(
            #[inline(always)]
            || span(&self.x_m, &self.y_m, direction),
        )
    }

    /// Lowest and highest coordinate along a direction and along the one a quarter turn further, m.
    pub fn spans_m(&self, direction: [f32; 2]) -> [[f32; 2]; 2] {
        at_best(
            #[inline(always)]
            || spans(&self.x_m, &self.y_m, direction),
        )
    }

    /// What headings are counted from, rad from x.
    pub(crate) fn ahead_rad(&self) -> f64 {
        self.ahead_rad
    }

    /// Lengths along a direction that is counted from the line of sight, and across it, m.
    pub(crate) fn sides_m(&self, [along, aside]: [f32; 2]) -> [f64; 2] {
        let [cos, sin] = self.ahead;
        let direction = [along * cos - aside * sin, along * sin + aside * cos];
        let length = |[low, high]: [f32; 2]| f64::from(high) - f64::from(low);
        self.spans_m(direction).map(length)
    }

    /// The tight rectangle whose u axis points to `yaw_rad`.
    pub fn rectangle(&self, yaw_rad: f64) -> Rectangle {
        let (sin, cos) = (yaw_rad.sin() as f32, yaw_rad.cos() as f32);
        let [u_m, v_m] = self.spans_m([cos, sin]).map(|span| span.map(f64::from));
        Rectangle { yaw_rad, u_m, v_m }
    }
}

/// A rectangle around the origin of its points: axis u at `yaw_rad` from x, v a quarter turn further.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// rad.
    pub yaw_rad: f64,
    /// From and to, m.
    pub u_m: [f64; 2],
    /// From and to, m.
    pub v_m: [f64; 2],
}

impl Rectangle {
    /// Along u and along v, m.
    pub fn size_m(&self) -> [f64; 2] {
        [self.u_m[1] - self.u_m[0], self.v_m[1] - self.v_m[0]]
    }

    /// With a margin on every side, m.
    pub fn grown(&self, margin_m: f64) -> Rectangle {
        let wider = |[low, high]: [f64; 2]| [low - margin_m, high + margin_m];
        Rectangle {
            yaw_rad: self.yaw_rad,
            u_m: wider(self.u_m),
            v_m: wider(self.v_m),
        }
    }

    /// Centre relative to the points' origin, m.
    pub fn center_m(&self) -> [f64; 2] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let (u, v) = (
            (self.u_m[0] + self.u_m[1]) / 2.0,
            (self.v_m[0] + self.v_m[1]) / 2.0,
        );
        [u * cos - v * sin, u * sin + v * cos]
    }
}

/// Lanes of the loops below: wide enough for the compiler to use vectors.
const LANES: usize = 16;

/// Along a direction and along the one a quarter turn further, as [`span`].
#[inline(always)]
fn spans(x: &[f32], y: &[f32], [cos, sin]: [f32; 2]) -> [[f32; 2]; 2] {
    [span(x, y, [cos, sin]), span(x, y, [-sin, cos])]
}

/// Lowest and highest `x * d[0] + y * d[1]`; infinities without points.
#[inline(always)]
fn span(x: &[f32], y: &[f32], d: [f32; 2]) -> [f32; 2] {
    let mut low = [f32::INFINITY; LANES];
    let mut high = [f32::NEG_INFINITY; LANES];
    let (x_blocks, y_blocks) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
    let rest = x_blocks.remainder().iter().zip(y_blocks.remainder());
    for (x, y) in x_blocks.zip(y_blocks) {
        for lane in 0..LANES {
            let t = x[lane] * d[0] + y[lane] * d[1];
            low[lane] = lower(low[lane], t);
            high[lane] = higher(high[lane], t);
        }
    }
    let rest = rest.map(|(x, y)| x * d[0] + y * d[1]);
    [
        low.into_iter()
            .chain(rest.clone())
            .fold(f32::INFINITY, lower),
        high.into_iter().chain(rest).fold(f32::NEG_INFINITY, higher),
    ]
}

/// Lowest and highest value; infinities without any.
#[inline(always)]
fn ends(values: &[f32]) -> [f32; 2] {
    let mut low = [f32::INFINITY; LANES];
    let mut high = [f32::NEG_INFINITY; LANES];
    let blocks = values.chunks_exact(LANES);
    let rest = blocks.remainder().iter().copied();
    for block in blocks {
        for lane in 0..LANES {
            low[lane] = lower(low[lane], block[lane]);
            high[lane] = higher(high[lane], block[lane]);
        }
    }
    [
        low.into_iter()
            .chain(rest.clone())
            .fold(f32::INFINITY, lower),
        high.into_iter().chain(rest).fold(f32::NEG_INFINITY, higher),
    ]
}

// Comparisons and not `min` and `max`, which take care of NaN and cost more.
#[inline(always)]
pub(crate) fn lower(least: f32, t: f32) -> f32 {
    if t < least { t } else { least }
}

#[inline(always)]
pub(crate) fn higher(most: f32, t: f32) -> f32 {
    if t > most { t } else { most }
}
