//! Cluster-first proposals: what stands on the road and nobody detected, and how much a cluster looks like a road user.

use mluc_refiner::everything::Measures;

/// Smallest and largest l, w, h of a road user, m.
pub(super) const HULL_M: [[f32; 2]; 3] = [[0.4, 14.0], [0.4, 3.2], [0.8, 4.2]];
/// A road user's lowest point is seen at most this far above the ground, m (occlusion and the blind zone lift it).
const BOTTOM_MAX_M: f32 = 0.6;
/// Nor does it hang on something longer, m.
const COMPONENT_MAX_M: f32 = 16.0;

/// How much a cluster looks like a road user, from its measurements alone: the sum of a few steps, guessed from what walls, poles,
/// bushes and vehicles look like.
#[derive(Clone, Debug, PartialEq)]
pub struct ClusterScorer {
    /// Points from which on a cluster is certain to be something.
    pub points_full: f32,
    /// Weight of scattering: leaves scatter, bodies do not.
    pub scattering_weight: f32,
}

impl Default for ClusterScorer {
    fn default() -> ClusterScorer {
        ClusterScorer {
            points_full: 60.0,
            scattering_weight: 2.0,
        }
    }
}

/// Whether l, w, h are those of a road user.
pub(super) fn within_hull(size_m: [f32; 3]) -> bool {
    let mut pairs = size_m.iter().zip(HULL_M);
    pairs.all(|(size, [low, high])| (low..=high).contains(size))
}

impl ClusterScorer {
    /// 0 to 1; 0 for what cannot be a road user. `size_m`: l, w, h of its box.
    pub fn score(&self, size_m: [f32; 3], m: &Measures) -> f32 {
        let attached = m.is_cut || m.component_length_m > COMPONENT_MAX_M;
        if !within_hull(size_m) || attached || m.bottom_m > BOTTOM_MAX_M {
            return 0.0;
        }
        let seen = (m.points as f32 / self.points_full).min(1.0);
        let body = (1.0 - self.scattering_weight * m.scattering).clamp(0.0, 1.0);
        let fill = (m.density / 0.5).clamp(0.0, 1.0);
        seen * body * fill
    }
}
