//! Labelled objects, each built from parameterised parts in its own frame: x along the heading, y left, z up, on the ground at z = 0.
//!
//! Sizes follow what is published about KITTI's labels (mean and deviation a class) and, for cars of `sim-udi`, 4.5 x 1.85 x 1.55 m.
//! Mirrors stay outside of a label's box, as in KITTI.

mod car;
mod cyclist;
mod forklift;
mod golf_cart;
mod pedestrian;
mod truck;
mod vehicle;

pub(crate) use cyclist::bicycle;

use super::mesh::{Mesh, V3, v};
use super::random::Dice;
use super::{Class, Family};

/// The boxes that people drew around KITTI's vehicles stand off: their points lie 5 to 10 cm further inside than an exact extent would have them. The label of
/// a vehicle of `sim-kitti` is larger than its triangles by this much on each side, m; those of `sim-udi` are exact.
const ANNOTATION_MARGIN_M: f32 = 0.05;

/// A built object: triangles and the box that its label states.
#[derive(Clone, Debug)]
pub(crate) struct Model {
    pub(crate) mesh: Mesh,
    pub(crate) low: V3,
    pub(crate) high: V3,
}

impl Model {
    /// The label is the body's extent; `extras` (mirrors) are seen but not labelled.
    fn new(body: Mesh, extras: &Mesh) -> Model {
        let (low, high) = body.bounds();
        let mut mesh = body;
        mesh.add(extras, |p| p);
        Model {
            mesh,
            low: low.min(v(low.x, low.y, 0.0)),
            high,
        }
    }

    /// Shrinks the triangles along and across, so that the label, left as it is, stands off by this much on each side.
    fn stand_off(&mut self, margin_m: f32) {
        let size = self.size_m();
        let scale = (size - 2.0 * v(margin_m, margin_m, 0.0)) / size.max(v(0.5, 0.5, 0.5));
        let middle = (self.low + self.high) / 2.0;
        self.mesh.map(|p| {
            let q = middle + (p - middle) * scale;
            v(q.x, q.y, p.z)
        });
    }

    /// l, w, h of the label, m.
    pub(crate) fn size_m(&self) -> V3 {
        self.high - self.low
    }
}

/// Builds one object of a class.
pub(crate) fn build(class: Class, family: Family, dice: &mut Dice) -> Model {
    let mut model = exact(class, dice, family);
    let vehicle = matches!(class, Class::Car | Class::Van | Class::Truck);
    if vehicle && family == Family::SimKitti {
        model.stand_off(ANNOTATION_MARGIN_M);
    }
    model
}

/// The object with the exact extent of its triangles as label.
fn exact(class: Class, dice: &mut Dice, family: Family) -> Model {
    match class {
        Class::Car => car::car(family, dice),
        Class::Van => car::van(dice),
        Class::Truck => truck::truck(dice),
        Class::Pedestrian => pedestrian::pedestrian(dice),
        Class::Cyclist => cyclist::cyclist(dice),
        Class::GolfCart => golf_cart::golf_cart(dice),
        Class::Forklift => forklift::forklift(dice),
    }
}

/// Scales a body to exactly these extents, its lowest point on the ground and its middle over the origin.
fn fit(mesh: &mut Mesh, size_m: V3) {
    let (low, high) = mesh.bounds();
    let scale = size_m / (high - low).max(v(1e-3, 1e-3, 1e-3));
    let middle = (low + high) / 2.0;
    mesh.map(|p| {
        let q = (p - v(middle.x, middle.y, low.z)) * scale;
        v(q.x, q.y, q.z)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_size(class: Class, family: Family) -> V3 {
        let count = 300;
        let sum = (0..count).fold(V3::ZERO, |sum, i| {
            sum + build(class, family, &mut Dice::new(&[9, i])).size_m()
        });
        sum / count as f32
    }

    #[test]
    fn sizes_meet_the_published_means() {
        let cases = [
            (Class::Car, Family::SimKitti, v(3.89, 1.62, 1.53)),
            (Class::Car, Family::SimUdi, v(4.5, 1.85, 1.55)),
            (Class::Van, Family::SimKitti, v(5.07, 1.90, 2.21)),
            (Class::Truck, Family::SimUdi, v(9.6, 2.6, 3.3)),
            (Class::Pedestrian, Family::SimUdi, v(0.82, 0.63, 1.76)),
            (Class::Cyclist, Family::SimUdi, v(1.76, 0.6, 1.74)),
            (Class::GolfCart, Family::SimUdi, v(2.8, 1.25, 1.88)),
            (Class::Forklift, Family::SimUdi, v(3.4, 1.25, 2.2)),
        ];
        for (class, family, expected) in cases {
            let mean = mean_size(class, family);
            let relative = ((mean - expected) / expected).abs();
            assert!(
                relative.max_element() < 0.12,
                "{class:?}: mean {mean}, expected {expected}"
            );
        }
    }

    #[test]
    fn every_object_is_a_lean_mesh_inside_its_label() {
        for class in Class::ALL {
            for i in 0..40 {
                let model = build(class, Family::SimUdi, &mut Dice::new(&[4, i]));
                assert!(
                    model.mesh.triangles.len() < 1500,
                    "{class:?} has {} triangles",
                    model.mesh.triangles.len()
                );
                assert!(
                    model.low.z.abs() < 0.03,
                    "{class:?} stands at {}",
                    model.low.z
                );
                let inside = model.mesh.vertices.iter().filter(|p| {
                    p.cmpge(model.low - 1e-3).all() && p.cmple(model.high + 1e-3).all()
                });
                assert!(inside.count() * 10 >= model.mesh.vertices.len() * 9);
            }
        }
    }
}
