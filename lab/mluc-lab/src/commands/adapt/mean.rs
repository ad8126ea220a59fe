//! The mean of two networks: after a short training it is often better than either of them, also on other data (Wortsman et al. 2022).

use mluc_model::{CLUSTER_SCORER, Model};

/// Moves a trained network half the way back to the network that the training began with: weights and anchors. The cluster scorer stays the trained one.
/// Returns false, and changes nothing, if the two have other classes or layers.
pub(super) fn move_half_way(trained: &mut Model, first: &Model) -> bool {
    let own = trained.weights.iter().filter(|(name, _)| *name != CLUSTER_SCORER);
    let means = own.map(|(name, tensor)| {
        let other = first.weights.get(name, &tensor.shape).ok()?;
        let mean = tensor.data.iter().zip(other).map(|(a, b)| (a + b) / 2.0);
        Some((name.to_owned(), tensor.shape.clone(), mean.collect()))
    });
    let means: Option<Vec<_>> = means.collect();
    let are_alike = trained.manifest.class_names() == first.manifest.class_names();
    let Some(means) = means.filter(|_| are_alike) else {
        return false;
    };
    for (name, shape, data) in means {
        trained.weights.insert(name, shape, data);
    }
    let (own, other) = (&mut trained.manifest, &first.manifest);
    let others = other.classes.iter().chain(&other.generic);
    for (own, other) in own.classes.iter_mut().chain(&mut own.generic).zip(others) {
        own.size_m = std::array::from_fn(|i| (own.size_m[i] + other.size_m[i]) / 2.0);
        own.bottom_z_m = (own.bottom_z_m + other.bottom_z_m) / 2.0;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_lies_half_way_between_networks_of_the_same_classes() {
        let first = Model::from_bytes(super::super::ANY_OPEN).expect("a model");
        let mut trained = first.clone();
        let bias = trained.weights.iter().map(|(name, _)| name.to_owned());
        let name = bias.last().expect("a tensor");
        trained.weights.find_mut(&name).expect("it").data[0] += 2.0;
        trained.manifest.classes[0].size_m[1] += 1.0;
        let value = |model: &Model| {
            let weight = model.weights.find(&name).expect("it").data[0];
            [weight, model.manifest.classes[0].size_m[1]]
        };
        assert!(move_half_way(&mut trained, &first));
        let moved = [0, 1].map(|i| value(&trained)[i] - value(&first)[i]);
        assert!((moved[0] - 1.0).abs() + (moved[1] - 0.5).abs() < 1e-5, "{moved:?}");
        trained.manifest.classes.swap(0, 1);
        let before = trained.clone();
        assert!(!move_half_way(&mut trained, &first));
        assert_eq!(value(&trained), value(&before));
    }
}
