//! The stage: detections and points of one frame to objects (paper section 3.3).

use crate::clusterer::{Clusterer, FrameTask, NoClusterer, ScanClusterer};
use crate::decide::{UnknownScorer, leave_out_low_scores};
use crate::merge::{KNOWN_MARGIN_M, best_first, find_rivals, merge};
use crate::proposal::{Proposal, valid_box};
use crate::{ClusterScorer, RefinerError, Sensor, Settings, Variant};
use crate::{frame::FrameIndex, output::Counters, output::RefinerOutput, paper::PaperClusterer};
use mluc_geometry::{Box3, Inside};
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, Disposition, OBJECT_POINTS_MAX, OBJECTS_MAX, Object, ObjectKind,
    POINTS_MAX, Point,
};
use mluc_model::{Beams, Model, Probabilities, ScoreMin};

/// Maximum work of all candidates of a frame in the paper's variants: reads of points. It is counted and not timed, so that
/// equal input gives equal output. In the variant that clusters the scan once, the number of points bounds the work.
pub const WORK_MAX: u64 = 2_500_000;

/// Refines the candidates of each frame. The large buffers are allocated at the start; the others grow with the first frames.
#[derive(Debug)]
pub struct Refiner {
    settings: Settings,
    classes: usize,
    frame: FrameIndex,
    clusterer: Box<dyn Clusterer>,
    scorer: UnknownScorer,
    /// The probabilities that belong to scores, if the model has them.
    probabilities: Option<Probabilities>,
    proposals: Vec<Proposal>,
    /// Points of all proposals, by their ranges.
    points: Vec<u32>,
    counters: Counters,
    /// Known objects with a high score, and for each point of the scan whether it belongs to one of them.
    known: Vec<(usize, Box3)>,
    is_known: Vec<bool>,
    order: Vec<usize>,
}

impl Refiner {
    /// A refiner without a cluster scorer. Returns an error for invalid settings.
    pub fn new(settings: Settings, sensor: &Sensor) -> Result<Refiner, RefinerError> {
        Refiner::with_scorer(settings, sensor, None)
    }

    /// A refiner for a model: with its sensor, and with its cluster scorer and probabilities if it has them.
    pub fn for_model(settings: Settings, model: &Model) -> Result<Refiner, RefinerError> {
        let sensor = Sensor::from_manifest(&model.manifest);
        // The probabilities belong to the default variant's scores.
        let told = model.manifest.thresholds.probabilities.clone();
        let probabilities = told.filter(|_| settings.variant == Variant::default());
        let scorer = ClusterScorer::of_model(&model.weights);
        Ok(Refiner { probabilities, ..Refiner::with_scorer(settings, &sensor, scorer)? })
    }

    /// A refiner with layers that score clusters; the settings may disable them. Returns an error for invalid settings and beams.
    pub fn with_scorer(
        settings: Settings,
        sensor: &Sensor,
        scorer: Option<ClusterScorer>,
    ) -> Result<Refiner, RefinerError> {
        settings.check()?;
        let beams = sensor.beams.as_ref().map_or(Ok(()), Beams::validate);
        beams.map_err(|cause| RefinerError::new("the sensor", "a range image's beams", cause))?;
        let clusterer: Box<dyn Clusterer> = match settings.variant {
            Variant::RangeScaled => Box::new(ScanClusterer::new(&settings, sensor)),
            Variant::Paper | Variant::PaperCorrected => {
                Box::new(PaperClusterer::new(&settings, sensor))
            }
            Variant::None => Box::new(NoClusterer),
        };
        Ok(Refiner {
            classes: sensor.classes.len(),
            frame: FrameIndex::default(),
            clusterer,
            scorer: UnknownScorer::new(&settings, sensor, scorer)?,
            settings,
            probabilities: None,
            proposals: Vec::with_capacity(DETECTIONS_MAX),
            points: Vec::with_capacity(OBJECT_POINTS_MAX + POINTS_MAX),
            counters: Counters::default(),
            known: Vec::with_capacity(DETECTIONS_MAX),
            is_known: Vec::with_capacity(POINTS_MAX),
            order: Vec::with_capacity(DETECTIONS_MAX),
        })
    }

    /// Sets the minimum scores of published objects, from the next frame on.
    pub fn set_score_min(&mut self, score_min: ScoreMin) {
        self.settings.score_min = score_min;
    }

    /// Refines one frame: an object for each detection, in order, with its disposition, then the second readings of candidates:
    /// the same boxes as objects of their classes, if the model gives P(unknown) and [`OBJECTS_MAX`] leaves room.
    ///
    /// `sequence` is the key of the random choices of the variant `paper`. Points that are not finite are left out and counted;
    /// points farther than 128 m are left out. The result depends on the arguments and settings alone.
    pub fn refine(
        &mut self,
        sequence: u64,
        points: &[Point],
        detections: &[Detection],
        out: &mut RefinerOutput,
    ) {
        self.read_scan(points);
        self.refine_within(sequence, points, detections, &mut || false, out);
        out.choose_readings();
    }

    /// Sorts a scan and finds its ground: the part that needs no detections.
    pub fn read_scan(&mut self, scan: &[Point]) {
        self.frame.sort(scan);
        self.clusterer.find_ground(&self.frame);
    }

    /// The scan that was read last.
    pub fn scan(&self) -> &FrameIndex {
        &self.frame
    }

    /// The steps: proposals from the head's gate, ground, clusters of the scan, matching of proposals to clusters, box, score,
    /// disposition, merge (paper section 3.3), the profile's scores.
    ///
    /// As [`Refiner::refine`], for the scan given last to [`Refiner::read_scan`] and a caller with a clock. Before the scan is clustered, and before
    /// each candidate (best first), `is_over` returns whether the frame's time is up. The remaining candidates then keep their proposal boxes, get
    /// [`Object::UNREFINED`] and are counted. If `is_over` returns true at once, all are skipped: for a frame whose points are gone.
    pub fn refine_within(
        &mut self,
        sequence: u64,
        scan: &[Point],
        detections: &[Detection],
        is_over: &mut dyn FnMut() -> bool,
        out: &mut RefinerOutput,
    ) {
        let variant = self.settings.variant;
        // Proposals that keep their boxes cost no time.
        let mut is_over = || variant != Variant::None && is_over();
        self.read_proposals(detections);
        let has_time = self.proposals.iter().any(Proposal::is_standing) && !is_over();
        self.take_points_of_known(scan.len());
        let (proposals, clusterer) = (&mut self.proposals, &mut self.clusterer);
        let mut task = FrameTask {
            sequence,
            scan,
            frame: &self.frame,
            is_known: &self.is_known,
            known: &self.known,
            points: &mut self.points,
            counters: &mut self.counters,
        };
        if has_time {
            clusterer.find_clusters(&task, proposals);
        }
        let mut over = !has_time;
        best_first(&mut self.order, proposals, |p| p.score.into());
        for &index in &self.order {
            let proposal = &mut proposals[index];
            over = over || task.counters.work >= WORK_MAX || is_over();
            if over {
                task.counters.unrefined += 1;
                proposal.flags |= Object::UNREFINED;
                self.scorer.score_unrefined(proposal);
            } else if clusterer.match_cluster(&mut task, proposal) {
                proposal.measures = clusterer.lay_box(&mut task, proposal);
                self.scorer.score(proposal);
                self.scorer.decide(proposal);
            }
        }
        merge(proposals, task.points, scan, variant, &mut self.order);
        // Without a least score every unknown object is published, however weak: it takes no known object's place.
        if self.scorer.reads_twice() && self.settings.score_min.unknown > 0.0 {
            find_rivals(proposals);
        }
        leave_out_low_scores(proposals, self.settings.score_min);
        self.write_out(detections, out);
    }

    fn read_proposals(&mut self, detections: &[Detection]) {
        self.proposals.clear();
        self.points.clear();
        self.counters = Counters {
            detections_dropped: detections.len().saturating_sub(DETECTIONS_MAX) as u32,
            ..Counters::default()
        };
        for (index, detection) in detections.iter().take(DETECTIONS_MAX).enumerate() {
            let proposal = match valid_box(detection, self.classes) {
                Some(shape) => {
                    let score = self.scorer.score_candidate(detection);
                    let proposal = Proposal::of_detection(index, detection, shape, score);
                    Proposal {
                        is_low: proposal.score < self.settings.score_min.known,
                        is_doubted: self.scorer.doubts(detection),
                        ..proposal
                    }
                }
                None => {
                    self.counters.invalid_detections += 1;
                    Proposal::invalid(index, detection)
                }
            };
            self.proposals.push(proposal);
        }
        if self.scorer.reads_twice() {
            for (index, detection) in detections.iter().enumerate().take(self.proposals.len()) {
                let first = &self.proposals[index];
                let has_second = first.is_standing() && detection.has_class();
                if has_second && self.proposals.len() < OBJECTS_MAX {
                    self.proposals.push(first.second(detection));
                }
            }
        }
    }

    /// Lists the points in known objects' boxes. In a variant that keeps them apart, known objects with a high score own the points in and near them.
    fn take_points_of_known(&mut self, points: usize) {
        let taken = &mut self.points;
        self.counters.points_not_finite = self.frame.not_finite;
        self.known.clear();
        self.is_known.clear();
        self.is_known.resize(points, false);
        let keeps_apart = self.settings.is_ours();
        for known in self.proposals.iter_mut().filter(|p| p.is_known()) {
            let first = taken.len();
            let is_owner = keeps_apart && known.is_sure();
            let own = Inside::of(&known.shape, 0.0);
            let around = Inside::of(&known.shape, KNOWN_MARGIN_M);
            let [x, y, _] = known.shape.center_m;
            let half_side_m = known.shape.half_diagonal_m() + 2.0 * KNOWN_MARGIN_M;
            for point in self.frame.rows_around([x, y], half_side_m).flatten() {
                let at_m = point.at_m.map(f64::from);
                self.is_known[point.index as usize] |= is_owner && around.contains(at_m);
                if own.contains(at_m) {
                    if taken.len() < OBJECT_POINTS_MAX {
                        taken.push(point.index);
                    } else {
                        self.counters.object_points_dropped += 1;
                    }
                }
            }
            known.points = (first, taken.len());
            if is_owner && taken.len() > first {
                self.known.push((known.detection, known.shape));
            }
        }
    }

    /// Writes the output. Objects share points; if not all points have room, each has its own: first the published objects, then the suppressed ones.
    fn write_out(&self, detections: &[Detection], out: &mut RefinerOutput) {
        out.objects.clear();
        out.object_points.clear();
        out.measures.clear();
        out.rivals.clear();
        if !self.settings.score_min.both_readings {
            let rival = |(index, own): (usize, &Proposal)| Some((index, own.rival?));
            let rivals = self.proposals.iter().enumerate().filter_map(rival);
            out.rivals.extend(rivals);
        }
        (out.measures).extend(self.proposals.iter().map(|p| p.measures));
        out.counters = self.counters;
        for proposal in &self.proposals {
            let detection = &detections[proposal.detection];
            let mut object = proposal.object(detection, self.classes.max(1));
            let [x_m, y_m, _] = object.center_m;
            let is_known = proposal.kind == ObjectKind::Known;
            let told = self.probabilities.as_ref();
            // The tables belong to scores that include the cluster's score.
            let has_cluster = proposal.measures.is_some() || !self.scorer.reads_clusters();
            let told = told.filter(|_| is_known || has_cluster);
            let told = told.and_then(|told| told.of(is_known, x_m.hypot(y_m), object.score));
            if let Some(probability) = told {
                object.tell_probability(probability);
            }
            out.objects.push(object);
        }
        let has_room = self.points.len() <= OBJECT_POINTS_MAX;
        if has_room {
            out.object_points.extend_from_slice(&self.points);
        }
        for published in [true, false] {
            for (proposal, object) in self.proposals.iter().zip(&mut out.objects) {
                let counts = proposal.disposition == Disposition::Published && !proposal.is_second;
                if counts != published {
                    continue;
                }
                let (mut first, end) = proposal.points;
                let mut count = end - first;
                if !has_room {
                    let own = &self.points[first..end];
                    first = out.object_points.len();
                    count = count.min(OBJECT_POINTS_MAX - first);
                    out.object_points.extend_from_slice(&own[..count]);
                    out.counters.object_points_dropped += (own.len() - count) as u32;
                }
                (object.points_first, object.points_count) = (first as u32, count as u32);
            }
        }
    }
}
