//! Everything that is neither ground nor labelled: frontages along the road, street furniture, vegetation, and background of a car's size.

mod confusers;
mod frontage;
mod furniture;
mod indoor;
mod outdoor;
mod variety;
mod vegetation;
mod weather;

use super::mesh::{Mesh, V3, v};
use super::{Family, Step, footprint::Footprint, ground::Ground, layout::Layout, place::Place};
use super::{random::Dice, scene::Scene};

/// Kinds of background, for the instance file: 0x8000 + kind.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(u16)]
pub(crate) enum Thing {
    Building = 1,
    Wall,
    Fence,
    Hedge,
    Bush,
    Tree,
    Pole,
    Sign,
    Bollard,
    Hydrant,
    Bin,
    Bench,
    Bicycles,
    Shelter,
    Planter,
    Pallets,
    Container,
    Dumpster,
    GasTank,
    Cabinet,
    Covered,
    Ceiling,
    Column,
    Rack,
    Machine,
    Pile,
    Rail,
    Grass,
    Rock,
    Log,
    /// Street furniture of `street.toml`.
    Street,
    Rain,
    Spray,
    Exhaust,
}

impl Thing {
    /// Instance number of every point on a thing of this kind.
    pub(crate) fn instance(self) -> u16 {
        0x8000 + self as u16
    }

    /// Whether a thing follows the ground in `sim-any`, where it is steeper: long and low things do.
    fn follows_ground(self) -> bool {
        use Thing::{Fence, Grass, Hedge, Log, Rail, Wall};
        matches!(self, Wall | Fence | Hedge | Rail | Grass | Log)
    }
}

/// Adds the triangles of one thing, around the origin on the ground.
type Builder = fn(&mut Mesh, &mut Dice);

/// The mesh that a builder makes.
fn built(build: impl FnOnce(&mut Mesh, &mut Dice), dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    build(&mut mesh, dice);
    mesh
}

/// Fills a scene around its objects. Things that would overlap an object or each other are left out.
pub(crate) fn fill(layout: &mut Layout<'_>, scene: &mut Scene, dice: &mut Dice) {
    let (ground, options) = (layout.ground, layout.options);
    let mut yard = Yard::new(layout, scene);
    if let Some(room) = &ground.room {
        indoor::place(&mut yard, room, dice);
        if ground.place == Place::CarPark {
            // Visible over the parapets.
            yard.shows = options.has(Step::Frontage);
            frontage::place(&mut yard, dice);
        }
        return;
    }
    // A step that is left out still takes its places, so that everything else stays unchanged.
    let mut place = |step: Option<Step>, place: fn(&mut Yard, &mut Dice)| {
        yard.shows = step.is_none_or(|step| options.has(step));
        place(&mut yard, dice);
    };
    place(Some(Step::Confusers), confusers::place);
    match ground.place {
        Place::CarPark => place(None, outdoor::car_park),
        Place::Depot => place(None, outdoor::depot),
        Place::Path => return place(None, outdoor::path),
        _ if options.family == Family::SimAny => place(Some(Step::Street), variety::place),
        _ => {}
    }
    place(Some(Step::Frontage), frontage::place);
    place(Some(Step::Furniture), furniture::place);
    place(Some(Step::Vegetation), vegetation::place);
}

/// Rain with its spray, or exhaust, in some scenes of `sim-any`.
pub(crate) fn weather(layout: &mut Layout<'_>, scene: &mut Scene, dice: &mut Dice) {
    weather::place(&mut Yard::new(layout, scene), dice);
}

/// The place that the builders fill.
struct Yard<'a, 'b> {
    ground: &'a Ground,
    layout: &'b mut Layout<'a>,
    scene: &'b mut Scene,
    /// Whether things are visible, or only take their ground.
    shows: bool,
}

impl<'a, 'b> Yard<'a, 'b> {
    fn new(layout: &'b mut Layout<'a>, scene: &'b mut Scene) -> Yard<'a, 'b> {
        Yard { ground: layout.ground, layout, scene, shows: true }
    }

    /// Range of things along the road, m.
    fn along_m(&self) -> [f32; 2] {
        match self.layout.options.family {
            Family::SimUdi | Family::SimAny => [-72.0, 72.0],
            Family::SimKitti => [0.0, 82.0],
        }
    }

    /// Length of road over which rates are counted, in units of 100 m.
    fn hundreds(&self) -> f32 {
        let [low, high] = self.along_m();
        (high - low) / 100.0
    }

    /// Places a thing at road coordinates, turned by `yaw` relative to the road, if there is room; true when placed.
    fn put(&mut self, thing: Thing, mesh: &Mesh, along: f32, across: f32, yaw: f32) -> bool {
        let (at, yaw, footprint) = self.pose(mesh, along, across, yaw);
        let mut taken = self.layout.taken.iter();
        let is_free = !taken.any(|other| footprint.overlaps(other, 0.1));
        if is_free {
            self.layout.taken.push(footprint);
            self.add(thing, mesh, at, yaw);
        }
        is_free
    }

    /// Origin and heading of a thing in the sensor frame, and the ground that it takes.
    fn pose(&self, mesh: &Mesh, along: f32, across: f32, yaw: f32) -> ([f32; 2], f32, Footprint) {
        let ((low, high), (x, y)) = (mesh.bounds(), self.ground.sensor(along, across));
        let yaw = self.ground.yaw_rad + yaw;
        ([x, y], yaw, Footprint::of(low, high, [x, y], yaw))
    }

    /// Adds a thing without a check for room: `at` is in the sensor frame.
    fn add(&mut self, thing: Thing, mesh: &Mesh, at: [f32; 2], yaw: f32) {
        let is_any = self.layout.options.family == Family::SimAny;
        if self.shows {
            self.show(thing, mesh, at, yaw, is_any && thing.follows_ground());
        }
    }

    /// Each vertex keeps its height over the plane z = 0: over the ground at the thing's origin, or over the ground below the vertex.
    fn show(&mut self, thing: Thing, mesh: &Mesh, at: [f32; 2], yaw: f32, follows_ground: bool) {
        let (ground, (sin, cos)) = (self.ground, yaw.sin_cos());
        let foot = ground.height(at[0], at[1]);
        self.scene.add(mesh, thing.instance(), |p: V3| {
            let (x, y) = (at[0] + p.x * cos - p.y * sin, at[1] + p.x * sin + p.y * cos);
            let height = ground.height(x, y);
            let z = if follows_ground { height } else { foot };
            v(x, y, z + p.z)
        });
    }

    /// Column of a catalogue: 0 in towns, 1 in industry.
    fn column(&self) -> usize {
        let place = self.ground.place;
        usize::from(!matches!(place, Place::Urban | Place::Suburb))
    }

    /// A random position along the road.
    fn somewhere(&self, dice: &mut Dice) -> f32 {
        let [low, high] = self.along_m();
        dice.range(low, high)
    }

    /// A position across the road behind the pavement, up to `depth_m` deep; on a plaza anywhere.
    fn behind(&self, depth_m: f32, dice: &mut Dice) -> f32 {
        if self.ground.place == Place::Plaza && dice.chance(0.6) {
            return dice.spread(self.ground.half_width_m);
        }
        dice.sign() * (self.ground.edge_m + dice.range(0.4, depth_m))
    }

    /// A position on the pavement with this chance, else behind it.
    fn beside(&self, on_pavement: f32, depth_m: f32, dice: &mut Dice) -> f32 {
        if dice.chance(on_pavement) {
            return dice.sign() * dice.range(self.ground.half_width_m + 0.25, self.ground.edge_m);
        }
        self.behind(depth_m, dice)
    }
}
