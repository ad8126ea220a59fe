//! The stage: detections and points of one frame to objects (paper section 3.3).

use mluc_geometry::Box3;
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, Disposition, OBJECT_POINTS_MAX, Object, POINTS_MAX, Point,
};
use mluc_model::Model;

use crate::clusterer::{Clusterer, FrameInput, NoClusterer, ScanClusterer};
use crate::decide::UnknownScorer;
use crate::frame::FrameIndex;
use crate::inside::Inside;
use crate::merge::{KNOWN_MARGIN_M, KNOWN_SCORE_MIN, merge};
use crate::output::RefinerOutput;
use crate::paper::PaperClusterer;
use crate::proposal::{Proposal, valid_box};
use crate::{ClusterScorer, RefinerError, Sensor, Settings, Variant};

/// Work that all candidates of a frame may cost in the paper's variants: points looked at, as often as they are. Counted and
/// not timed, so that equal input gives equal output. Where the scan is clustered once, work is bounded by its points.
pub const WORK_MAX: u64 = 2_500_000;

/// Refines frame after frame; all buffers are made once.
#[derive(Debug)]
pub struct Refiner {
    settings: Settings,
    classes: usize,
    /// Out of its place while it works.
    clusterer: Option<Box<dyn Clusterer>>,
    scorer: UnknownScorer,
    proposals: Vec<Proposal>,
    /// Points of all proposals, by their ranges.
    points: Vec<u32>,
    /// Known objects of a high score, and whether one owns a point of the scan.
    known: Vec<(usize, Box3)>,
    is_known: Vec<bool>,
    order: Vec<usize>,
}

impl Refiner {
    /// Without what a model has learned of clusters. Refuses settings that make no sense.
    pub fn new(settings: Settings, sensor: &Sensor) -> Result<Refiner, RefinerError> {
        Refiner::with_scorer(settings, sensor, None)
    }

    /// For a model: its sensor, and its scorer of clusters where it has one.
    pub fn for_model(settings: Settings, model: &Model) -> Result<Refiner, RefinerError> {
        let sensor = Sensor::from_manifest(&model.manifest)?;
        Refiner::with_scorer(settings, &sensor, ClusterScorer::of_model(&model.weights))
    }

    /// With layers that score clusters, which the settings may leave aside. Refuses settings that make no sense.
    pub fn with_scorer(
        settings: Settings,
        sensor: &Sensor,
        scorer: Option<ClusterScorer>,
    ) -> Result<Refiner, RefinerError> {
        settings.check()?;
        if let Some(beams) = &sensor.beams {
            beams.check()?;
        }
        Ok(Refiner {
            classes: sensor.classes.len(),
            clusterer: Some(match settings.variant {
                Variant::RangeScaled => Box::new(ScanClusterer::new(&settings, sensor)?),
                Variant::Paper | Variant::PaperCorrected => {
                    Box::new(PaperClusterer::new(&settings, sensor))
                }
                Variant::None => Box::new(NoClusterer::default()),
            }),
            scorer: UnknownScorer::new(&settings, sensor, scorer)?,
            settings,
            proposals: Vec::with_capacity(DETECTIONS_MAX),
            points: Vec::with_capacity(OBJECT_POINTS_MAX + POINTS_MAX),
            known: Vec::with_capacity(DETECTIONS_MAX),
            is_known: Vec::with_capacity(POINTS_MAX),
            order: Vec::with_capacity(DETECTIONS_MAX),
        })
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// One frame: an object for each detection, in their order, with its disposition.
    ///
    /// `sequence` keys the random choices of the variant `paper`. Points that are not finite or far outside are left out
    /// and counted. The result depends on the arguments and settings alone.
    pub fn refine(
        &mut self,
        sequence: u64,
        points: &[Point],
        detections: &[Detection],
        out: &mut RefinerOutput,
    ) {
        self.refine_within(sequence, points, detections, &mut || false, out);
    }

    /// As [`Refiner::refine`], for a caller with a clock: before the scan is clustered, and before each candidate, the
    /// best first, `is_over` is asked whether the frame's time is up. Then the candidates that are left keep their proposal
    /// boxes, are published with [`Object::UNREFINED`] and counted. One that says yes at once skips them all: for a frame
    /// whose points are gone.
    pub fn refine_within(
        &mut self,
        sequence: u64,
        scan: &[Point],
        detections: &[Detection],
        is_over: &mut dyn FnMut() -> bool,
        out: &mut RefinerOutput,
    ) {
        out.clear();
        out.counters.detections_dropped = detections.len().saturating_sub(DETECTIONS_MAX) as u32;
        let detections = &detections[..detections.len().min(DETECTIONS_MAX)];
        self.read_proposals(detections, out);
        // Proposals that keep their boxes cost no time.
        let variant = self.settings.variant;
        let mut is_over = || variant != Variant::None && is_over();
        let has_time = self.proposals.iter().any(Proposal::is_standing) && !is_over();
        if let Some(mut clusterer) = self.clusterer.take() {
            self.sort_points(sequence, scan, &mut *clusterer, has_time, out);
            let is_known = std::mem::take(&mut self.is_known);
            let known = std::mem::take(&mut self.known);
            let input = FrameInput {
                sequence,
                scan,
                is_known: &is_known,
                known: &known,
            };
            if has_time {
                clusterer.cluster_scan(&input);
            }
            self.refine_candidates(
                &input,
                detections,
                &mut *clusterer,
                has_time,
                &mut is_over,
                out,
            );
            self.clusterer = Some(clusterer);
            (self.is_known, self.known) = (is_known, known);
        }
        merge(
            &mut self.proposals,
            &self.points,
            scan,
            variant,
            &mut self.order,
        );
        self.write_out(detections, out);
    }

    fn read_proposals(&mut self, detections: &[Detection], out: &mut RefinerOutput) {
        self.proposals.clear();
        self.points.clear();
        for (index, detection) in detections.iter().enumerate() {
            let proposal = match valid_box(detection, self.classes) {
                Some(shape) => {
                    let score = self.scorer.score(detection);
                    Proposal::of_detection(index, detection, shape, score)
                }
                None => Proposal::invalid(index, detection),
            };
            match (proposal.disposition, proposal.is_unknown()) {
                (Disposition::InvalidBox, _) => out.counters.invalid_detections += 1,
                (_, true) => out.counters.candidates += 1,
                (_, false) => out.counters.known += 1,
            }
            self.proposals.push(proposal);
        }
    }

    /// Sorts the points, and lists those in the boxes of known objects; where the variant keeps them apart, those of known
    /// objects with a high score are theirs.
    fn sort_points(
        &mut self,
        sequence: u64,
        scan: &[Point],
        clusterer: &mut dyn Clusterer,
        has_time: bool,
        out: &mut RefinerOutput,
    ) {
        let input = FrameInput {
            sequence,
            scan,
            is_known: &[],
            known: &[],
        };
        clusterer.sort(&input, &self.proposals, has_time);
        self.collect_known(scan.len(), clusterer.frame(), out);
    }

    fn collect_known(&mut self, points: usize, frame: &FrameIndex, out: &mut RefinerOutput) {
        out.counters.points_not_finite = frame.not_finite;
        out.counters.points_outside = frame.outside;
        self.known.clear();
        self.is_known.clear();
        self.is_known.resize(points, false);
        let keeps_apart = self.settings.is_ours();
        for known in self.proposals.iter_mut().filter(|p| p.is_known()) {
            let first = self.points.len();
            let is_owner = keeps_apart && known.score >= KNOWN_SCORE_MIN;
            let grown = known.grown(KNOWN_MARGIN_M);
            let [x, y, _] = grown.center_m;
            let half_diagonal_m = grown.size_m[0].hypot(grown.size_m[1]) / 2.0;
            let (own, around) = (Inside::of(&known.shape, 0.0), Inside::of(&grown, 0.0));
            for point in frame.rows_around([x, y], half_diagonal_m).flatten() {
                if !around.contains(point.at_m) {
                    continue;
                }
                self.is_known[point.index as usize] |= is_owner;
                if own.contains(point.at_m) {
                    if self.points.len() < OBJECT_POINTS_MAX {
                        self.points.push(point.index);
                    } else {
                        out.counters.object_points_dropped += 1;
                    }
                }
            }
            known.points = (first, self.points.len());
            if is_owner && self.points.len() > first {
                self.known.push((known.detection, known.shape));
            }
        }
    }

    /// Best score first, until the frame's work or time is used up, or none when there never was time.
    fn refine_candidates(
        &mut self,
        input: &FrameInput,
        detections: &[Detection],
        clusterer: &mut dyn Clusterer,
        has_time: bool,
        is_over: &mut dyn FnMut() -> bool,
        out: &mut RefinerOutput,
    ) {
        self.order.clear();
        let proposals = &mut self.proposals;
        self.order
            .extend((0..proposals.len()).filter(|&i| proposals[i].is_standing()));
        self.order.sort_unstable_by(|&a, &b| {
            let key = |i: usize| detections[i].center_m;
            let scores = proposals[b].score.total_cmp(&proposals[a].score);
            let places = || key(a).partial_cmp(&key(b));
            scores
                .then_with(|| places().unwrap_or(std::cmp::Ordering::Equal))
                .then(a.cmp(&b))
        });
        let mut over = !has_time;
        let work_max = self.settings.study.work_max.unwrap_or(WORK_MAX);
        let counters = &mut out.counters;
        for &index in &self.order {
            let proposal = &mut proposals[index];
            over = over || counters.work >= work_max || is_over();
            if over {
                counters.unrefined += 1;
                proposal.flags |= Object::UNREFINED;
                if has_time {
                    self.scorer.decide_unrefined(proposal);
                }
            } else {
                let measures = clusterer.refine(input, proposal, &mut self.points, counters);
                self.scorer.decide(proposal, measures.as_ref());
            }
        }
    }

    /// Published objects get their points first; suppressed ones what room is left.
    fn write_out(&mut self, detections: &[Detection], out: &mut RefinerOutput) {
        for (proposal, detection) in self.proposals.iter().zip(detections) {
            out.counters.by_disposition[proposal.disposition as usize] += 1;
            out.objects
                .push(proposal.object(detection, self.classes.max(1)));
        }
        for published in [true, false] {
            for (proposal, object) in self.proposals.iter().zip(&mut out.objects) {
                if (proposal.disposition == Disposition::Published) != published {
                    continue;
                }
                let own = &self.points[proposal.points.0..proposal.points.1];
                let room = OBJECT_POINTS_MAX - out.object_points.len();
                let fits = own.len().min(room);
                object.points_first = out.object_points.len() as u32;
                object.points_count = fits as u32;
                out.object_points.extend_from_slice(&own[..fits]);
                out.counters.object_points_dropped += (own.len() - fits) as u32;
            }
        }
    }
}
