//! Objects that stand for the unknown, made of known ones before they are scanned: no unknown class is in them.
//!
//! A known object is scaled axis by axis, or the rear (the lower part) of one meets the front (the upper part) of another, and a slab may be cut out, as
//! windows and open sides are. What still has the size of a known class is thrown away. Since rays are cast at it like at anything else, it hides what stands
//! behind it and its points lie where a sensor's would, which points that are moved about (`train::made_up`) cannot have.
//! Extension of the paper; after the resizing of Koesel et al. (IV 2024) and Cen et al. (ECCV 2022).

use super::super::mesh::{Mesh, V3, v};
use super::super::random::Dice;
use super::{ANNOTATION_MARGIN_M, Class, Family, Model, exact, mean_size_m};
use crate::made_up::{
    CUT_CHANCE, CUT_LOW, CUT_SHARE, FACTORS, JOIN_CHANCE, has_known_size, has_road_size,
};

/// Draws for one object; the last is taken as it comes.
const DRAWS: usize = 64;

/// Builds one.
pub(super) fn made_up(family: Family, dice: &mut Dice) -> Model {
    let known = family.known_classes();
    let classes_m: Vec<[f64; 3]> = known
        .iter()
        .map(|class| size_of(mean_size_m(*class, family)))
        .collect();
    let mut model = attempt(family, dice);
    for _ in 1..DRAWS {
        let size_m = size_of(model.size_m());
        if has_road_size(size_m) && !has_known_size(size_m, &classes_m) {
            break;
        }
        model = attempt(family, dice);
    }
    if family == Family::SimKitti {
        model.stand_off(ANNOTATION_MARGIN_M);
    }
    model
}

fn size_of(size_m: V3) -> [f64; 3] {
    [size_m.x, size_m.y, size_m.z].map(f64::from)
}

fn attempt(family: Family, dice: &mut Dice) -> Model {
    let draw = |dice: &mut Dice| exact(known_class(family, dice), dice, family).mesh;
    let mut mesh = draw(dice);
    let factors = FACTORS.map(|[low, high]| dice.range(low.ln() as f32, high.ln() as f32));
    let mut factors = V3::from(factors.map(f32::exp));
    if dice.chance(JOIN_CHANCE as f32) {
        mesh = join(mesh, draw(dice), dice.chance(0.5));
        // A join is new by itself: scale it less.
        factors = V3::from([factors.x, factors.y, factors.z].map(f32::sqrt));
    }
    mesh.map(|p| p * factors);
    if dice.chance(CUT_CHANCE as f32) {
        cut(&mut mesh, dice);
    }
    let (low, _) = mesh.bounds();
    mesh.map(|p| v(p.x, p.y, p.z - low.z));
    Model::new(mesh, &Mesh::default())
}

/// Vehicles and people alike, though most known classes are people.
fn known_class(family: Family, dice: &mut Dice) -> Class {
    let is_vehicle = dice.chance(0.5);
    let is_wanted = |c: &&Class| matches!(c, Class::Car | Class::Truck) == is_vehicle;
    let known: Vec<&Class> = family.known_classes().iter().filter(is_wanted).collect();
    *known[dice.whole(0, known.len() - 1)]
}

/// The part of `rear` behind its middle (below it, if `stacked`), and of `front`, brought to the same width and length (width
/// and height), the part before (above) its own.
fn join(mut rear: Mesh, mut front: Mesh, stacked: bool) -> Mesh {
    let size = |mesh: &Mesh| {
        let (low, high) = mesh.bounds();
        (high - low).max(V3::splat(1e-3))
    };
    let fit = size(&rear) / size(&front);
    front.map(|p| match stacked {
        true => v(p.x * fit.x, p.y * fit.y, p.z),
        false => v(p.x, p.y * fit.y, p.z * fit.z),
    });
    let along = |p: V3| if stacked { p.z } else { p.x };
    let middle = |mesh: &Mesh| {
        let (low, high) = mesh.bounds();
        along((low + high) / 2.0)
    };
    let (low, high) = (middle(&rear), middle(&front));
    rear.keep(|p| along(p) < low);
    front.keep(|p| along(p) >= high);
    let shift = match stacked {
        true => v(0.0, 0.0, low - high),
        false => v(low - high, 0.0, 0.0),
    };
    rear.add(&front, |p| p + shift);
    rear
}

/// Without the triangles that have their middle in a slab of the height.
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
        for family in [Family::SimUdi, Family::SimKitti] {
            let known = family.known_classes().iter();
            let classes_m: Vec<[f64; 3]> =
                known.map(|c| size_of(mean_size_m(*c, family))).collect();
            let mut lengths = vec![];
            for i in 0..200 {
                let model = made_up(family, &mut Dice::new(&[11, i]));
                let size_m = size_of(model.size_m());
                assert!(has_road_size(size_m), "{size_m:?}");
                assert!(!has_known_size(size_m, &classes_m), "{size_m:?}");
                assert!(model.low.z.abs() < 1e-3 && !model.mesh.triangles.is_empty());
                let inside =
                    |p: &V3| p.cmpge(model.low - 1e-2).all() && p.cmple(model.high + 1e-2).all();
                let mesh = &model.mesh;
                let used = mesh.triangles.iter().flatten();
                assert!(used.map(|i| &mesh.vertices[*i as usize]).all(inside));
                lengths.push(size_m[0]);
            }
            let most = lengths.iter().copied().fold(0.0, f64::max);
            let least = lengths.iter().copied().fold(f64::MAX, f64::min);
            assert!(least < 0.7 && most > 6.0, "lengths {least} to {most} m");
        }
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
