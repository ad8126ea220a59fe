//! Anchors and the residual box code (paper section 3.1; the coder of SECOND).
//!
//! With d = sqrt(la^2 + wa^2), a box (x, y, z, l, w, h, yaw) against its anchor (a): t = ((x - xa) / d, (y - ya) / d, (z - za) / ha, ln(l / la), ln(w / wa),
//! ln(h / ha), yaw - yaw_a). The code does not distinguish front from rear; a direction bin does.

use mluc_geometry::{Box3, limit_period};
use mluc_model::Manifest;
use std::f64::consts::PI;

/// Number of values of a box code.
pub const BOX_CODES: usize = 7;
/// Yaws of the two anchors of a class, rad.
pub const ANCHOR_YAWS_RAD: [f64; 2] = [0.0, 1.57];
/// Boundary of the direction bins, rad (the other is half a turn further), so that the common yaws 0 and pi / 2 lie within a bin.
pub const DIRECTION_OFFSET_RAD: f64 = std::f64::consts::FRAC_PI_4;
/// Maximum logarithm of a size ratio: a size is at most e^3 (20) times its anchor's size, and at least 1/20. Beyond, sizes could overflow.
const LOG_SIZE_MAX: f64 = 3.0;
/// Codes beyond this give no box, so that coordinates stay within f32.
const CODE_MAX: f32 = 1e4;

/// The anchors of a model: at every cell two yaws for each class, then for each class-agnostic size, in (class, yaw) order.
#[derive(Clone, Debug, PartialEq)]
pub struct Anchors {
    columns: usize,
    /// Lower corner of the range in x and y, m.
    pub origin_m: [f64; 2],
    /// Step between anchors in x and y, m. Anchors lie on both ends of the range, so a step is a little more than a cell.
    pub step_m: [f64; 2],
    /// l, w, h and z of the centre by class, m.
    classes: Vec<([f64; 3], f64)>,
}

impl Anchors {
    /// The anchors of a checked manifest.
    pub fn new(manifest: &Manifest) -> Anchors {
        let grid = &manifest.network.grid;
        let [rows, columns] = manifest.network.map_shape();
        let low = [0, 1].map(|i| f64::from(grid.range_min_m[i]));
        let high = [0, 1].map(|i| f64::from(grid.range_max_m[i]));
        let steps = [columns, rows].map(|cells| (cells.max(2) - 1) as f64);
        let class = |class: &mluc_model::AnchorClass| {
            let size = class.size_m.map(f64::from);
            (size, f64::from(class.bottom_z_m) + size[2] / 2.0)
        };
        let classes = manifest.classes.iter().chain(&manifest.generic);
        Anchors {
            columns,
            origin_m: low,
            step_m: [0, 1].map(|i| (high[i] - low[i]) / steps[i]),
            classes: classes.map(class).collect(),
        }
    }

    /// Number of anchors per cell.
    pub fn per_cell(&self) -> usize {
        self.classes.len() * ANCHOR_YAWS_RAD.len()
    }

    /// The class of an anchor of a cell; numbers beyond the classes are class-agnostic sizes.
    pub fn class(anchor: usize) -> usize {
        anchor / ANCHOR_YAWS_RAD.len()
    }

    /// The `anchor`-th anchor of cell `cell` (row * columns + column).
    pub fn anchor(&self, cell: usize, anchor: usize) -> Box3 {
        let ([l, w, h], z) = self.classes[Anchors::class(anchor)];
        let at = [cell % self.columns, cell / self.columns];
        let [x, y] = [0, 1].map(|i| self.origin_m[i] + at[i] as f64 * self.step_m[i]);
        let yaw_rad = ANCHOR_YAWS_RAD[anchor % ANCHOR_YAWS_RAD.len()];
        Box3::new([x, y, z, l, w, h, yaw_rad])
    }
}

/// The code of a box relative to an anchor.
pub fn encode(found: &Box3, anchor: &Box3) -> [f64; BOX_CODES] {
    let [la, wa, ha] = anchor.size_m;
    let [x, y, z] = [0, 1, 2].map(|i| found.center_m[i] - anchor.center_m[i]);
    let diagonal = la.hypot(wa);
    let [l, w, h] = [0, 1, 2].map(|i| (found.size_m[i] / anchor.size_m[i]).ln());
    let yaw = found.yaw_rad - anchor.yaw_rad;
    [x / diagonal, y / diagonal, z / ha, l, w, h, yaw]
}

/// The box of a code; its yaw is still ambiguous by half a turn. `None` if a code value is NaN or too large.
pub fn decode(code: &[f32], anchor: &Box3) -> Option<Box3> {
    let code: [f32; BOX_CODES] = code.try_into().ok()?;
    // False for NaN.
    if !code.iter().all(|value| value.abs() <= CODE_MAX) {
        return None;
    }
    let [tx, ty, tz, tl, tw, th, tyaw] = code.map(f64::from);
    let [la, wa, ha] = anchor.size_m;
    let diagonal = la.hypot(wa);
    let scale = |log: f64| log.clamp(-LOG_SIZE_MAX, LOG_SIZE_MAX).exp();
    let [x, y, z] = anchor.center_m;
    Some(Box3 {
        center_m: [x + tx * diagonal, y + ty * diagonal, z + tz * ha],
        size_m: [la * scale(tl), wa * scale(tw), ha * scale(th)],
        yaw_rad: anchor.yaw_rad + tyaw,
    })
}

/// The direction bin of a yaw.
pub fn direction_bin(yaw_rad: f64) -> usize {
    ((limit_period(yaw_rad - DIRECTION_OFFSET_RAD, 0.0, 2.0 * PI) / PI) as usize).min(1)
}

/// `yaw_rad`, or the yaw half a turn further, whichever lies in `bin`; in [-pi, pi).
pub fn direct(yaw_rad: f64, bin: usize) -> f64 {
    let half = limit_period(yaw_rad - DIRECTION_OFFSET_RAD, 0.0, PI) + DIRECTION_OFFSET_RAD;
    limit_period(half + PI * bin as f64, 0.5, 2.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::{Grid, Network};

    #[test]
    fn a_box_comes_back_from_its_code() {
        let anchor = Box3::new([10.0, -5.0, -1.0, 3.9, 1.6, 1.56, 1.57]);
        for found in
            [[11.0, -4.5, -0.8, 4.6, 1.8, 1.4, 2.9], [9.0, -6.0, -1.2, 0.8, 0.6, 1.7, -3.0]]
        {
            let code = encode(&Box3::new(found), &anchor).map(|value| value as f32);
            let back = decode(&code, &anchor).expect("a finite code");
            let values = [&back.center_m[..], &back.size_m, &[back.yaw_rad]].concat();
            let mut pairs = values.iter().zip(found);
            assert!(pairs.all(|(a, b)| (a - b).abs() < 1e-5), "{values:?}");
        }
    }

    #[test]
    fn the_direction_bin_brings_any_yaw_back_around_the_turn() {
        for degree in -180..180 {
            let yaw = f64::from(degree).to_radians() + 1e-3;
            let bin = direction_bin(yaw);
            for reading in [yaw, yaw + PI, yaw - PI, yaw + 2.0 * PI] {
                let error = direct(reading, bin) - yaw;
                assert!(error.abs() < 1e-9, "{degree} degrees");
            }
        }
    }

    #[test]
    fn codes_that_are_no_numbers_give_no_box_and_huge_ones_a_bounded_box() {
        let anchor = Box3::new([0.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]);
        let mut code = [0.0; 7];
        code[3] = f32::NAN;
        assert_eq!(decode(&code, &anchor), None);
        code[3] = 1000.0;
        assert!(decode(&code, &anchor).expect("a box").size_m[0] < 81.0);
        assert_eq!(decode(&[0.0; 6], &anchor), None);
    }

    #[test]
    fn anchors_lie_on_both_ends_of_the_range_and_stand_on_their_bottoms() {
        let manifest = Manifest::untrained("kitti", Network::second(Grid::kitti_second(), 3));
        let anchors = Anchors::new(&manifest);
        assert_eq!(anchors.per_cell() * 200 * 176, 211_200);
        let last = anchors.anchor(200 * 176 - 1, 5);
        assert!((last.center_m[0] - 70.4).abs() < 1e-4 && (last.center_m[1] - 40.0).abs() < 1e-4);
        assert_eq!((last.yaw_rad, last.size_m[0]), (1.57, f64::from(1.76_f32)));
        let first = anchors.anchor(0, 0);
        assert!((first.center_m[2] - (-1.73 + 0.78)).abs() < 1e-6);
        assert_eq!((first.center_m[0], first.center_m[1]), (0.0, -40.0));
    }
}
