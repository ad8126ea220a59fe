//! Picture of beam elevations: the returns of scans with another sensor's beams, or a profile with its rings on cars.

use mluc_gateway::picture::{Canvas, Color};
use mluc_ingest::estimate::{SensorEstimate, elevations::bin_deg};
use mluc_model::{SensorProfile, Wave};
use std::f32::consts::TAU;

const GROUND: Color = [11, 15, 22];
const TEXT: Color = [168, 180, 196];
const RETURNS: Color = [38, 130, 176];
const BEAM: Color = [244, 196, 72];
const OTHER: Color = [52, 176, 138];
/// Picture and plot sizes, px.
const SIZE: [usize; 2] = [900, 760];
const TOP: f32 = 72.0;
const HEIGHT: f32 = 670.0;
const LEFT: f32 = 70.0;
const RIGHT: f32 = 880.0;
const HISTOGRAM: f32 = 480.0;
const COLUMN: f32 = 120.0;
/// Margin around the outermost elevation, degrees.
const MARGIN_DEG: f32 = 2.0;
/// Cars that are drawn with a profile: distances and height, m.
pub(super) const CARS_M: [f32; 5] = [10.0, 20.0, 30.0, 40.0, 50.0];
const CAR_HEIGHT_M: f32 = 1.5;
const CAR_WIDTH_M: f32 = 1.8;
/// Height for a profile without one, m.
const SENSOR_HEIGHT_M: f32 = 1.8;

/// A picture with an axis of elevations.
struct Plot {
    canvas: Canvas,
    high_deg: f32,
    low_deg: f32,
}

impl Plot {
    /// Covers these elevations; `titles` are lines one below another, in a smaller font where they would be cut off.
    fn new(ends_deg: impl Iterator<Item = f32> + Clone, titles: [(String, Color); 3]) -> Plot {
        let mut plot = Plot {
            canvas: Canvas::new(SIZE[0], SIZE[1], GROUND),
            high_deg: ends_deg.clone().fold(f32::MIN, f32::max) + MARGIN_DEG,
            low_deg: ends_deg.fold(f32::MAX, f32::min) - MARGIN_DEG,
        };
        let field_deg = plot.high_deg - plot.low_deg;
        let step_deg = if field_deg > 60.0 { 10 } else { 5 };
        for deg in (-90..=90).filter(|deg| deg % step_deg == 0) {
            let y = plot.y(deg as f32);
            if (TOP..=TOP + HEIGHT).contains(&y) {
                let ends = [[LEFT, y], [RIGHT, y]];
                plot.canvas.line(ends[0], ends[1], 1.0, TEXT, 0.2);
                plot.canvas.text([14, y as i64 - 7], &deg.to_string(), 2, TEXT);
            }
        }
        for (line, (text, color)) in titles.iter().enumerate() {
            let fits = Canvas::text_size_px(text, 2)[0] <= (RIGHT - LEFT) as i64;
            let at = [LEFT as i64, 10 + 20 * line as i64];
            plot.canvas.text(at, text, if fits { 2 } else { 1 }, *color);
        }
        plot
    }

    fn y(&self, deg: f32) -> f32 {
        TOP + (self.high_deg - deg) / (self.high_deg - self.low_deg) * HEIGHT
    }

    fn beams(&mut self, from_x: f32, to_x: f32, elevations_deg: &[f32], color: Color) {
        for &deg in elevations_deg {
            let y = self.y(deg);
            self.canvas.line([from_x, y], [to_x, y], 1.0, color, 1.0);
        }
    }

    /// A tenth of a turn of waving lines.
    fn waves(&mut self, wave: Wave, profile: &SensorProfile) {
        let lines = profile.elevations_deg.len() as f32;
        for (number, &middle_deg) in profile.elevations_deg.iter().enumerate() {
            let at = |x: f32| {
                let tenths = (x - LEFT) / (RIGHT - LEFT);
                let turns = wave.a_turn * tenths / 10.0 + number as f32 / lines;
                let up_deg = wave.height_deg * (TAU * turns).sin();
                [x, self.y(middle_deg + up_deg)]
            };
            let xs = LEFT as usize..RIGHT as usize;
            let points: Vec<[f32; 2]> = xs.map(|x| at(x as f32)).collect();
            for ends in points.windows(2) {
                self.canvas.line(ends[0], ends[1], 1.0, BEAM, 1.0);
            }
        }
    }
}

/// On the left the returns by elevation and the beams found in them, on the right the other sensor's beams.
pub(super) fn of_scans(
    counts: &[u32],
    found: &SensorEstimate,
    name: &str,
    other: &SensorProfile,
) -> Canvas {
    let scans = format!("returns of {} scans by elevation, degrees", found.scans);
    let beams = format!("{} beams found", found.elevations_deg.len());
    let titles = [(scans, RETURNS), (beams, BEAM), (name.to_owned(), OTHER)];
    let ends = other.elevations_deg.iter().chain(&found.vertical_field_deg);
    let mut plot = Plot::new(ends.copied(), titles);
    // Number of returns in a row of pixels; their square root is drawn, so that beams with few returns stay visible.
    let mut rows = [0u32; SIZE[1]];
    for (bin, count) in counts.iter().enumerate() {
        let y = plot.y(bin_deg(bin));
        if (TOP..TOP + HEIGHT).contains(&y) {
            rows[y as usize] += count;
        }
    }
    let most = rows.iter().copied().max().unwrap_or(0).max(1) as f32;
    for (y, count) in rows.iter().enumerate().filter(|(_, count)| **count > 0) {
        let end = LEFT + (*count as f32 / most).sqrt() * HISTOGRAM;
        let corners = [[LEFT as i64, y as i64], [end as i64, y as i64 + 1]];
        plot.canvas.rectangle(corners[0], corners[1], RETURNS, 1.0);
    }
    let found_x = LEFT + HISTOGRAM + 15.0;
    let other_x = found_x + COLUMN + 15.0;
    plot.beams(found_x, found_x + COLUMN, &found.elevations_deg, BEAM);
    plot.beams(other_x, other_x + COLUMN, &other.elevations_deg, OTHER);
    plot.canvas
}

/// Elevations of the lower and the upper end of a car, degrees.
fn car_deg(profile: &SensorProfile, away_m: f32) -> [f32; 2] {
    let sensor_m = profile.height_m.unwrap_or(SENSOR_HEIGHT_M);
    [0.0, CAR_HEIGHT_M].map(|top_m| ((top_m - sensor_m) / away_m).atan().to_degrees())
}

/// Number of beams of a level sensor on a car at each of [`CARS_M`]; for waving lines the number of crossings.
pub(super) fn rings_on_cars(profile: &SensorProfile) -> [usize; 5] {
    let units = profile.units.len().max(1);
    CARS_M.map(|away_m| {
        let [low, high] = car_deg(profile, away_m);
        let up_deg = profile.wave.map_or(0.0, |wave| wave.height_deg);
        let beams = profile.elevations_deg.iter();
        let reach = |deg: &&f32| (low - up_deg..high + up_deg).contains(*deg);
        let beams = units * beams.filter(reach).count();
        let share_of_turn = (CAR_WIDTH_M / away_m).atan() / TAU;
        let crossings = |wave: Wave| 2.0 * wave.a_turn * share_of_turn * beams as f32;
        profile.wave.map_or(beams, |wave| crossings(wave).round() as usize)
    })
}

/// The beams of a profile, and cars 10 to 50 m away in front of them.
pub(super) fn of_profile(profile: &SensorProfile) -> Canvas {
    let beams = &profile.elevations_deg;
    let [top, bottom] = profile.vertical_field_deg();
    let what = format!(
        "{} beams, {top:.1} to {bottom:.1} degrees, columns {} degrees apart",
        beams.len() * profile.units.len().max(1),
        profile.azimuth_step_deg
    );
    let sensor_m = profile.height_m.unwrap_or(SENSOR_HEIGHT_M);
    let cars = format!("rings on a car 10 to 50 m away, sensor {sensor_m} m high:");
    let titles = [(profile.name.clone(), BEAM), (what, TEXT), (cars, OTHER)];
    let [low_deg, high_deg] = car_deg(profile, CARS_M[0]);
    let ends = [top, bottom, low_deg, high_deg].into_iter();
    let mut plot = Plot::new(ends, titles);
    match profile.wave {
        Some(wave) => plot.waves(wave, profile),
        None => plot.beams(LEFT, RIGHT, beams, BEAM),
    }
    for (at, (away_m, rings)) in CARS_M.iter().zip(rings_on_cars(profile)).enumerate() {
        let x = LEFT + 30.0 + 160.0 * at as f32;
        let [low, high] = car_deg(profile, *away_m).map(|deg| plot.y(deg) as i64);
        let ends = [[x as i64, high], [x as i64 + COLUMN as i64, low]];
        plot.canvas.rectangle(ends[0], ends[1], OTHER, 0.55);
        let text = format!("{away_m} m: {rings}");
        let size = Canvas::text_size_px(&text, 2);
        let below = [x as i64, low + 6];
        let corner = [below[0] + size[0], below[1] + size[1]];
        plot.canvas.rectangle(below.map(|v| v - 3), corner.map(|v| v + 3), GROUND, 0.9);
        plot.canvas.text(below, &text, 2, OTHER);
    }
    plot.canvas
}
