//! Watches what a sensor sees of its surroundings: the directions that lost their returns (dirt, a cover, a cut cable), and whether
//! the ground is visible. It needs no full look: every seventh point of a few scans per second.

use super::{GROUND_SHARE_MIN, HEIGHT_M, is_sampled, level::LevelFinder};
use mluc_ipc_types::{Point, Status};
use mluc_model::{SensorProfile, degrees_off};

/// Looks in a row that must miss something before it counts as lost.
const LOOKS: u8 = 3;
/// A sector has no returns if it has a smaller share of its usual returns than this; 16 beams over open ground keep three tenths.
const LEFT_SHARE: f32 = 0.1;
/// Weight of the newest look in the usual number.
const FOLLOW: f32 = 0.1;
/// Nearer returns come from a cover, where no profile gives the sensor's shortest range, m. A guess.
const RANGE_MIN_M: f32 = 0.3;
const SECTOR_DEG: f32 = 360.0 / Status::SECTORS as f32;

/// Something that was visible and may be lost.
#[derive(Clone, Copy, Debug, Default)]
struct Kept {
    /// Its usual size; 0 until it was seen.
    usual: f32,
    /// Looks that found it, up to [`LOOKS`]; one stray return does not count as seen.
    seen: u8,
    missed: u8,
}

impl Kept {
    fn look(&mut self, found: f32) {
        let is_there = found > 0.0 && found >= LEFT_SHARE * self.usual;
        if is_there {
            let weight = if self.usual > 0.0 { FOLLOW } else { 1.0 };
            self.usual += weight * (found - self.usual);
            (self.seen, self.missed) = ((self.seen + 1).min(LOOKS), 0);
            return;
        }
        self.missed = self.missed.saturating_add(1);
        if self.seen < LOOKS {
            (self.usual, self.seen) = (0.0, 0);
        }
    }

    fn is_usual(self) -> bool {
        self.seen >= LOOKS
    }

    fn is_lost(self) -> bool {
        self.missed >= LOOKS
    }
}

/// Looks at some of the scans of a run.
#[derive(Clone, Debug)]
pub struct View {
    sectors: [Kept; Status::SECTORS],
    ground: Kept,
    /// Number of looks, up to [`LOOKS`].
    looks: u8,
    finder: LevelFinder,
    /// Sectors that the sensor sees by its profile; without a profile, the sectors that had returns in this run.
    field: Option<u64>,
    range_min_m: f32,
}

impl View {
    /// Allocates all memory.
    pub fn new(sensor: Option<&SensorProfile>) -> View {
        View {
            sectors: [Kept::default(); Status::SECTORS],
            ground: Kept::default(),
            looks: 0,
            finder: LevelFinder::default(),
            field: sensor.map(field),
            range_min_m: sensor.map_or(RANGE_MIN_M, |sensor| sensor.range_m[0]),
        }
    }

    /// Forgets a run.
    pub fn clear(&mut self) {
        self.sectors.fill(Kept::default());
        self.ground = Kept::default();
        self.looks = 0;
    }

    /// Looks at a scan: a sample of a seventh of its points.
    pub fn look(&mut self, points: &[Point]) {
        let sample = points.iter().enumerate();
        let sample = sample.filter(|(number, p)| is_sampled(*number) && p.is_finite());
        let sample = sample.map(|(_, point)| point);
        let mut counts = [0u32; Status::SECTORS];
        for point in sample.clone() {
            let range_m = point.x_m.hypot(point.y_m).hypot(point.z_m);
            if range_m >= self.range_min_m {
                counts[Status::sector_of(point.x_m, point.y_m)] += 1;
            }
        }
        for (kept, count) in self.sectors.iter_mut().zip(counts) {
            kept.look(count as f32);
        }
        let level = self.finder.below(sample.map(|p| [p.x_m, p.y_m, p.z_m]));
        let is_ground = level
            .is_some_and(|level| level.share >= GROUND_SHARE_MIN && level.z_m() < -HEIGHT_M.start);
        self.ground.look(f32::from(u8::from(is_ground)));
        self.looks = (self.looks + 1).min(LOOKS);
    }

    /// Sectors that should have returns, as bits.
    pub fn expected(&self) -> u64 {
        let seen = || self.bits(Kept::is_usual);
        self.field.unwrap_or_else(seen)
    }

    /// Whether no direction ever had returns.
    pub fn sees_nothing(&self) -> bool {
        self.looks >= LOOKS && self.bits(|kept| kept.seen > 0) == 0
    }

    /// The expected sectors that have no returns, as bits.
    pub fn blind(&self) -> u64 {
        self.expected() & self.bits(Kept::is_lost)
    }

    /// Whether the ground was seen and is not seen any more.
    pub fn is_ground_lost(&self) -> bool {
        self.ground.is_usual() && self.ground.is_lost()
    }

    fn bits(&self, is_set: impl Fn(Kept) -> bool) -> u64 {
        let bit = |(sector, kept): (usize, &Kept)| u64::from(is_set(*kept)) << sector;
        self.sectors.iter().enumerate().map(bit).sum()
    }
}

/// Sectors that lie in the profile's field as a whole, and in which the robot's own body does not hide the horizon.
fn field(sensor: &SensorProfile) -> u64 {
    let [middle_deg, width_deg] = sensor.field_deg.unwrap_or([0.0, 360.0]);
    let units = sensor.units.iter().map(|unit| unit.yaw_deg);
    let yaws_deg: Vec<f32> = units.chain(sensor.units.is_empty().then_some(0.0)).collect();
    let is_inside = |sector: &usize| {
        let center_deg = (*sector as f32 + 0.5) * SECTOR_DEG;
        let off_deg = |yaw_deg| degrees_off(center_deg, middle_deg + yaw_deg);
        let is_seen = |yaw_deg: &f32| {
            width_deg >= 360.0 || off_deg(*yaw_deg) + SECTOR_DEG / 2.0 <= width_deg / 2.0
        };
        yaws_deg.iter().any(is_seen) && !sensor.hides(center_deg)
    };
    (0..Status::SECTORS).filter(is_inside).map(|sector| 1 << sector).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::{BlindSector, SensorUnit};

    /// Rings on the ground below the sensor, in the sectors `from..to`.
    fn ring(from: usize, to: usize) -> Vec<Point> {
        let degrees =
            (from as f32 * SECTOR_DEG * 4.0) as usize..(to as f32 * SECTOR_DEG * 4.0) as usize;
        let azimuths = degrees.map(|quarter| (quarter as f32 * 0.25 + 0.1).to_radians());
        let at = |azimuth: f32| {
            let (sin, cos) = azimuth.sin_cos();
            let at = move |range_m: f32| [range_m * cos, range_m * sin, -1.7, 0.1];
            (4u8..30).map(move |range| bytemuck::cast::<_, Point>(at(range.into())))
        };
        azimuths.flat_map(at).collect()
    }

    fn looked(view: &mut View, scan: &[Point]) -> (u64, bool) {
        (0..LOOKS).for_each(|_| view.look(scan));
        (view.blind(), view.is_ground_lost())
    }

    #[test]
    fn a_sensor_that_never_saw_anything_is_told_from_one_that_did() {
        let told = |first: &[Point]| {
            let mut view = View::new(None);
            (0..LOOKS).for_each(|_| view.look(first));
            view.look(&[]);
            view.sees_nothing()
        };
        let zeros = [Point::default(); 100];
        let found = [told(&zeros), told(&[]), told(&ring(0, 36))];
        assert_eq!(found, [true, true, false]);
        assert!(!View::new(None).sees_nothing(), "not looked yet");
    }

    #[test]
    fn a_covered_sector_is_blind_after_three_looks_and_sees_again() {
        let mut view = View::new(None);
        let whole = ring(0, 36);
        view.look(&whole);
        assert_eq!(looked(&mut view, &[]), (0, false), "seen once");
        assert_eq!(looked(&mut view, &whole), (0, false));
        let covered = [ring(0, 4), ring(8, 36)].concat();
        view.look(&covered);
        assert_eq!(view.blind(), 0);
        assert_eq!(looked(&mut view, &covered), (0xf0, false));
        view.look(&whole);
        assert_eq!(view.blind(), 0);
        // Returns from a near cover do not count as returns.
        let near = |p: &Point| [p.x_m * 0.005, p.y_m * 0.005, 0.0, p.intensity];
        let tape: Vec<Point> = whole.iter().map(|p| bytemuck::cast(near(p))).collect();
        assert_eq!(looked(&mut view, &tape), ((1 << 36) - 1, true));
        assert_eq!(looked(&mut view, &[]), ((1 << 36) - 1, true));
        view.clear();
        assert_eq!(looked(&mut view, &[]), (0, false));
    }

    #[test]
    fn what_a_profile_does_not_see_is_not_blind_and_what_it_sees_is_from_the_start() {
        let ahead = SensorProfile {
            field_deg: Some([0.0, 120.0]),
            range_m: [0.5, 100.0],
            ..SensorProfile::default()
        };
        let mut view = View::new(Some(&ahead));
        assert_eq!(view.expected().count_ones(), 12);
        let mast = SensorProfile {
            blind: vec![BlindSector { azimuth_deg: [0.0, 20.0], below_deg: 90.0 }],
            ..ahead.clone()
        };
        assert_eq!(View::new(Some(&mast)).expected().count_ones(), 10);
        // The units see 30 to 150 degrees to each side.
        let unit = |yaw_deg| SensorUnit { yaw_deg, ..SensorUnit::default() };
        let sides = SensorProfile { units: vec![unit(90.0), unit(-90.0)], ..ahead.clone() };
        assert_eq!(View::new(Some(&sides)).expected(), 0xfff << 3 | 0xfff << 21);
        let left = ring(0, 6);
        let right = ((1 << 36) - 1) ^ ((1 << 30) - 1);
        assert_eq!(looked(&mut view, &left), (right, false));
    }
}
