//! Corrects points for the sensor's motion during a turn, as if the sensor had stayed where it was at one time.

use nalgebra::{IsometryMatrix3, Point3};

/// Steps per turn. At 10 Hz and 40 m/s, one step is 4 mm.
const STEPS: usize = 1000;

/// A sensor's motion over one turn: constant velocity, constant turn rate.
pub struct Deskew {
    /// Pose of the sensor at each step, in the frame that points are moved to.
    frame_from_sensor: Vec<IsometryMatrix3<f32>>,
    first_s: f64,
    steps_per_s: f64,
}

impl Deskew {
    /// `times_s`: times of two points, usually the first and the last, relative to the time whose frame points are moved to. `poses`: poses of the
    /// sensor at these times in a fixed frame. `None`: the times do not ascend, or the poses differ by half a turn.
    pub fn new(times_s: [f64; 2], poses: [IsometryMatrix3<f64>; 2]) -> Option<Deskew> {
        let [first_s, last_s] = times_s;
        let span_s = last_s - first_s;
        let pose = |share| poses[0].try_lerp_slerp(&poses[1], share, 1e-9);
        let frame_from_fixed = pose(-first_s / span_s)?.inverse();
        let steps = (0..=STEPS).map(|step| {
            let sensor = pose(step as f64 / STEPS as f64)?;
            Some((frame_from_fixed * sensor).cast())
        });
        (span_s > 0.0).then_some(Deskew {
            frame_from_sensor: steps.collect::<Option<_>>()?,
            first_s,
            steps_per_s: STEPS as f64 / span_s,
        })
    }

    /// Moves a point (m) that the sensor saw at a time (s) into the frame. Times before the first or after the last are clamped to these.
    pub fn moved(&self, time_s: f64, point_m: [f32; 3]) -> [f32; 3] {
        let step = ((time_s - self.first_s) * self.steps_per_s + 0.5) as usize;
        (self.frame_from_sensor[step.min(STEPS)] * Point3::from(point_m)).into()
    }
}
