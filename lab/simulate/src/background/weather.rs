//! Rain with the spray of vehicles on the road, and the exhaust of engines in the cold: clouds that most rays pass.

use super::super::mesh::{Mesh, porous, v};
use super::super::random::Dice;
use super::{Thing, Yard};

/// Chance that a scene in the open is wet, and that it is cold.
const CHANCES: [f32; 2] = [0.08, 0.08];

/// Puffs up to some metres behind each vehicle, with some chance.
pub(super) fn place(yard: &mut Yard, dice: &mut Dice) {
    let lot = dice.unit();
    let is_wet = lot < CHANCES[0];
    if lot >= CHANCES[0] + CHANCES[1] || yard.ground.room.is_some() {
        return;
    }
    let (thing, chance, reach_m, radii_m) = if is_wet {
        yard.scene.rain = dice.range(0.1, 1.0);
        (Thing::Spray, 0.7, 6.0, [0.25, 0.8])
    } else {
        (Thing::Exhaust, 0.4, 2.5, [0.1, 0.45])
    };
    let vehicles = yard.layout.placed.iter().filter(|o| o.class.is_vehicle());
    let places: Vec<_> = vehicles.map(|o| o.footprint).collect();
    for at in places {
        let (_, across_m) = yard.ground.road(at.x, at.y);
        let drives = across_m.abs() < yard.ground.half_width_m;
        if (is_wet && !drives) || !dice.chance(chance) {
            continue;
        }
        let reach_m = dice.range(0.3, 1.0) * reach_m;
        let mut mesh = Mesh::default();
        for _ in 0..dice.whole(3, 12) {
            let radius_m = dice.range(radii_m[0], radii_m[1]);
            let behind_m = reach_m * dice.unit();
            let aside_m = dice.spread(at.half[1]);
            let up_m = radius_m * dice.range(0.7, 1.6);
            let center = v(-at.half[0] - behind_m, aside_m, up_m);
            let radii = v(1.5, 1.0, 0.8) * radius_m;
            let thin = porous(0.3, dice.range(0.8, 0.97));
            mesh.blob(center, radii, (5, 7), 0.3, dice, thin);
        }
        yard.show(thing, &mesh, [at.x, at.y], at.yaw, false);
    }
}
