//! A labelled scan as the trainer sees it.

use mluc_geometry::Box3;

/// Objects with fewer points teach nothing: their place is ignored, neither object nor background.
pub const POINTS_MIN: usize = 3;

/// A labelled object.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Index among the model's classes; `None` for an object of another kind, whose place is ignored.
    pub class: Option<usize>,
    /// In the sensor frame.
    pub bounds: Box3,
    /// Points of the scan inside it.
    pub points: usize,
    /// Made up to stand for the unknown; of no class.
    pub made_up: bool,
}

impl Object {
    /// The class to train it as.
    pub fn trained_class(&self) -> Option<usize> {
        self.class.filter(|_| self.points >= POINTS_MIN)
    }

    /// Whether it is trained on, as a class or as made up.
    pub fn is_trained(&self) -> bool {
        (self.class.is_some() || self.made_up) && self.points >= POINTS_MIN
    }
}

/// A scan and its objects.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// x, y, z (m, sensor frame), intensity.
    pub points: Vec<[f32; 4]>,
    /// Labels.
    pub objects: Vec<Object>,
}

impl Scene {
    /// Counts every object's points.
    pub fn count_points(&mut self) {
        let tests: Vec<InBox> = self.objects.iter().map(|o| InBox::new(&o.bounds)).collect();
        let mut counts = vec![0; tests.len()];
        for point in &self.points {
            for (count, test) in counts.iter_mut().zip(&tests) {
                *count += usize::from(test.contains(point));
            }
        }
        self.objects
            .iter_mut()
            .zip(counts)
            .for_each(|(object, count)| object.points = count);
    }
}

/// A fast test whether a point lies in a box.
#[derive(Clone, Copy, Debug)]
pub struct InBox {
    center: [f32; 3],
    half: [f32; 3],
    radius: f32,
    sin: f32,
    cos: f32,
}

impl InBox {
    /// Of one box.
    pub fn new(bounds: &Box3) -> InBox {
        let half = bounds.size_m.map(|s| s as f32 / 2.0);
        let (sin, cos) = (bounds.yaw_rad as f32).sin_cos();
        InBox {
            center: bounds.center_m.map(|c| c as f32),
            half,
            radius: half[0].hypot(half[1]),
            sin,
            cos,
        }
    }

    /// Inside or on the surface.
    pub fn contains(&self, point: &[f32; 4]) -> bool {
        let (dx, dy) = (point[0] - self.center[0], point[1] - self.center[1]);
        if dx.abs() > self.radius || dy.abs() > self.radius {
            return false;
        }
        let (u, v) = (dx * self.cos + dy * self.sin, dy * self.cos - dx * self.sin);
        u.abs() <= self.half[0]
            && v.abs() <= self.half[1]
            && (point[2] - self.center[2]).abs() <= self.half[2]
    }
}
