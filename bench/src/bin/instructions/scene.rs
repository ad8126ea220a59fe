//! A scan made by arithmetic alone: ground in rings, a wall on each side, boxes on the ground, a candidate at each box. Every machine makes the same.

use mluc_ipc_types::{Detection, DetectionKind};

/// Length, width, height of the boxes, m.
const SIZES: [[f32; 3]; 3] = [[4.0, 1.7, 1.5], [0.7, 0.7, 1.7], [2.4, 1.2, 1.9]];
const BOXES: usize = 12;
const GROUND_M: f32 = -1.73;

/// Centre of a box's bottom on the ground, m.
fn place(number: usize) -> [f32; 2] {
    let (row, column) = (number / 3, number % 3);
    let (row, column) = (row as f32, column as f32);
    [4.5 + 3.6 * row, -6.5 + 5.0 * column + 0.7 * row]
}

/// The points of the scan: x, y, z in m, intensity.
pub(crate) fn points() -> Vec<[f32; 4]> {
    let mut points = vec![];
    for ring in 0..40 {
        // A parabola in place of a ring: as dense near the sensor, but computed without angles.
        let range = 2.5 + 0.4 * ring as f32;
        points.extend((0..200).map(|step| {
            let y = (step as f32 - 99.5) * 0.01 * range;
            [range + 0.1 - 0.3 * y * y / range, y, GROUND_M, 0.3]
        }));
    }
    for step in 0..140 {
        let x = 2.0 + 0.11 * step as f32;
        for level in 0..10 {
            let z = GROUND_M + 0.05 + 0.25 * level as f32;
            points.extend([[x, -9.5, z, 0.5], [x, 9.2, z, 0.5]]);
        }
    }
    for number in 0..BOXES {
        let ([x, y], [length, width, height]) = (place(number), SIZES[number % 3]);
        // The two sides that the sensor sees.
        for along in 0..24 {
            for level in 0..12 {
                let share = along as f32 / 23.0 - 0.5;
                let z = GROUND_M + 0.1 + (height - 0.1) * level as f32 / 11.0;
                points.push([x - length / 2.0, y + share * width, z, 0.7]);
                points.push([x + share * length, y - width / 2.0 * y.signum(), z, 0.7]);
            }
        }
    }
    points
}

/// Candidates off by some decimetres and of a car's size, like those of a detector that does not know the class.
pub(crate) fn candidates() -> Vec<Detection> {
    let candidate = |number: usize| {
        let [x, y] = place(number);
        let off = 0.1 * number as f32 - 0.5;
        Detection {
            center_m: [x + off, y - 0.5 * off, GROUND_M + 0.8],
            size_m: [3.9, 1.6, 1.56],
            yaw_rad: 0.4 * number as f32,
            kind: DetectionKind::Candidate as u32,
            objectness: 0.5,
            score: 0.3,
            eds: 20.0,
            ..Detection::default()
        }
    };
    (0..BOXES).map(candidate).collect()
}
