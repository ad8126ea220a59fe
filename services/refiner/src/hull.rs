//! How large road users are, and what is too high for the ground it stands on. Extension of the paper.

use mluc_geometry::Box3;
use mluc_ipc_types::Fate;
use serde::{Deserialize, Serialize};

/// Sizes of road users: smaller unknown objects are suppressed, larger ones and clusters of neither size look like nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HullSettings {
    /// Whether unknown objects are held to these sizes. Unset: where they are ranked by P(unknown) or by their looks, so with an open
    /// head, in `distance`, `dbscan` and `euclidean`.
    pub applies: Option<bool>,
    /// Shortest and longest, m: a person seen from one side; a truck with its trailer seen in full.
    pub length_m: [f64; 2],
    /// Narrowest and widest, m: the same person; a truck with what sticks out of it. Posts and walls seen from one side are
    /// narrower.
    pub width_m: [f64; 2],
    /// Lowest and highest, m: a child or a low cart; a truck. Kerbs are lower.
    pub height_m: [f64; 2],
    /// Longest side of the ground under a post, m: what is higher than `post_height_m` on less ground than this is no road user.
    pub post_side_m: f64,
    /// Highest, m, that a road user with both sides shorter than `post_side_m` is: a tall person.
    pub post_height_m: f64,
}

impl Default for HullSettings {
    fn default() -> HullSettings {
        HullSettings {
            applies: None,
            length_m: [0.4, 14.0],
            width_m: [0.4, 3.2],
            height_m: [0.8, 4.2],
            post_side_m: 1.2,
            post_height_m: 2.0,
        }
    }
}

impl HullSettings {
    /// Why a box is not of a road user's size, if it is not.
    pub(crate) fn refusal(&self, shape: &Box3) -> Option<Fate> {
        let limits = [self.length_m, self.width_m, self.height_m];
        let mut pairs = shape.size_m.iter().zip(limits);
        let is_over = pairs.clone().any(|(size, [_, most])| *size > most);
        let is_under = pairs.any(|(size, [least, _])| *size < least);
        match (is_over, is_under) {
            (true, _) => Some(Fate::Oversized),
            (_, true) => Some(Fate::Undersized),
            _ if self.is_post(shape) => Some(Fate::Oversized),
            _ => None,
        }
    }

    /// Higher than a person, and no longer than one: a post, a sign, a trunk.
    fn is_post(&self, shape: &Box3) -> bool {
        let [length, width, height] = shape.size_m;
        length.max(width) < self.post_side_m && height > self.post_height_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn carts_stay_and_walls_posts_and_kerbs_go() {
        let of = |size: [f64; 3]| {
            let [l, w, h] = size;
            HullSettings::default().refusal(&Box3::new([0.0, 0.0, 0.0, l, w, h, 0.3]))
        };
        assert_eq!(of([2.6, 1.3, 1.9]), None);
        assert_eq!(of([15.0, 0.2, 2.0]), Some(Fate::Oversized));
        assert_eq!(of([0.5, 0.2, 2.0]), Some(Fate::Undersized));
        assert_eq!(of([4.0, 1.0, 0.3]), Some(Fate::Undersized));
        assert_eq!(of([0.8, 0.9, 2.3]), Some(Fate::Oversized));
        // A tall person, a person on a scooter, a forklift from its narrow side.
        for size in [[0.6, 0.7, 1.95], [1.3, 0.6, 2.1], [0.5, 1.25, 2.2]] {
            assert_eq!(of(size), None, "{size:?}");
        }
    }
}
