//! The learned part of OSIS: embeddings of points, and whether they belong to a known object, to the background, or to the unknown.

use crate::Result;
use mluc_backbone::Backbone;
use mluc_evaluate::EvaluateError;
use mluc_ipc_types::Point;
use mluc_model::Model;
use mluc_train::embedding::{FrameFeatures, PointEmbedding, WIDTH, means};
use std::{collections::BTreeMap, sync::Mutex, sync::PoisonError};

/// A point is background where that is more likely than anything else by this factor.
const MARGIN: f32 = 1.0;

/// A point that represents its cube.
pub(super) struct Standing {
    pub(super) at_m: [f32; 3],
    /// The largest class probability of a box around it; 0 outside all boxes.
    pub(super) known: f32,
    /// Index of that box.
    pub(super) inside: Option<usize>,
    /// Empty without a learned embedding.
    pub(super) embedding: Vec<f32>,
}

pub(super) struct Embedder<'a> {
    model: &'a Model,
    embedding: PointEmbedding,
    backbone: Mutex<Backbone>,
}

impl Embedder<'_> {
    pub(super) fn new(model: &Model) -> Result<Embedder<'_>> {
        let manifest = &model.manifest;
        let channels = manifest.network.feature_channels();
        let embedding = PointEmbedding::read(&model.weights, channels).ok_or_else(|| {
            let reason =
                "osis: expected a model with a point embedding, found none; osis-geo needs none";
            EvaluateError::Input(reason.into())
        })?;
        let backbone = Backbone::new(manifest, &model.weights)?;
        Ok(Embedder { model, embedding, backbone: Mutex::new(backbone) })
    }

    /// Sets the embedding of every point; removes points outside the map.
    pub(super) fn embed(&self, points: &[Point], standing: &mut Vec<Standing>) -> Result<()> {
        let (cells, rows) = {
            let mut backbone = self.backbone.lock().unwrap_or_else(PoisonError::into_inner);
            backbone.run(bytemuck::cast_slice(points));
            backbone.last_rows()?
        };
        let features = FrameFeatures::new(&self.model.manifest, &cells, &rows);
        let mut input = vec![];
        standing.retain(|s| features.append(s.at_m, &mut input));
        let trace = self.embedding.mlp.forward(input);
        for (point, phi) in standing.iter_mut().zip(trace.output().chunks_exact(WIDTH)) {
            point.embedding = phi.to_vec();
        }
        Ok(())
    }

    /// P(unknown) of each of the points `left`, given the prototypes of the known boxes; `None` for background.
    pub(super) fn unknown(
        &self,
        all: &[Standing],
        left: &[&Standing],
        threshold: f32,
    ) -> Vec<Option<f32>> {
        let mut number: BTreeMap<usize, usize> = BTreeMap::new();
        let kept = all.iter().filter(|s| s.known >= threshold && s.known > 0.0);
        let (mut values, mut owner) = (vec![], vec![]);
        for (point, inside) in kept.filter_map(|s| Some((s, s.inside?))) {
            let next = number.len();
            owner.push(Some(*number.entry(inside).or_insert(next)));
            values.extend_from_slice(&point.embedding);
        }
        let (prototypes, _) = means(&values, &owner, number.len());
        let of = |point: &&Standing| {
            let p = self.embedding.associate(&point.embedding, &prototypes);
            let (background, unknown) = (p[p.len() - 2], p[p.len() - 1]);
            let others = p.iter().copied().filter(|v| *v != background).fold(0.0, f32::max);
            (background <= MARGIN * others).then_some(unknown)
        };
        left.iter().map(of).collect()
    }
}
