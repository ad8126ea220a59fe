//! A labelled scan in the trainer's form.

use mluc_backbone::NEAREST_SQUARED;
use mluc_geometry::{Box3, ground::GroundGrid, ground::ground_height_m};

/// Height of the ground below the sensor where a scan gives no estimate, m.
const GROUND_BELOW_M: f64 = 1.7;
/// Minimum number of points of a trained object: with fewer its place is ignored, neither object nor background.
pub const POINTS_MIN: usize = 3;
/// A synthetic unknown object whose length, width and height all differ by less than this from a known class' mean could be of that class, m:
/// people and their labels differ by as much.
const ALIKE_M: f64 = 0.4;

/// A labelled object.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelledObject {
    /// Index among the model's classes; `None` for an object of another kind, whose place is ignored.
    pub class: Option<usize>,
    /// Box in the sensor frame.
    pub bounds: Box3,
    /// Number of scan points inside it.
    pub points: usize,
    /// Whether it is a synthetic object that represents the unknown; it then has no class.
    pub synthetic_unknown: bool,
}

impl LabelledObject {
    /// An object of a class, or a synthetic unknown object.
    pub fn new(class: Option<usize>, bounds: Box3, points: usize) -> LabelledObject {
        LabelledObject { class, bounds, points, synthetic_unknown: class.is_none() }
    }

    /// Whether it has enough points to be trained on.
    fn is_seen(&self) -> bool {
        self.points >= POINTS_MIN
    }

    /// The class as which it is trained.
    pub fn trained_class(&self) -> Option<usize> {
        self.class.filter(|_| self.is_seen())
    }

    /// Whether it is trained on, as a class or as synthetic unknown.
    pub fn is_trained(&self) -> bool {
        (self.class.is_some() || self.synthetic_unknown) && self.is_seen()
    }
}

/// A scan and its objects.
#[derive(Clone, Debug, Default)]
pub struct LabelledScan {
    /// Points: x, y, z (m, sensor frame), intensity.
    pub points: Vec<[f32; 4]>,
    /// Labels.
    pub objects: Vec<LabelledObject>,
}

impl LabelledScan {
    /// Replaces z by the height above the local ground, in points and boxes.
    pub fn measure_from_ground(&mut self) {
        // Missing returns, as the backbone leaves them out.
        self.points.retain(|[x, y, z, _]| x * x + y * y + z * z >= NEAREST_SQUARED);
        let mut grid = GroundGrid::new(GROUND_BELOW_M);
        let ground_m = grid.find(&self.points);
        for [x, y, z, _] in &mut self.points {
            *z -= ground_height_m(ground_m, [*x, *y]);
        }
        for object in &mut self.objects {
            let [x, y, z] = &mut object.bounds.center_m;
            *z -= f64::from(ground_height_m(ground_m, [*x as f32, *y as f32]));
        }
    }

    /// Ignores each synthetic unknown object that could be a known object by its size. `classes_m`: mean l, w, h of the known classes.
    pub fn ignore_alike(&mut self, classes_m: &[[f64; 3]]) {
        let objects = self.objects.iter_mut();
        for object in objects.filter(|object| object.synthetic_unknown) {
            let sides = object.bounds.size_m;
            let near = |class: &[f64; 3]| (0..3).all(|i| (sides[i] - class[i]).abs() < ALIKE_M);
            object.synthetic_unknown = !classes_m.iter().any(near);
        }
    }

    /// Counts every object's points.
    pub fn count_points(&mut self) {
        for object in &mut self.objects {
            object.points = object.bounds.count_inside(&self.points);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_synthetic_unknown_object_of_a_known_size_is_ignored() {
        let pedestrian_m = [0.84, 0.65, 1.78];
        let cases = [([1.2, 0.9, 1.5], false), ([0.5, 0.5, 1.2], true), ([1.3, 0.6, 1.8], true)];
        for (size_m, unknown) in cases {
            let [l, w, h] = size_m;
            let bounds = Box3::new([5.0, 0.0, 1.0, l, w, h, 0.0]);
            let objects = [None, Some(0)].map(|class| LabelledObject::new(class, bounds, 9));
            let mut scan = LabelledScan { points: vec![], objects: objects.to_vec() };
            scan.ignore_alike(&[pedestrian_m]);
            let trained = scan.objects.iter().map(LabelledObject::is_trained);
            assert_eq!(trained.collect::<Vec<_>>(), [unknown, true], "{size_m:?}");
        }
    }
    use mluc_geometry::quantile;
    use mluc_simulate::{Family, Split, frame};

    #[test]
    fn objects_stand_on_the_ground_whatever_the_sensor_and_its_mount() {
        let mut bottoms_m: Vec<f64> = vec![];
        for index in 0..48 {
            let simulated = frame(Family::SimAny, Split::Train, 3, index, None).expect("a frame");
            let objects = simulated.objects.iter();
            let objects = objects.map(|o| LabelledObject::new(Some(0), o.box_in_sensor, 0));
            let mut scan = LabelledScan { points: simulated.points, objects: objects.collect() };
            scan.measure_from_ground();
            let bottom = |o: &LabelledObject| o.bounds.center_m[2] - o.bounds.size_m[2] / 2.0;
            bottoms_m.extend(scan.objects.iter().map(bottom));
        }
        bottoms_m.sort_by(f64::total_cmp);
        let at = |share| quantile(&bottoms_m, share).expect("objects");
        let found = [0.05, 0.1, 0.9, 0.95].map(at);
        assert!(found[1] > -0.2 && found[2] < 0.2, "{found:?}");
    }
}
