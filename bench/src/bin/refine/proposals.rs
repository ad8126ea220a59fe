//! Proposals as a detector without the object's class would make them: off by up to a metre, of a wrong class's size.

use mluc_geometry::{Box3, Random};
use mluc_ipc_types::{Detection, DetectionKind};

/// Anchor sizes of the known classes, l, w, h, m (the public SECOND configuration for KITTI).
const KNOWN: [(&str, [f64; 3]); 3] = [
    ("car", [3.9, 1.6, 1.56]),
    ("pedestrian", [0.8, 0.6, 1.73]),
    ("cyclist", [1.76, 0.6, 1.73]),
];
/// Names of the classes above.
pub(crate) const CLASSES: [&str; 3] = [KNOWN[0].0, KNOWN[1].0, KNOWN[2].0];
/// Largest horizontal error, m.
const SHIFT_MAX_M: f64 = 1.0;
/// Largest error of the bottom, m.
const BOTTOM_SHIFT_MAX_M: f64 = 0.2;

/// A stream of its own for each key.
pub(crate) fn keyed(keys: [u64; 3]) -> Random {
    let step = |state: u64, key: u64| {
        (state ^ key.wrapping_mul(0x2545_F491_4F6C_DD1D)).wrapping_add(0x9E37_79B9_7F4A_7C15)
    };
    Random::from_state(keys.into_iter().fold(0x6D6C_7563, step))
}

/// One proposal for an object of a class: centre within a disc of 1 m, any heading, a size that is not its class's.
pub(crate) fn proposal(class: &str, object: &Box3, random: &mut Random) -> Box3 {
    let wrong: Vec<[f64; 3]> = KNOWN
        .iter()
        .filter(|(name, _)| !name.eq_ignore_ascii_case(class))
        .map(|&(_, size)| size)
        .collect();
    let size_m = wrong[random.below(wrong.len())];
    let distance_m = SHIFT_MAX_M * random.unit().sqrt();
    let (sin, cos) = (std::f64::consts::TAU * random.unit()).sin_cos();
    let bottom_m = object.center_m[2] - object.size_m[2] / 2.0
        + BOTTOM_SHIFT_MAX_M * (2.0 * random.unit() - 1.0);
    Box3 {
        center_m: [
            object.center_m[0] + distance_m * cos,
            object.center_m[1] + distance_m * sin,
            bottom_m + size_m[2] / 2.0,
        ],
        size_m,
        yaw_rad: std::f64::consts::TAU * (random.unit() - 0.5),
    }
}

/// As the head would hand it over.
pub(crate) fn candidate(proposal: &Box3, eds: f32) -> Detection {
    Detection {
        center_m: proposal.center_m.map(|v| v as f32),
        size_m: proposal.size_m.map(|v| v as f32),
        yaw_rad: proposal.yaw_rad as f32,
        kind: DetectionKind::Candidate as u32,
        objectness: 0.5,
        score: 0.3,
        eds,
        ..Detection::default()
    }
}
