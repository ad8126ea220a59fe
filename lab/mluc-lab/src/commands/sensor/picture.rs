//! The beams of a sensor, and what they see of cars.

use mluc_gateway::picture::{Canvas, Color};
use mluc_model::SensorProfile;

const GROUND: Color = [11, 15, 22];
const TEXT: Color = [168, 180, 196];
const BEAM: Color = [244, 196, 72];
const CAR: Color = [52, 176, 138];
/// Picture and plot, px.
const SIZE: [usize; 2] = [900, 760];
const TOP: f32 = 72.0;
const HEIGHT: f32 = 670.0;
const LEFT: f32 = 70.0;
const RIGHT: f32 = 880.0;
const COLUMN: f32 = 120.0;
/// Around the outermost elevation, degrees.
const MARGIN_DEG: f32 = 2.0;
/// The cars that a profile is shown with: how far away and how high, m.
pub(super) const CARS_M: [f32; 5] = [10.0, 20.0, 30.0, 40.0, 50.0];
const CAR_HEIGHT_M: f32 = 1.5;
/// Where a profile names no height, m.
const SENSOR_HEIGHT_M: f32 = 1.8;

/// Elevations of the lower and the upper end of a car, degrees.
fn car_deg(profile: &SensorProfile, away_m: f32) -> [f32; 2] {
    let sensor_m = profile.height_m.unwrap_or(SENSOR_HEIGHT_M);
    [0.0, CAR_HEIGHT_M].map(|top_m| ((top_m - sensor_m) / away_m).atan().to_degrees())
}

/// Beams that a level sensor has on a car at each of [`CARS_M`].
pub(super) fn rings_on_cars(profile: &SensorProfile) -> [usize; 5] {
    let units = profile.units.len().max(1);
    CARS_M.map(|away_m| {
        let [low, high] = car_deg(profile, away_m);
        let beams = profile.elevations_deg.iter();
        units * beams.filter(|deg| (low..high).contains(*deg)).count()
    })
}

/// The beams of a profile, and cars 10 to 50 m away in front of them.
pub(super) fn of_profile(profile: &SensorProfile) -> Canvas {
    let beams = &profile.elevations_deg;
    let mut canvas = Canvas::new(SIZE[0], SIZE[1], GROUND);
    let [low_deg, high_deg] = car_deg(profile, CARS_M[0]);
    let high_deg = beams.iter().fold(high_deg, |a, b| a.max(*b)) + MARGIN_DEG;
    let low_deg = beams.iter().fold(low_deg, |a, b| a.min(*b)) - MARGIN_DEG;
    let y = |deg: f32| TOP + (high_deg - deg) / (high_deg - low_deg) * HEIGHT;
    let step_deg = if high_deg - low_deg > 60.0 { 10 } else { 5 };
    for deg in (-90..=90).filter(|deg| deg % step_deg == 0) {
        let y = y(deg as f32);
        if (TOP..=TOP + HEIGHT).contains(&y) {
            canvas.line([LEFT, y], [RIGHT, y], 1.0, TEXT, 0.2);
            canvas.text([14, y as i64 - 7], &deg.to_string(), 2, TEXT);
        }
    }
    draw_titles(&mut canvas, profile);
    for &deg in beams {
        canvas.line([LEFT, y(deg)], [RIGHT, y(deg)], 1.0, BEAM, 1.0);
    }
    for (at, (away_m, rings)) in CARS_M.iter().zip(rings_on_cars(profile)).enumerate() {
        let x = LEFT + 30.0 + 160.0 * at as f32;
        let [low, high] = car_deg(profile, *away_m).map(|deg| y(deg) as i64);
        let ends = [[x as i64, high], [x as i64 + COLUMN as i64, low]];
        canvas.rectangle(ends[0], ends[1], CAR, 0.55);
        let text = format!("{away_m} m: {rings}");
        let size = Canvas::text_size_px(&text, 2);
        let below = [x as i64, low + 6];
        let corner = [below[0] + size[0], below[1] + size[1]];
        canvas.rectangle(below.map(|v| v - 3), corner.map(|v| v + 3), GROUND, 0.9);
        canvas.text(below, &text, 2, CAR);
    }
    canvas
}

/// Above each other; smaller where they would be cut.
fn draw_titles(canvas: &mut Canvas, profile: &SensorProfile) {
    let beams = &profile.elevations_deg;
    let what = format!(
        "{} beams, {:.1} to {:.1} degrees, columns {} degrees apart",
        beams.len() * profile.units.len().max(1),
        beams[0],
        beams[beams.len() - 1],
        profile.azimuth_step_deg
    );
    let sensor_m = profile.height_m.unwrap_or(SENSOR_HEIGHT_M);
    let cars = format!("rings on a car 10 to 50 m away, sensor {sensor_m} m high:");
    let titles = [(profile.name.clone(), BEAM), (what, TEXT), (cars, CAR)];
    for (line, (text, color)) in titles.iter().enumerate() {
        let fits = Canvas::text_size_px(text, 2)[0] <= (RIGHT - LEFT) as i64;
        let at = [LEFT as i64, 10 + 20 * line as i64];
        canvas.text(at, text, if fits { 2 } else { 1 }, *color);
    }
}
