//! Points of a sensor that moved while it turned, as if it had stood where it was at one time.

use nalgebra::{IsometryMatrix3, Point3};

/// Poses of a turn: 10 Hz and 40 m/s are 4 mm from one to the next.
const STEPS: usize = 1000;

/// A sensor's motion over one turn: constant velocity, constant rate of turning.
pub struct Deskew {
    /// The sensor at each step, in the frame that points are moved to.
    frame_from_sensor: Vec<IsometryMatrix3<f32>>,
    first_s: f64,
    steps_per_s: f64,
}

impl Deskew {
    /// `times_s`: of two points, the first and the last as a rule, counted from the time in whose frame points are wanted. `poses`: the sensor's at these times, in a
    /// frame that stands still. `None`: the times do not ascend, or half a turn lies between the poses.
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

    /// A point (m) that the sensor saw at a time (s), where it is in the frame. Times beyond the first and the last count as these.
    pub fn moved(&self, time_s: f64, point_m: [f32; 3]) -> [f32; 3] {
        let step = ((time_s - self.first_s) * self.steps_per_s + 0.5) as usize;
        (self.frame_from_sensor[step.min(STEPS)] * Point3::from(point_m)).into()
    }
}
