//! The model file: what is written can be read again, and every fault is refused with its name.

use mluc_model::{
    CLUSTER_SCORER, CLUSTER_SCORER_VALUES, Grid, Manifest, Model, ModelError, Network,
    Probabilities, RangeBand, WeightSet, calibrated_layers, expected_tensors, formula_weights,
    model_bytes,
};
use safetensors::tensor::{Dtype, TensorView};
use serde_json::Value;
use std::collections::HashMap;

type Fallible = Result<(), Box<dyn std::error::Error>>;

fn fixture() -> (Manifest, WeightSet) {
    let grid = Grid::kitti_compact().within([0.0, 6.4], [-3.2, 3.2]);
    let manifest = Manifest::untrained("small", Network::compact(grid, 3));
    let weights = formula_weights(&manifest.network);
    (manifest, weights)
}

/// A file that our checks have not seen.
fn unchecked(json: impl ToString, weights: &WeightSet) -> Vec<u8> {
    let metadata = HashMap::from([("mluc".to_string(), json.to_string())]);
    safetensors::serialize(weights.iter(), Some(metadata)).expect("a file")
}

/// The file must be refused, and the error must have all `parts`.
fn assert_refused(bytes: &[u8], parts: &[&str]) {
    let error = Model::from_bytes(bytes).expect_err("the file must be refused");
    let error = error.to_string();
    assert!(parts.iter().all(|part| error.contains(part)), "`{error}` names {parts:?}");
}

#[test]
fn a_model_comes_back_as_it_was_and_its_bytes_are_reproducible() -> Fallible {
    let (manifest, weights) = fixture();
    let bytes = model_bytes(&manifest, &weights)?;
    assert_eq!(bytes, model_bytes(&manifest, &weights)?);
    let model = Model::from_bytes(&bytes)?;
    assert_eq!((&model.manifest, &model.weights), (&manifest, &weights));
    let mut other = weights.clone();
    other.find_mut("head.box.bias").ok_or("a tensor")?.data[0] += 1.0;
    let other = Model::from_bytes(&model_bytes(&manifest, &other)?)?;
    assert_ne!(other.fingerprint, model.fingerprint);
    Ok(())
}

#[test]
fn a_file_that_is_absent_cut_short_or_of_another_format_is_refused() -> Fallible {
    let (manifest, weights) = fixture();
    let error = Model::read("no/such.safetensors".as_ref()).expect_err("there is none");
    assert!(error.to_string().contains("no/such.safetensors"), "{error}");
    let bytes = model_bytes(&manifest, &weights)?;
    for length in [0, 7, 8, 100, bytes.len() / 2, bytes.len() - 1] {
        let said = format!("{length} bytes");
        assert_refused(&bytes[..length], &[&said, "cut short"]);
    }
    let empty: Vec<(String, TensorView)> = vec![];
    let empty = safetensors::serialize(empty, None)?;
    assert_refused(&empty, &["no manifest", "`mluc`"]);
    assert_refused(&unchecked("{", &weights), &["manifest", "line 1"]);
    assert_refused(&unchecked("{}", &weights), &["format none"]);
    // The format is reported before its fields are read.
    let other = unchecked(r#"{"format": 7, "new_field": 1}"#, &weights);
    assert_refused(&other, &["format 7", "reads format 1"]);
    let json = serde_json::to_string(&manifest)?.replace("uses_intensity", "uses_colour");
    assert_refused(&unchecked(json, &weights), &["uses_colour"]);
    Ok(())
}

#[test]
fn a_tensor_missing_extra_misshapen_or_not_finite_is_named() -> Fallible {
    let (manifest, weights) = fixture();
    let json = serde_json::to_string(&manifest)?;
    let refused = |change: &dyn Fn(&mut WeightSet), parts: &[&str]| {
        let mut changed = weights.clone();
        change(&mut changed);
        assert_refused(&unchecked(&json, &changed), parts);
    };
    let (weight, bias) = ("head.embedding.weight", "head.embedding.bias");
    let parts = [weight, "[3, 128, 1, 1]", "missing"];
    refused(&|w| drop(w.remove(weight)), &parts);
    let extra = |w: &mut WeightSet| w.insert("head.extra", vec![1], vec![0.0]);
    refused(&extra, &["`head.extra`", "does not belong"]);
    let long = |w: &mut WeightSet| w.insert(bias, vec![4], vec![0.0; 4]);
    refused(&long, &[bias, "[3]", "found [4]"]);
    let spoil = |name: &'static str, value: f32| {
        move |w: &mut WeightSet| w.find_mut(name).expect("a tensor").data[2] = value
    };
    refused(&spoil(bias, f32::NAN), &[bias, "element 2", "NaN"]);
    let variance = "backbone2d.up1.bn.running_var";
    refused(&spoil(variance, -1.0), &[variance, "not negative", "-1"]);

    let looks = |values: Vec<f32>| {
        move |w: &mut WeightSet| w.insert(CLUSTER_SCORER, vec![values.len()], values.clone())
    };
    let short = looks(vec![0.0; CLUSTER_SCORER_VALUES - 1]);
    refused(&short, &["`clusters.looks`", "[1025]", "found [1024]"]);
    let infinite = [vec![0.0; CLUSTER_SCORER_VALUES - 1], vec![f32::INFINITY]].concat();
    let parts = ["`clusters.looks`", "element 1024", "inf"];
    refused(&looks(infinite), &parts);
    let mut judging = weights.clone();
    looks(vec![0.5; CLUSTER_SCORER_VALUES])(&mut judging);
    let model = Model::from_bytes(&model_bytes(&manifest, &judging)?)?;
    assert_eq!(model.weights, judging);
    Ok(())
}

#[test]
fn a_tensor_of_another_type_is_named() -> Fallible {
    let (manifest, _) = fixture();
    let view = TensorView::new(Dtype::F16, vec![1], &[0, 0])?;
    let metadata = HashMap::from([("mluc".to_string(), serde_json::to_string(&manifest)?)]);
    let bytes = safetensors::serialize([("head.box.bias", view)], Some(metadata))?;
    assert_refused(&bytes, &["`head.box.bias`", "F32", "F16"]);
    Ok(())
}

#[test]
fn every_field_out_of_bounds_is_named_and_nothing_panics() -> Fallible {
    let (mut manifest, weights) = fixture();
    // These fields are left out of a file if they are absent.
    manifest.network.halo_layers = Some(manifest.network.block1.len() + 1);
    manifest.network.sparse[1].floor = true;
    let sound = serde_json::to_value(&manifest)?;
    // A field, its wrong value (for an object: the fields that change), and the name in the error if it is not the field.
    let cases: Vec<(&str, Value, &str)> = serde_json::from_str(include_str!("out_of_bounds.json"))?;
    for (field, value, named) in cases {
        let pointer = field.replace(['.', '['], "/").replace(']', "");
        let mut changed = sound.clone();
        let place = changed.pointer_mut(&format!("/{pointer}"));
        match (place.ok_or(field)?, value) {
            (Value::Object(fields), Value::Object(other)) => fields.extend(other),
            (place, value) => *place = value,
        }
        let named = if named.is_empty() { field } else { named };
        assert_refused(&unchecked(&changed, &weights), &[named]);
        let error = model_bytes(&serde_json::from_value(changed)?, &weights);
        assert!(matches!(error, Err(ModelError::Field(..))), "{field}");
    }
    Ok(())
}

#[test]
fn probabilities_rise_along_lines_in_each_band_of_ranges_or_are_refused() -> Fallible {
    let (mut manifest, weights) = fixture();
    let band = |range_min_m, steps: &[[f32; 2]]| RangeBand { range_min_m, steps: steps.to_vec() };
    let bands =
        vec![band(0.0, &[[0.25, 0.125], [0.5, 0.375]]), band(20.0, &[[0.5, 0.0], [0.5, 1.0]])];
    let told = Probabilities { unknown: bands, known: vec![] };
    for (range_m, score, expected) in [
        (3.0, 0.0, 0.125),
        (3.0, 0.25, 0.125),
        (19.0, 0.375, 0.25),
        (3.0, 9.0, 0.375),
        (20.0, 0.49, 0.0),
        (900.0, 0.5, 1.0),
    ] {
        assert_eq!(told.of(false, range_m, score), Some(expected), "{score}");
    }
    assert_eq!(told.of(true, 3.0, 0.5), None);
    manifest.thresholds.probabilities = Some(told.clone());
    let model = Model::from_bytes(&model_bytes(&manifest, &weights)?)?;
    assert_eq!(model.manifest.thresholds.probabilities, Some(told));
    let wrong = [
        (band(19.0, &[[0.5, 0.5]]), "unknown[2].range_min_m"),
        (band(30.0, &[]), "unknown[2].steps"),
        (band(30.0, &[[0.5, 0.5], [0.4, 0.6]]), "unknown[2].steps[1][0]"),
        (band(30.0, &[[0.5, 0.5], [0.6, 0.4]]), "unknown[2].steps[1][1]"),
        (band(30.0, &[[0.5, 1.1]]), "unknown[2].steps[0][1]"),
        (band(30.0, &[[f32::NAN, 0.5]]), "unknown[2].steps[0][0]"),
    ];
    for (band, field) in wrong {
        let mut manifest = manifest.clone();
        manifest.thresholds.probabilities.as_mut().ok_or(field)?.unknown.push(band);
        let error = model_bytes(&manifest, &weights).expect_err(field);
        assert!(error.to_string().contains(field), "{error}");
    }
    Ok(())
}

#[test]
fn the_paper_s_network_has_its_published_number_of_parameters() {
    let count = |part: &str, network: &Network| -> usize {
        let mut tensors = expected_tensors(network);
        tensors.retain(|(name, _)| name.starts_with(part) && !name.contains("running"));
        tensors.iter().map(|(_, shape)| shape.iter().product::<usize>()).sum()
    };
    let second = Network::second(Grid::kitti_second(), 3);
    assert!((700_000..720_000).contains(&count("backbone3d", &second)));
    assert!((4_570_000..4_620_000).contains(&count("backbone2d", &second)));
    let compact = Network::compact(Grid::kitti_compact(), 3);
    let parameters = count("", &compact);
    assert!((500_000..620_000).contains(&parameters), "{parameters}");
}

#[test]
fn a_calibration_comes_back_whole_or_is_refused() -> Fallible {
    let (mut manifest, mut weights) = fixture();
    assert!(!weights.is_calibrated());
    manifest.provenance.calibration = "by hand".into();
    for (layer, channels) in calibrated_layers(&manifest.network) {
        weights.set_range(&layer, (1..=channels).map(|i| 0.5 * i as f32).collect());
    }
    let model = Model::from_bytes(&model_bytes(&manifest, &weights)?)?;
    assert!(model.weights.is_calibrated());
    assert_eq!(model.weights.range("backbone3d.conv_out", 48)?[47], 24.0);
    assert_eq!(model.manifest, manifest);

    let json = serde_json::to_string(&manifest)?;
    let name = "calibration.backbone2d.block2.1";
    let refused = |change: &dyn Fn(&mut WeightSet), parts: &[&str]| {
        let mut changed = weights.clone();
        change(&mut changed);
        assert_refused(&unchecked(&json, &changed), parts);
    };
    refused(&|w| drop(w.remove(name)), &[name, "missing"]);
    for value in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let spoil = |w: &mut WeightSet| w.find_mut(name).expect("a range").data[3] = value;
        refused(&spoil, &[name, "element 3", "above 0"]);
    }
    let long = |w: &mut WeightSet| w.set_range("backbone2d.block2.1", vec![1.0; 97]);
    refused(&long, &[name, "[96]", "[97]"]);
    let other = |w: &mut WeightSet| w.set_range("backbone2d.up1", vec![1.0; 64]);
    refused(&other, &["calibration.backbone2d.up1", "does not belong"]);

    weights.remove_calibration(&manifest.network);
    assert_eq!(weights, fixture().1);
    Ok(())
}
