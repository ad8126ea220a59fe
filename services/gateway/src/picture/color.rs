//! Colours: a dark ground, a ramp for height, one colour a kind of box.

use super::canvas::Color;

/// Background.
pub(super) const NIGHT: Color = [11, 15, 22];
/// Range rings and axes.
pub(super) const RING: Color = [58, 70, 88];
/// Captions.
pub(super) const CAPTION: Color = [168, 180, 196];

/// Knots of the height ramp: deep blue, teal, green, yellow, red.
const RAMP: [Color; 6] = [
    [44, 62, 140],
    [38, 130, 176],
    [52, 176, 138],
    [158, 204, 86],
    [244, 196, 72],
    [232, 98, 72],
];

/// Colour of a place on the ramp, 0..1.
pub fn ramp(t: f32) -> Color {
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) } * (RAMP.len() - 1) as f32;
    let low = (t as usize).min(RAMP.len() - 2);
    let share = t - low as f32;
    std::array::from_fn(|i| {
        let (a, b) = (f32::from(RAMP[low][i]), f32::from(RAMP[low + 1][i]));
        (a + (b - a) * share).round() as u8
    })
}

/// Colour of a label: the common classes have their own, whatever the case of their letters; others share one.
pub fn label_color(label: &str) -> Color {
    match label.to_ascii_lowercase().as_str() {
        "car" => [86, 180, 255],
        "pedestrian" => [120, 230, 120],
        "cyclist" => [255, 214, 90],
        "truck" => [190, 150, 255],
        "van" => [255, 150, 90],
        "golf_cart" | "golf cart" => [255, 120, 190],
        "forklift" => [255, 110, 110],
        "unknown" => [255, 84, 84],
        _ => [200, 200, 200],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ramp_meets_its_ends_and_survives_nan() {
        assert_eq!(ramp(-1.0), RAMP[0]);
        assert_eq!(ramp(2.0), RAMP[5]);
        assert_eq!(ramp(f32::NAN), RAMP[0]);
    }
}
