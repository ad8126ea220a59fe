//! The output of a frame.

use crate::clusters::Measures;
use mluc_ipc_types::{Disposition, Flags, OBJECT_POINTS_MAX, OBJECTS_MAX, Object};
use smart_default::SmartDefault;

/// Counts of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Candidates that were not refined, because the frame's work or time was used up or the points are gone: they keep their proposal box.
    pub unrefined: u32,
    /// Candidates whose neighbourhood was thinned.
    pub thinned: u32,
    /// Detections with an invalid size, place, class or kind.
    pub invalid_detections: u32,
    /// Detections beyond the contract's limit.
    pub detections_dropped: u32,
    /// Points with NaN or infinity.
    pub points_not_finite: u32,
    /// Entries of `object_points` that did not fit.
    pub object_points_dropped: u32,
    /// The counted work of all candidates: each read of a point counts.
    pub work: u64,
}

impl Counters {
    /// The flags of the frame: limits that were reached, input that was not usable.
    pub fn flags(&self) -> Flags {
        let flags = [
            (self.points_not_finite, Flags::NOT_FINITE),
            (self.detections_dropped, Flags::LIMIT_DETECTIONS),
            (self.object_points_dropped, Flags::LIMIT_OBJECT_POINTS),
            (self.unrefined + self.thinned, Flags::LIMIT_WORK),
            (self.unrefined + self.invalid_detections, Flags::DEGRADED),
        ];
        let set = flags.into_iter().filter(|(count, _)| *count > 0);
        set.fold(Flags::default(), |all, (_, flag)| all.with(flag))
    }
}

/// The objects of one frame; buffers are reused from frame to frame.
#[derive(Debug, SmartDefault)]
pub struct RefinerOutput {
    /// One for each detection, in the order of the detections, then the second readings.
    #[default(Vec::with_capacity(OBJECTS_MAX))]
    pub objects: Vec<Object>,
    /// For known objects that may be unknown, their index, that of the unknown object at their place (for a second reading its first) and
    /// the share of overlap; empty if both are published.
    #[default(Vec::with_capacity(OBJECTS_MAX))]
    pub rivals: Vec<(usize, (usize, f32))>,
    /// Measurements of each object's cluster, if it has a measured one.
    #[default(Vec::with_capacity(OBJECTS_MAX))]
    pub measures: Vec<Option<Measures>>,
    /// Indices into the scan; each object has a range of them.
    #[default(Vec::with_capacity(OBJECT_POINTS_MAX))]
    pub object_points: Vec<u32>,
    /// Counts of the frame.
    pub counters: Counters,
}

impl RefinerOutput {
    /// Keeps one of the two readings of a place: the known one if the unknown object has a low score, no cluster or an unconfirmed track, or if such an
    /// object covers it. To be called last, when tracks are known.
    pub fn choose_readings(&mut self) {
        use Disposition::{LowScore, OverlapsUnknown, TooFewPoints, Unconfirmed};
        for &(index, (first, share)) in &self.rivals {
            let own = self.objects[first];
            let is_covered = own.disposition == OverlapsUnknown as u32;
            let (by, overlap) =
                if is_covered { (own.suppressed_by, own.overlap) } else { (first as u32, share) };
            let best = self.objects[by as usize];
            let second = &mut self.objects[index];
            let weak = [LowScore, TooFewPoints, Unconfirmed].map(|reason| reason as u32);
            if !second.is_published() || weak.contains(&best.disposition) {
                continue;
            }
            (second.disposition, second.suppressed_by, second.overlap) = if best.is_published() {
                (OverlapsUnknown as u32, by, overlap)
            } else {
                (best.disposition, best.suppressed_by, best.overlap)
            };
        }
    }

    /// Indices of an object's points into the scan.
    pub fn points_of(&self, object: &Object) -> &[u32] {
        let first = object.points_first as usize;
        let range = first..first + object.points_count as usize;
        self.object_points.get(range).unwrap_or(&[])
    }
}
