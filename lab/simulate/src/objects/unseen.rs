//! Objects assembled from the parts of a table: the unseen classes (`unseen.toml`, which explains the columns) and street furniture (`street.toml`).

use super::super::mesh::{
    GLASS, INTERIOR, LEAVES, METAL, Mesh, RETRO, Surface, V3, porous, solid, v,
};
use super::super::{Split, Unseen};
use super::vehicle::{axle, occupant, paint};
use crate::{objects::cyclist, random::Dice};
use serde::Deserialize;
use std::sync::LazyLock;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    class: Vec<Row>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Row {
    name: String,
    #[serde(default)]
    split: String,
    #[serde(default)]
    habit: Habit,
    /// Street furniture: number per 100 m.
    #[serde(default)]
    pub(crate) per_100_m: f32,
    size_m: [[f32; 2]; 3],
    #[serde(default)]
    scatter_m: f32,
    parts: Vec<Part>,
    #[serde(default)]
    twins: Vec<Part>,
}

/// Usual place of an object, and whether it moves.
#[derive(Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Habit {
    Road,
    Pavement,
    #[default]
    Still,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Shape {
    Block,
    Rod,
    Cone,
    Blob,
    Axle,
    Spokes,
    Sitting,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Cover {
    Paint,
    #[default]
    Dark,
    Steel,
    Wood,
    Glass,
    Mesh,
    Retro,
    Leaves,
}

/// Shape, position, size, surface, form, probability.
#[derive(Deserialize)]
struct Part(
    Shape,
    [f32; 3],
    #[serde(default)] [f32; 3],
    #[serde(default)] Cover,
    #[serde(default = "one")] f32,
    #[serde(default = "one")] f32,
);

fn one() -> f32 {
    1.0
}

static TABLE: LazyLock<Table> = LazyLock::new(|| read(include_str!("../../unseen.toml")));
static STREET: LazyLock<Table> = LazyLock::new(|| read(include_str!("../../street.toml")));

fn read(text: &str) -> Table {
    toml::from_str(text).expect("a table that a test reads")
}

/// Additional kinds of street furniture in `sim-any`.
pub(crate) fn street() -> &'static [Row] {
    &STREET.class
}

impl Unseen {
    /// The unseen classes of a split: different ones in validation and test, none in training.
    pub(crate) fn of(split: Split) -> impl Iterator<Item = Unseen> {
        let all = (0..TABLE.class.len()).map(|index| Unseen(index as u8));
        all.filter(move |class| class.row().split == split.name())
    }

    /// The name in label files.
    pub fn name(self) -> &'static str {
        &self.row().name
    }

    pub(crate) fn habit(self) -> Habit {
        self.row().habit
    }

    pub(super) fn row(self) -> &'static Row {
        &TABLE.class[usize::from(self.0)]
    }
}

impl Row {
    /// Builds one object; the drawn size applies to the parts that are always present.
    pub(crate) fn built(&self, dice: &mut Dice) -> Mesh {
        let (colour, lot) = (paint(dice), dice.unit());
        let mut mesh = Mesh::default();
        self.add(&mut mesh, colour, |odds| odds >= 1.0, dice);
        let (low, high) = mesh.bounds();
        self.add(&mut mesh, colour, |odds| lot < odds && odds < 1.0, dice);
        let [x, y, z] = self.size_m;
        let scale = dice.size(x, y, z) / (high - low);
        mesh.map(|p| p * scale);
        mesh.roughen(0.006, dice);
        mesh.put_down();
        mesh
    }

    fn add(&self, mesh: &mut Mesh, colour: Surface, wanted: impl Fn(f32) -> bool, dice: &mut Dice) {
        for part in self.parts.iter().filter(|part| wanted(part.5)) {
            let most_m = self.scatter_m;
            let off = v(dice.spread(most_m), dice.spread(most_m), 0.0);
            let mut own = Mesh::default();
            part.add(&mut own, colour, dice);
            mesh.add(&own, |p| p + off);
        }
        for part in self.twins.iter().filter(|part| wanted(part.5)) {
            let mut own = Mesh::default();
            part.add(&mut own, colour, dice);
            mesh.add(&own, |p| p);
            mesh.add(&own, |p| v(p.x, -p.y, p.z));
        }
    }
}

impl Part {
    fn add(&self, mesh: &mut Mesh, colour: Surface, dice: &mut Dice) {
        let &Part(shape, at, size, cover, form, _) = self;
        let (at, size) = (V3::from(at), V3::from(size));
        let surface = match cover {
            Cover::Paint => colour,
            Cover::Dark => INTERIOR,
            Cover::Steel => METAL,
            Cover::Wood => solid(0.4),
            Cover::Glass => GLASS,
            Cover::Mesh => porous(0.35, 0.6),
            Cover::Retro => RETRO,
            Cover::Leaves => LEAVES,
        };
        let sides = if form < 0.04 { 4 } else { 8 };
        match shape {
            Shape::Block => mesh.tapered(at, size, [form; 2], surface),
            Shape::Rod => mesh.rod([at, size], form, sides, surface),
            Shape::Cone => mesh.tube([at, size], [form, 0.02], sides, surface),
            Shape::Blob => mesh.blob(at, size, (5, 8), 0.04, dice, surface),
            Shape::Axle => axle(mesh, at.x, at.y, at.z, size.y),
            Shape::Spokes => cyclist::wheel(mesh, at, form),
            Shape::Sitting => occupant(mesh, at, dice),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_street_furniture_is_built_as_large_as_its_row_says() {
        for (kind, i) in street().iter().zip(0..) {
            assert!(kind.per_100_m > 0.0, "{}", kind.name);
            let (low, high) = kind.built(&mut Dice::new(&[6, i])).bounds();
            let least = V3::from(kind.size_m.map(|[least, _]| least - 0.02));
            let is_large = (high - low).cmpge(least).all();
            assert!(is_large && low.z.abs() < 1e-4, "{}", kind.name);
        }
        assert!(TABLE.class.iter().all(|class| !class.split.is_empty()));
    }
}
