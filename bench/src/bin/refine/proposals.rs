//! Proposals as a detector without the object's class would make them: off by up to a metre, of a wrong class's size.

use mluc_geometry::Box3;
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

/// SplitMix64: small, and the same everywhere.
pub(crate) struct Random(u64);

impl Random {
    /// A stream of its own for each key.
    pub(crate) fn keyed(keys: [u64; 3]) -> Random {
        let mut random = Random(0x6D6C_7563);
        for key in keys {
            random.0 ^= key.wrapping_mul(0x2545_F491_4F6C_DD1D);
            random.next();
        }
        random
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in 0..1.
    pub(crate) fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in 0..count.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.share() * count as f64) as usize
    }
}

/// One proposal for an object of a class: centre within a disc of 1 m, any heading, a size that is not its class's.
pub(crate) fn proposal(class: &str, object: &Box3, random: &mut Random) -> Box3 {
    let wrong: Vec<[f64; 3]> = KNOWN
        .iter()
        .filter(|(name, _)| !name.eq_ignore_ascii_case(class))
        .map(|&(_, size)| size)
        .collect();
    let size_m = wrong[random.below(wrong.len())];
    let distance_m = SHIFT_MAX_M * random.share().sqrt();
    let (sin, cos) = (std::f64::consts::TAU * random.share()).sin_cos();
    let bottom_m = object.center_m[2] - object.size_m[2] / 2.0
        + BOTTOM_SHIFT_MAX_M * (2.0 * random.share() - 1.0);
    Box3 {
        center_m: [
            object.center_m[0] + distance_m * cos,
            object.center_m[1] + distance_m * sin,
            bottom_m + size_m[2] / 2.0,
        ],
        size_m,
        yaw_rad: std::f64::consts::TAU * (random.share() - 0.5),
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
