//! Synthetic unknown objects, made of known objects before the scan: they use no unknown class.
//!
//! A known object is scaled axis by axis, or the rear (the lower part) of one is joined to the front (the upper part) of another. A slab may be
//! cut out, like windows and open sides. Objects that still have the size of a known class are rejected. Rays are cast at it as at any other object, so it
//! hides objects behind it and its points are where a sensor's would be. Moved points (`train::synthetic_unknown`) do not have these properties.
//! Extension of the paper; after the resizing of Koesel et al. (IV 2024) and Cen et al. (ECCV 2022).

use super::super::mesh::{Mesh, V3};
use super::super::random::Dice;
use super::{ANNOTATION_MARGIN_M, Class, Family, Model, exact, mean_size_m};
use crate::synthetic_unknown::{
    ALIKE_CHANCE, ANYWHERE, CUT_CHANCE, CUT_LOW, CUT_SHARE, JOIN_CHANCE, LARGE_BEND, LARGE_CHANCE,
    LARGE_M, LIES_CHANCE, ON_ROADS, Scaling, has_known_size, has_road_size,
};

/// Share of a car's height below which the shape stays.
const UNDERSIDE: f32 = 0.15;
/// Maximum number of draws for one object; the last draw is always accepted.
const DRAWS: usize = 64;

/// Builds one object. In `sim-kitti` its label has a margin where a vehicle is part of it, as the labels of vehicles do. Elsewhere its label is exact,
/// although in `sim-any` the labels of known objects have margins of 2 to 7 cm.
pub(super) fn synthetic_unknown(family: Family, dice: &mut Dice) -> Model {
    let (mut model, mut has_vehicle) = attempt(family, dice);
    for _ in 1..DRAWS {
        if is_new(&model, family) {
            break;
        }
        (model, has_vehicle) = attempt(family, dice);
    }
    if has_vehicle && family == Family::SimKitti {
        model.stand_off(ANNOTATION_MARGIN_M);
    }
    model
}

/// Whether it has the size of an object on a road, but not the size of a known class.
fn is_new(model: &Model, family: Family) -> bool {
    let size = |size_m: V3| size_m.to_array().map(f64::from);
    let classes = family.known_classes().iter();
    let classes_m: Vec<[f64; 3]> = classes.map(|c| size(mean_size_m(*c, family))).collect();
    let size_m = size(model.size_m());
    has_road_size(size_m, scaling(family)) && !has_known_size(size_m, &classes_m)
}

fn scaling(family: Family) -> &'static Scaling {
    match family {
        Family::SimAny => &ANYWHERE,
        _ => &ON_ROADS,
    }
}

/// A model, and whether a vehicle is part of it.
fn attempt(family: Family, dice: &mut Dice) -> (Model, bool) {
    let is_any = family == Family::SimAny;
    let has_trucks = family.known_classes().contains(&Class::Truck);
    let is_large = !has_trucks && dice.chance(LARGE_CHANCE);
    let first = if is_large { Class::Car } else { known_class(family, dice) };
    let mut mesh = body(first, family, dice);
    let mut has_vehicle = first.is_vehicle();
    if is_any && !is_large && dice.chance(LIES_CHANCE) {
        mesh.map(|p| V3::new(p.z, p.y, -p.x));
    }
    let alike = (is_any && dice.chance(ALIKE_CHANCE)).then(|| dice.unit());
    let mut factors = scaling(family).factors.map(|[low, high]| {
        let [low, high] = [low, high].map(|factor| factor.ln() as f32);
        alike.map_or_else(|| dice.range(low, high), |share| low + (high - low) * share)
    });
    factors = factors.map(f32::exp);
    if !is_large && dice.chance(JOIN_CHANCE as f32) {
        let second = known_class(family, dice);
        has_vehicle |= second.is_vehicle();
        mesh = join(mesh, body(second, family, dice), dice.chance(0.5));
        // A join is already new: it is scaled less.
        factors = factors.map(f32::sqrt);
    }
    if is_large {
        enlarge(&mut mesh, dice);
    } else {
        mesh.map(|p| p * V3::from(factors));
    }
    if dice.chance(CUT_CHANCE as f32) {
        cut(&mut mesh, dice);
    }
    mesh.put_down();
    (Model::new(mesh), has_vehicle)
}

/// Stretches a car to the size of a van, truck or bus, and raises its bonnet towards the roof.
fn enlarge(mesh: &mut Mesh, dice: &mut Dice) {
    let size_m = LARGE_M.map(|[low, high]| low * (high / low).powf(dice.unit()));
    let bend = dice.range(LARGE_BEND[0], LARGE_BEND[1]);
    let (low, extent) = (mesh.bounds().0, extent(mesh));
    mesh.map(|p| {
        let share = (p - low) / extent;
        let above = ((1.0 - share.z) / (1.0 - UNDERSIDE)).max(0.0);
        let bent = 1.0 - (1.0 - UNDERSIDE) * above.powf(bend);
        let height = if above < 1.0 { bent } else { share.z };
        V3::new(share.x - 0.5, share.y - 0.5, height) * V3::from(size_m)
    });
}

/// l, w, h of the mesh, m.
fn extent(mesh: &Mesh) -> V3 {
    let (low, high) = mesh.bounds();
    (high - low).max(V3::splat(1e-3))
}

/// The part of a known object that its label encloses: without mirrors.
fn body(class: Class, family: Family, dice: &mut Dice) -> Mesh {
    let mut model = exact(class, dice, family);
    let (low, high) = (model.low - 1e-3, model.high + 1e-3);
    let is_within = |p: V3| p.cmpge(low).all() && p.cmple(high).all();
    model.mesh.keep(is_within);
    model.mesh
}

/// Vehicles and people with equal chance, although most known classes are people.
fn known_class(family: Family, dice: &mut Dice) -> Class {
    let wants_vehicle = dice.chance(0.5);
    let mut known = family.known_classes().to_vec();
    known.retain(|class| class.is_vehicle() == wants_vehicle);
    known[dice.whole(0, known.len() - 1)]
}

/// Joins the part of `rear` behind its middle (below it, if `stacked`) with the part of `front` before (above) its own middle. `front` is scaled to
/// the same width and height (width and length, if `stacked`) first.
fn join(mut rear: Mesh, mut front: Mesh, stacked: bool) -> Mesh {
    let axis = if stacked { V3::Z } else { V3::X };
    let fit = extent(&rear) / extent(&front);
    front.map(|p| V3::select(axis.cmpeq(V3::ZERO), p * fit, p));
    let middle = |mesh: &Mesh| {
        let (low, high) = mesh.bounds();
        ((low + high) / 2.0).dot(axis)
    };
    let (low, high) = (middle(&rear), middle(&front));
    rear.keep(|p| p.dot(axis) < low);
    front.keep(|p| p.dot(axis) >= high);
    rear.add(&front, |p| p + axis * (low - high));
    rear
}

/// Removes the triangles whose middle is in a horizontal slab.
fn cut(mesh: &mut Mesh, dice: &mut Dice) {
    let (bottom, top) = mesh.bounds();
    let share = dice.range(CUT_SHARE[0] as f32, CUT_SHARE[1] as f32);
    let from = dice.range(CUT_LOW as f32, 0.9 - share);
    let at = |share: f32| bottom.z + share * (top.z - bottom.z);
    mesh.keep(|p| p.z < at(from) || p.z > at(from + share));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_stand_on_the_ground_have_no_known_size_and_differ() {
        for family in Family::ALL {
            let mut lengths = vec![];
            for i in 0..200 {
                let model = synthetic_unknown(family, &mut Dice::new(&[11, i]));
                assert!(is_new(&model, family), "{}", model.size_m());
                assert!(model.low.z.abs() < 1e-3 && !model.mesh.triangles.is_empty());
                let (low, high) = (model.low - 1e-2, model.high + 1e-2);
                let used = model.mesh.triangles.iter().flatten();
                let mut used = used.map(|i| model.mesh.vertices[*i as usize]);
                assert!(used.all(|p| p.cmpge(low).all() && p.cmple(high).all()));
                lengths.push(model.size_m().x);
            }
            let most = lengths.iter().copied().fold(0.0, f32::max);
            let least = lengths.iter().copied().fold(f32::MAX, f32::min);
            assert!(least < 0.7 && most > 6.0, "lengths {least} to {most} m");
        }
    }

    #[test]
    fn a_body_has_the_size_of_its_label() {
        for family in Family::ALL {
            for class in family.known_classes() {
                for i in 0..20 {
                    let dice = || Dice::new(&[6, i]);
                    let label = exact(*class, &mut dice(), family).size_m();
                    let (low, high) = body(*class, family, &mut dice()).bounds();
                    let off = (high - low - label).abs().max_element();
                    assert!(off < 0.05, "{class:?}: {} for {label}", high - low);
                }
            }
        }
    }

    #[test]
    fn labels_stand_off_where_a_vehicle_is_part_of_it_and_sizes_are_real() {
        let gap = |i: u64| {
            let model = synthetic_unknown(Family::SimKitti, &mut Dice::new(&[12, i]));
            let (low, high) = model.mesh.bounds();
            (model.size_m() - (high - low)).x / 2.0
        };
        let full: Vec<f32> = (0..40).map(gap).collect();
        let near = |gap: f32, off: f32| full.iter().filter(|g| (**g - gap).abs() < off).count();
        let (stand_off, exact) = (near(ANNOTATION_MARGIN_M, 1e-2), near(0.0, 1e-3));
        assert!(stand_off > 10 && exact > 5, "{full:?}");
        assert_eq!(stand_off + exact, 40, "{full:?}");
    }

    #[test]
    fn a_join_has_the_rear_of_one_and_the_front_of_the_other() {
        let dice = || Dice::new(&[5, 5]);
        let car = exact(Class::Car, &mut dice(), Family::SimKitti).mesh;
        let person = exact(Class::Pedestrian, &mut dice(), Family::SimKitti).mesh;
        let joined = join(car.clone(), person.clone(), false);
        assert!(joined.triangles.len() < car.triangles.len() + person.triangles.len());
        assert!(joined.triangles.len() > car.triangles.len() / 4);
        let length = |mesh: &Mesh| mesh.bounds().1.x - mesh.bounds().0.x;
        assert!(length(&joined) < length(&car) && length(&joined) > length(&person));
    }
}
