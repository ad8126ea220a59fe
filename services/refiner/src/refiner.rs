//! The stage: detections and points of one frame to objects (paper section 3.3).

use mluc_geometry::Box3;
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, Fate, OBJECT_POINTS_MAX, Object, POINTS_MAX, Point,
};
use mluc_model::Model;

use crate::candidate::Candidates;
use crate::draft::{Draft, sound_box};
use crate::frame::FrameIndex;
use crate::inside::Inside;
use crate::judge::{Judge, LOOKS_LIKE_NOTHING};
use crate::merge::merge;
use crate::recipe::Recipe;
use crate::refined::Refined;
use crate::{Looks, RefinerError, Sensor, Settings, seed};

/// Refines frame after frame; all buffers are made once.
#[derive(Debug)]
pub struct Refiner {
    settings: Settings,
    classes: usize,
    radius_m: f64,
    recipe: Recipe,
    frame: FrameIndex,
    candidates: Candidates,
    judge: Option<Judge>,
    /// Whether unknown objects must have a road user's size.
    is_sized: bool,
    drafts: Vec<Draft>,
    /// Points of all drafts, by their ranges.
    points: Vec<u32>,
    /// Whether a known object owns a point of the scan.
    is_known: Vec<bool>,
    order: Vec<usize>,
}

impl Refiner {
    /// Without what a model has learned of clusters. Refuses settings that make no sense.
    pub fn new(settings: Settings, sensor: &Sensor) -> Result<Refiner, RefinerError> {
        Refiner::with_looks(settings, sensor, None)
    }

    /// For a model: its sensor, and its looks where it has them.
    pub fn for_model(settings: Settings, model: &Model) -> Result<Refiner, RefinerError> {
        let sensor = Sensor::from_manifest(&model.manifest)?;
        Refiner::with_looks(settings, &sensor, Looks::of_model(&model.weights))
    }

    /// With layers that judge clusters, which the settings may leave aside. Refuses settings that make no sense.
    pub fn with_looks(
        settings: Settings,
        sensor: &Sensor,
        looks: Option<Looks>,
    ) -> Result<Refiner, RefinerError> {
        settings.check()?;
        if let Some(beams) = &sensor.beams {
            beams.check()?;
        }
        let judges = settings.judges(looks.is_some())?;
        let judge = looks
            .filter(|_| judges)
            .map(|looks| Judge::new(looks, &settings, sensor))
            .transpose()?;
        let recipe = Recipe::of(&settings, sensor);
        let radius_m = settings.radius_for(sensor);
        Ok(Refiner {
            classes: sensor.classes.len(),
            radius_m,
            candidates: Candidates::new(&settings, sensor, radius_m),
            is_sized: settings.sizes(judge.is_some(), sensor.unknown_logit_at.is_some()),
            judge,
            recipe,
            settings,
            frame: FrameIndex::default(),
            drafts: Vec::with_capacity(DETECTIONS_MAX),
            points: Vec::with_capacity(OBJECT_POINTS_MAX),
            is_known: Vec::with_capacity(POINTS_MAX),
            order: Vec::with_capacity(DETECTIONS_MAX),
        })
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// One frame: an object for each detection, in their order, with its fate.
    ///
    /// `sequence` keys the random choices of the literal mode. Points that are not finite or far outside are left out
    /// and counted. The result depends on the arguments and settings alone.
    pub fn refine(
        &mut self,
        sequence: u64,
        points: &[Point],
        detections: &[Detection],
        out: &mut Refined,
    ) {
        self.refine_within(sequence, points, detections, &mut || false, out);
    }

    /// As [`Refiner::refine`], for a caller with a clock: before the clusters are looked at, and before each candidate, the
    /// best first, `is_over` is asked whether the frame's time is up. Then the candidates that are left keep their proposal
    /// boxes, are published with [`Object::UNREFINED`](mluc_ipc_types::Object::UNREFINED) and counted. One that says yes
    /// at once skips them all, looks included: for a frame whose points are gone.
    pub fn refine_within(
        &mut self,
        sequence: u64,
        points: &[Point],
        detections: &[Detection],
        is_over: &mut dyn FnMut() -> bool,
        out: &mut Refined,
    ) {
        out.clear();
        out.counters.detections_dropped = detections.len().saturating_sub(DETECTIONS_MAX) as u32;
        let detections = &detections[..detections.len().min(DETECTIONS_MAX)];
        self.draft_proposals(detections, out);
        self.index_regions(points, out);
        self.collect_known(points, out);
        let over = !self.look_around(points, is_over);
        self.refine_candidates(sequence, detections, over, is_over, out);
        if !over {
            self.judge_unknown();
        }
        merge(
            &mut self.drafts,
            &self.points,
            points,
            self.recipe.merge,
            &self.settings,
            &mut self.order,
        );
        self.write_out(detections, out);
    }

    fn draft_proposals(&mut self, detections: &[Detection], out: &mut Refined) {
        self.drafts.clear();
        self.points.clear();
        for (index, detection) in detections.iter().enumerate() {
            let draft = match sound_box(detection, self.classes) {
                Some(shape) => Draft::of_proposal(index, detection, shape, self.recipe.ranking),
                None => Draft::of_nonsense(index, detection),
            };
            match (draft.fate, draft.is_unknown()) {
                (Fate::InvalidBox, _) => out.counters.invalid_detections += 1,
                (_, true) => out.counters.candidates += 1,
                (_, false) => out.counters.known += 1,
            }
            self.drafts.push(draft);
        }
    }

    /// Sorts the points near any detection.
    fn index_regions(&mut self, points: &[Point], out: &mut Refined) {
        self.frame.start();
        for draft in self.drafts.iter().filter(|d| d.fate == Fate::Published) {
            let center = [draft.shape.center_m[0], draft.shape.center_m[1]];
            let half_side_m = match draft.is_unknown() {
                true => {
                    let reach = seed::reach_m(&draft.shape) + self.radius_m;
                    reach.max(self.settings.ground.radius_m)
                }
                false => half_diagonal_m(&draft.grown(self.settings.merge.known_margin_m)),
            };
            self.frame.want(center, half_side_m);
        }
        self.frame.sort(points);
        out.counters.points_not_finite = self.frame.not_finite;
        out.counters.points_outside = self.frame.outside;
    }

    /// Lists the points in the boxes of known objects, and marks those of the sure ones as theirs.
    fn collect_known(&mut self, points: &[Point], out: &mut Refined) {
        self.is_known.clear();
        self.is_known.resize(points.len(), false);
        for draft in &mut self.drafts {
            if draft.fate != Fate::Published || draft.is_unknown() {
                continue;
            }
            let first = self.points.len();
            let marks =
                self.recipe.keeps_known_apart && draft.score >= self.settings.merge.known_score_min;
            let grown = draft.grown(self.settings.merge.known_margin_m);
            let center = [grown.center_m[0], grown.center_m[1]];
            let (own, around) = (Inside::of(&draft.shape, 0.0), Inside::of(&grown, 0.0));
            for row in self.frame.rows_around(center, half_diagonal_m(&grown)) {
                for point in row {
                    if !around.contains(point.at_m) {
                        continue;
                    }
                    if marks {
                        self.is_known[point.index as usize] = true;
                    }
                    if own.contains(point.at_m) {
                        match self.points.len() < OBJECT_POINTS_MAX {
                            true => self.points.push(point.index),
                            false => out.counters.object_points_dropped += 1,
                        }
                    }
                }
            }
            draft.points = (first, self.points.len());
        }
    }

    /// Looks at the clusters where anything shall be judged; whether there was time to.
    fn look_around(&mut self, points: &[Point], is_over: &mut dyn FnMut() -> bool) -> bool {
        let Some(judge) = &mut self.judge else {
            return true;
        };
        if !self.drafts.iter().any(Draft::is_standing) {
            return true;
        }
        if is_over() {
            return false;
        }
        judge.look_around(points);
        true
    }

    /// Unknown objects that are smaller than a road user go, those that are larger and posts stay behind all others, and the others'
    /// scores are multiplied by their looks. A proposal that nobody refined says nothing of the object's size.
    fn judge_unknown(&mut self) {
        for draft in self.drafts.iter_mut().filter(|d| d.is_standing()) {
            let is_refined = draft.flags & Object::UNREFINED == 0;
            let refusal = self.settings.hull.refusal(&draft.shape);
            match (refusal.filter(|_| self.is_sized && is_refined), &self.judge) {
                (Some(Fate::Undersized), _) => draft.fate = Fate::Undersized,
                (Some(_), _) => draft.score *= LOOKS_LIKE_NOTHING,
                (None, Some(judge)) => draft.score *= judge.looks_of(&draft.shape),
                (None, None) => {}
            }
        }
    }

    /// Best score first, until the frame's work or time is used up, or at once when it is `over`.
    fn refine_candidates(
        &mut self,
        sequence: u64,
        detections: &[Detection],
        mut over: bool,
        is_over: &mut dyn FnMut() -> bool,
        out: &mut Refined,
    ) {
        self.order.clear();
        let drafts = &self.drafts;
        self.order
            .extend((0..drafts.len()).filter(|&i| drafts[i].is_standing()));
        self.order.sort_unstable_by(|&a, &b| {
            let key = |i: usize| detections[i].center_m;
            let scores = drafts[b].score.total_cmp(&drafts[a].score);
            let places = || key(a).partial_cmp(&key(b));
            scores
                .then_with(|| places().unwrap_or(std::cmp::Ordering::Equal))
                .then(a.cmp(&b))
        });
        for &index in &self.order {
            let counters = &mut out.counters;
            over = over || counters.work >= self.settings.work_max || is_over();
            if over && (self.candidates.is_needed() || self.judge.is_some()) {
                counters.unrefined += 1;
                self.drafts[index].flags |= Object::UNREFINED;
                continue;
            }
            self.candidates.refine(
                sequence,
                &self.frame,
                &self.is_known,
                &self.recipe,
                &mut self.drafts[index],
                &mut self.points,
                counters,
            );
        }
    }

    /// Published objects get their points first; suppressed ones what room is left.
    fn write_out(&mut self, detections: &[Detection], out: &mut Refined) {
        for (draft, detection) in self.drafts.iter().zip(detections) {
            out.counters.by_fate[draft.fate as usize] += 1;
            out.objects
                .push(draft.object(detection, self.classes.max(1), (0, 0)));
        }
        for published in [true, false] {
            for (draft, object) in self.drafts.iter().zip(&mut out.objects) {
                if (draft.fate == Fate::Published) != published {
                    continue;
                }
                let own = &self.points[draft.points.0..draft.points.1];
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

fn half_diagonal_m(shape: &Box3) -> f64 {
    shape.size_m[0].hypot(shape.size_m[1]) / 2.0
}
