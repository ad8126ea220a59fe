//! Labelled objects, each built from parameterised parts in its own frame: x along the heading, y left, z up, on the ground at z = 0.
//!
//! Sizes follow published statistics of KITTI's labels (mean and deviation per class) and, for cars of `sim-udi`, 4.5 x 1.85 x 1.55 m.
//! Mirrors are outside a label's box, as in KITTI.

mod car;
mod cyclist;
mod forklift;
mod golf_cart;
mod pedestrian;
mod synthetic_unknown;
mod truck;
mod unseen;
mod vehicle;

pub(crate) use cyclist::bicycle;
pub(crate) use unseen::{Habit, street};

use super::mesh::{Mesh, Surface, V3, v};
use super::{Class, Family, random::Dice};

/// The annotated boxes of KITTI's vehicles are loose: their points are 5 to 10 cm further inside than in an exact box. The label of a vehicle of
/// `sim-kitti` is larger than its triangles by this much on each side, m; the labels of `sim-udi` are exact.
const ANNOTATION_MARGIN_M: f32 = 0.05;

/// A built object: triangles and the box that its label states.
#[derive(Clone, Debug)]
pub(crate) struct Model {
    pub(crate) mesh: Mesh,
    pub(crate) low: V3,
    pub(crate) high: V3,
}

impl Model {
    /// The label is the body's extent, down to the ground.
    fn new(mesh: Mesh) -> Model {
        let (low, high) = mesh.bounds();
        let low = v(low.x, low.y, low.z.min(0.0));
        Model { mesh, low, high }
    }

    /// Mirrors (`left` is the left one) are in the mesh but outside the label.
    fn with_mirrors(body: Mesh, left: V3, size: V3, surface: Surface) -> Model {
        let mut model = Model::new(body);
        model.mesh.twins(left, size, surface);
        model
    }

    /// Shrinks the triangles along and across, so that the unchanged label is larger by this much on each side.
    fn stand_off(&mut self, margin_m: f32) {
        let size = self.size_m();
        let scale = (size - 2.0 * v(margin_m, margin_m, 0.0)) / size.max(V3::splat(0.5));
        let middle = (self.low + self.high) / 2.0;
        self.mesh.map(|p| {
            let q = middle + (p - middle) * scale;
            v(q.x, q.y, p.z)
        });
    }

    /// Scales triangles and label about the origin on the ground.
    fn scale(&mut self, by: V3) {
        self.mesh.map(|p| p * by);
        self.low *= by;
        self.high *= by;
    }

    /// l, w, h of the label, m.
    pub(crate) fn size_m(&self) -> V3 {
        self.high - self.low
    }
}

/// Builds one object of a class.
pub(crate) fn build(class: Class, family: Family, dice: &mut Dice) -> Model {
    if class == Class::SyntheticUnknown {
        return synthetic_unknown::synthetic_unknown(family, dice);
    }
    let mut model = exact(class, dice, family);
    if family == Family::SimAny {
        // Sizes differ between continents, and the margin of labels differs between annotators.
        model.scale(dice.size([0.9, 1.12], [0.92, 1.1], [0.93, 1.09]));
        if !matches!(class, Class::Unseen(_)) {
            model.stand_off(dice.range(0.02, 0.07));
        }
    } else if class.is_vehicle() && family == Family::SimKitti {
        model.stand_off(ANNOTATION_MARGIN_M);
    }
    model
}

/// Mean of the published label sizes of the class.
pub(crate) fn mean_size_m(class: Class, family: Family) -> V3 {
    match (class, family) {
        (Class::Car, Family::SimKitti) => v(3.89, 1.62, 1.53),
        (Class::Car, Family::SimUdi) => v(4.5, 1.85, 1.55),
        (Class::Car, Family::SimAny) => v(4.1, 1.71, 1.54),
        (Class::Van, _) => v(5.07, 1.90, 2.21),
        (Class::Truck, _) => v(9.6, 2.6, 3.3),
        (Class::Pedestrian, _) => v(0.82, 0.63, 1.76),
        (Class::Cyclist, _) => v(1.76, 0.6, 1.74),
        (Class::GolfCart, _) => v(2.8, 1.25, 1.88),
        (Class::Forklift, _) => v(3.4, 1.25, 2.2),
        (Class::Unseen(_) | Class::SyntheticUnknown, _) => unreachable!("no mean of its own"),
    }
}

/// The object with the exact extent of its triangles as label.
fn exact(class: Class, dice: &mut Dice, family: Family) -> Model {
    match class {
        Class::Car => car::car(family, dice),
        Class::Van => car::van(dice),
        Class::Truck => truck::truck(dice),
        Class::Pedestrian => pedestrian::pedestrian(family, dice),
        Class::Cyclist => cyclist::cyclist(dice),
        Class::GolfCart => golf_cart::golf_cart(dice),
        Class::Forklift => forklift::forklift(dice),
        Class::Unseen(class) => Model::new(class.row().built(dice)),
        Class::SyntheticUnknown => unreachable!("made of known classes"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::classes;
    use super::*;

    /// Every class, each with this many keys.
    fn drawn(count: u64) -> impl Iterator<Item = (Class, u64)> {
        classes().flat_map(move |class| (0..count).map(move |i| (class, i)))
    }

    #[test]
    fn sizes_meet_the_published_means() {
        use Class::*;
        let kitti = [Car, Van].map(|class| (class, Family::SimKitti));
        let udi = [Car, Truck, Pedestrian, Cyclist, GolfCart, Forklift];
        let udi = udi.map(|class| (class, Family::SimUdi));
        for (class, family) in kitti.into_iter().chain(udi) {
            let size = |i| build(class, family, &mut Dice::new(&[9, i])).size_m();
            let mean = (0..300).map(size).sum::<V3>() / 300.0;
            let expected = mean_size_m(class, family);
            let off = ((mean - expected) / expected).abs().max_element();
            assert!(off < 0.12, "{class:?}: mean {mean}, expected {expected}");
        }
    }

    #[test]
    fn every_object_is_a_lean_mesh_inside_its_label() {
        for (class, i) in drawn(40) {
            let mut dice = Dice::new(&[4, i]);
            let model = build(class, Family::SimUdi, &mut dice);
            let Model { mesh, low, high } = model;
            let triangles = mesh.triangles.len();
            assert!(triangles < 1500, "{class:?} has {triangles} triangles");
            assert!(low.z.abs() < 0.03, "{class:?} stands at {}", low.z);
            let is_inside = |p: &&V3| p.cmpge(low - 1e-3).all() && p.cmple(high + 1e-3).all();
            let inside = mesh.vertices.iter().filter(is_inside).count();
            assert!(inside * 10 >= mesh.vertices.len() * 9);
        }
    }
}
