//! What unknown objects are worth: the looks of the clusters that they lie on, and the sizes of road users.

use mluc_geometry::{Box3, intersection_over_min_area};
use mluc_ipc_types::{POINTS_MAX, Point};

use crate::everything::FrameClusters;
use crate::merge::are_apart;
use crate::{Everything, HullSettings, Looks, RefinerError, Sensor, Settings};

/// An object is on the cluster that shares most with it (intersection over the smaller area), from this on.
const COVERED: f64 = 0.3;
/// The looks of an object that is on no cluster, larger than a road user or a post, and the least of any: it stays, behind all that look
/// like something.
pub(crate) const LOOKS_LIKE_NOTHING: f32 = 0.05;
/// Clusters that memory is made for, five times those of a real scan of 120,000 points.
const CLUSTERS: usize = 1024;

/// Looks at frame after frame; all buffers are made once.
#[derive(Debug)]
pub(crate) struct Judge {
    looks: Looks,
    hull: HullSettings,
    everything: Everything,
    found: FrameClusters,
    /// Box and looks of each cluster of a road user's size.
    judged: Vec<(Box3, f32)>,
}

impl Judge {
    pub(crate) fn new(
        looks: Looks,
        settings: &Settings,
        sensor: &Sensor,
    ) -> Result<Judge, RefinerError> {
        let mut found = FrameClusters::default();
        found.clusters.reserve(CLUSTERS);
        found.points.reserve(POINTS_MAX);
        Ok(Judge {
            looks,
            hull: settings.hull.clone(),
            everything: Everything::new(settings, sensor)?,
            found,
            judged: Vec::with_capacity(CLUSTERS),
        })
    }

    /// Finds and judges the clusters of a scan.
    pub(crate) fn look_around(&mut self, points: &[Point]) {
        self.everything.find(points, &mut self.found);
        let sized = self.found.clusters.iter();
        let sized = sized.filter(|cluster| self.hull.refusal(&cluster.shape).is_none());
        self.judged.clear();
        self.judged
            .extend(sized.map(|cluster| (cluster.shape, self.looks.of(&cluster.measures))));
    }

    /// The looks of the cluster of the last scan that an object shares most with, 0.05 to 1.
    pub(crate) fn looks_of(&self, shape: &Box3) -> f32 {
        let near = self.judged.iter();
        let near = near.filter(|(cluster, _)| !are_apart(cluster, shape));
        let shares = near.map(|(c, looks)| (intersection_over_min_area(shape, c), *looks));
        match shares.reduce(|a, b| if b.0 > a.0 { b } else { a }) {
            Some((share, looks)) if share > COVERED => looks.max(LOOKS_LIKE_NOTHING),
            _ => LOOKS_LIKE_NOTHING,
        }
    }
}
