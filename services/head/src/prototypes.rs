//! Distances to the class prototypes and every score that follows from them (paper section 3.2).
//!
//! C known classes; prototype m_t = T e_t, T times the t-th unit vector; f is the embedding of a cell.
//!
//! - d_t = |f - m_t|^2 (squared, as in the public code of the paper's first author)
//! - p = softmax(-d) (eq. 2); the same as softmax(2 T f), since |f|^2 and T^2 cancel
//! - EDS = sum over t of d_t (eq. 5) = C |f - c|^2 + (C - 1) T^2 with the centre c = (T / C) (1, .., 1)
//! - e = EDS / ((C - 1) T^2): 1 at the centre, 2 at a prototype, C / (C - 1) at the origin, for any C and T
//! - e_perp = 1 + C |f - mean f|^2 / ((C - 1) T^2): e without the direction (1, .., 1), on which p does not depend
//! - delta = min d / T^2: 0 at a prototype, (C - 1) / C at the centre; grows on both sides of a prototype, also where f overshoots it
//! - the usual scores: the largest probability, the largest logit 2 T f, energy = log sum exp(2 T f)

use mluc_ipc_types::{CLASSES_MAX, Detection};

/// The prototypes of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prototypes {
    classes: usize,
    scale: f32,
}

impl Prototypes {
    /// `classes` = C, 2 to [`CLASSES_MAX`]; `scale` = T, above 0. A checked manifest satisfies both.
    pub fn new(classes: usize, scale: f32) -> Prototypes {
        assert!((2..=CLASSES_MAX).contains(&classes) && scale > 0.0, "C = {classes}, T = {scale}");
        Prototypes { classes, scale }
    }

    /// d_t for each class; `f` has C values.
    pub fn distances(&self, f: &[f32]) -> [f32; CLASSES_MAX] {
        let mut distances = [0.0; CLASSES_MAX];
        for (t, distance) in distances.iter_mut().enumerate().take(self.classes) {
            let prototype = |i| if i == t { self.scale } else { 0.0 };
            let offsets = f.iter().enumerate().map(|(i, f)| f - prototype(i));
            *distance = offsets.map(|offset| offset.powi(2)).sum();
        }
        distances
    }

    /// Every score of an embedding and the embedding itself (`f`, C values), in the corresponding fields of a detection.
    pub fn scores(&self, f: &[f32]) -> Detection {
        let (c, t) = (self.classes as f32, self.scale);
        let all = self.distances(f);
        let d = &all[..self.classes];
        let unit = (c - 1.0) * t * t;
        let eds: f32 = d.iter().sum();
        let d_min = d.iter().copied().fold(f32::INFINITY, f32::min);

        let mut probabilities = [0.0; CLASSES_MAX];
        probabilities.iter_mut().zip(d).for_each(|(p, d)| *p = (d_min - d).exp());
        let sum: f32 = probabilities.iter().sum();
        probabilities.iter_mut().for_each(|p| *p /= sum);

        let mean = f.iter().sum::<f32>() / c;
        let perpendicular: f32 = f.iter().map(|f| (f - mean).powi(2)).sum();
        let logit_max = 2.0 * t * f.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let exponentials = f.iter().map(|f| (2.0 * t * f - logit_max).exp());
        let energy = logit_max + exponentials.sum::<f32>().ln();
        let mut embedding = [0.0; CLASSES_MAX];
        embedding[..self.classes].copy_from_slice(f);
        Detection {
            probabilities,
            embedding,
            eds,
            eds_normalised: eds / unit,
            eds_perpendicular: 1.0 + c * perpendicular / unit,
            delta: d_min / (t * t),
            softmax_max: probabilities.iter().copied().fold(0.0, f32::max),
            logit_max,
            energy,
            ..Detection::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::formula_uniform;

    fn close(a: f32, b: f32) {
        let tolerance = 1e-4 * (1.0 + a.abs().max(b.abs()));
        assert!((a - b).abs() <= tolerance, "{a} is not {b}");
    }

    /// C and T: T = C as in the paper, and T = 1 and 3 as in the authors' earlier code.
    const SETTINGS: [(usize, f32); 5] = [(3, 1.0), (3, 3.0), (4, 1.0), (4, 3.0), (4, 4.0)];

    #[test]
    fn closed_forms_hold_for_any_embedding() {
        for (number, (classes, t)) in SETTINGS.into_iter().enumerate() {
            let c = classes as f32;
            for sample in 0..20 {
                let uniform = |i| formula_uniform("f", number * 1000 + sample * 10 + i);
                let f: Vec<f32> = (0..classes).map(|i| (uniform(i) * 8.0 - 3.0) as f32).collect();
                let scores = Prototypes::new(classes, t).scores(&f);
                let (squares, sum): (f32, f32) = (f.iter().map(|f| f * f).sum(), f.iter().sum());
                close(scores.eds, c * squares - 2.0 * t * sum + c * t * t);
                let from_centre: f32 = f.iter().map(|f| (f - t / c).powi(2)).sum();
                close(scores.eds, c * from_centre + (c - 1.0) * t * t);
                let away = c * c * (sum / c - t / c).powi(2) / ((c - 1.0) * t * t);
                close(scores.eds_normalised, scores.eds_perpendicular + away);
                let exponentials: f32 = f.iter().map(|f| (2.0 * t * f).exp()).sum();
                for (p, f) in scores.probabilities.iter().zip(&f) {
                    close(*p, (2.0 * t * f).exp() / exponentials);
                }
                close(scores.energy, exponentials.ln());
                close(scores.probabilities.iter().sum(), 1.0);
                close(scores.logit_max - scores.energy, scores.softmax_max.ln());
            }
        }
    }

    #[test]
    fn landmarks_do_not_depend_on_classes_and_scale() {
        for (classes, t) in SETTINGS {
            let c = classes as f32;
            let prototypes = Prototypes::new(classes, t);
            let mut prototype = vec![0.0; classes];
            prototype[1] = t;
            let known = prototypes.scores(&prototype);
            close(known.eds_normalised, 2.0);
            close(known.delta, 0.0);
            let centre = vec![t / c; classes];
            let between_all = prototypes.scores(&centre);
            close(between_all.eds_normalised, 1.0);
            close(between_all.delta, (c - 1.0) / c);
            close(between_all.softmax_max, 1.0 / c);
            let origin = prototypes.scores(&vec![0.0; classes]);
            close(origin.eds_normalised, c / (c - 1.0));
            close(origin.delta, 1.0);
            let mut midpoint = vec![0.0; classes];
            midpoint[..2].fill(t / 2.0);
            let between_two = prototypes.scores(&midpoint);
            let expected = (3.0 * c - 4.0) / (2.0 * (c - 1.0));
            close(between_two.eds_normalised, expected);
            close(between_two.delta, 0.5);
            for a in [0.25, 0.5, 0.75] {
                let pairs = centre.iter().zip(&prototype);
                let f: Vec<f32> = pairs.map(|(c, m)| c + a * (m - c)).collect();
                let scores = prototypes.scores(&f);
                close(scores.eds_normalised, 1.0 + a * a);
                let expected = 1.0 / (1.0 + (c - 1.0) * (-2.0 * t * t * a).exp());
                close(scores.softmax_max, expected);
            }
        }
    }

    #[test]
    fn an_overshooting_embedding_is_known_to_eds_and_far_to_delta() {
        let scores = Prototypes::new(3, 3.0).scores(&[6.0, 0.0, 0.0]);
        let far = (scores.eds_normalised > 2.0, scores.delta > 0.9);
        assert_eq!(far, (true, true), "{scores:?}");
    }

    #[test]
    fn large_embeddings_stay_finite() {
        let scores = Prototypes::new(3, 3.0).scores(&[300.0, -200.0, 0.0]);
        assert_eq!(scores.probabilities[..3], [1.0, 0.0, 0.0]);
        assert!(scores.energy.is_finite() && scores.eds.is_finite());
    }
}
