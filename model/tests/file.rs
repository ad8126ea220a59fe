//! The model file: what is written is read again, and every fault is refused by name.

use std::collections::HashMap;

use mluc_model::{
    Grid, LOOKS, LOOKS_VALUES, Manifest, Model, ModelError, Network, WeightSet, calibrated_layers,
    expected_tensors, formula_weights, model_bytes,
};
use safetensors::tensor::{Dtype, TensorView};

type Fallible = Result<(), Box<dyn std::error::Error>>;

fn fixture() -> (Manifest, WeightSet) {
    let grid = Grid {
        range_min_m: [0.0, -3.2, -3.0],
        range_max_m: [6.4, 3.2, 1.0],
        ..Grid::kitti_compact()
    };
    let manifest = Manifest::untrained("small", Network::compact(grid, 3));
    let weights = formula_weights(&manifest.network);
    (manifest, weights)
}

/// A file that no check of ours has seen.
fn unchecked(json: &str, weights: &WeightSet) -> Result<Vec<u8>, safetensors::SafeTensorError> {
    let bytes: Vec<(String, Vec<usize>, Vec<u8>)> = weights
        .iter()
        .map(|(name, tensor)| {
            (
                name.into(),
                tensor.shape.clone(),
                tensor.data.iter().flat_map(|v| v.to_le_bytes()).collect(),
            )
        })
        .collect();
    let view = |(name, shape, data)| Ok((name, TensorView::new(Dtype::F32, shape, data)?));
    let views: Result<Vec<_>, safetensors::SafeTensorError> = bytes
        .iter()
        .map(|(name, shape, data)| view((name, shape.clone(), data.as_slice())))
        .collect();
    safetensors::serialize(
        views?,
        Some(HashMap::from([("mluc".to_string(), json.to_string())])),
    )
}

fn refused(bytes: &[u8]) -> String {
    Model::from_bytes(bytes)
        .expect_err("the file must be refused")
        .to_string()
}

fn assert_names(error: &str, parts: &[&str]) {
    assert!(
        parts.iter().all(|part| error.contains(part)),
        "`{error}` names {parts:?}"
    );
}

#[test]
fn a_model_comes_back_as_it_was_and_its_bytes_are_reproducible() -> Fallible {
    let (manifest, weights) = fixture();
    let bytes = model_bytes(&manifest, &weights)?;
    assert_eq!(bytes, model_bytes(&manifest, &weights)?);
    let model = Model::from_bytes(&bytes)?;
    assert_eq!((&model.manifest, &model.weights), (&manifest, &weights));
    let mut other = weights.clone();
    other
        .find_mut("head.box.bias")
        .expect("a tensor of the network")
        .data[0] += 1.0;
    assert_ne!(
        Model::from_bytes(&model_bytes(&manifest, &other)?)?.fingerprint,
        model.fingerprint
    );
    Ok(())
}

#[test]
fn a_file_cut_short_anywhere_is_refused() -> Fallible {
    let (manifest, weights) = fixture();
    let bytes = model_bytes(&manifest, &weights)?;
    for length in [0, 7, 8, 100, bytes.len() / 2, bytes.len() - 1] {
        assert_names(
            &refused(&bytes[..length]),
            &[&format!("{length} bytes"), "cut short"],
        );
    }
    Ok(())
}

#[test]
fn a_missing_file_is_named() {
    let error = Model::read("no/such.safetensors".as_ref())
        .expect_err("there is none")
        .to_string();
    assert_names(&error, &["no/such.safetensors"]);
}

#[test]
fn another_format_version_is_said_before_its_fields_are_looked_at() -> Fallible {
    let (_, weights) = fixture();
    let error = refused(&unchecked(r#"{"format": 7, "new_field": 1}"#, &weights)?);
    assert_names(&error, &["format 7", "reads format 1"]);
    assert_names(&refused(&unchecked("{}", &weights)?), &["format none"]);
    Ok(())
}

#[test]
fn a_manifest_that_is_absent_broken_or_has_an_unknown_field_is_refused() -> Fallible {
    let (manifest, weights) = fixture();
    let empty: Vec<(String, TensorView)> = vec![];
    assert_names(
        &refused(&safetensors::serialize(empty, None)?),
        &["no manifest", "`mluc`"],
    );
    assert_names(
        &refused(&unchecked("{", &weights)?),
        &["manifest", "line 1"],
    );
    let json = serde_json::to_string(&manifest)?.replace("\"uses_intensity\"", "\"uses_colour\"");
    assert_names(&refused(&unchecked(&json, &weights)?), &["uses_colour"]);
    Ok(())
}

#[test]
fn a_tensor_missing_extra_misshapen_or_not_finite_is_named() -> Fallible {
    let (manifest, weights) = fixture();
    let json = serde_json::to_string(&manifest)?;
    let with = |change: &dyn Fn(&mut WeightSet)| -> Result<String, Box<dyn std::error::Error>> {
        let mut changed = weights.clone();
        change(&mut changed);
        Ok(refused(&unchecked(&json, &changed)?))
    };
    let error = with(&|w| drop(w.remove("head.embedding.weight")))?;
    assert_names(
        &error,
        &["`head.embedding.weight`", "[3, 128, 1, 1]", "missing"],
    );
    let error = with(&|w| w.insert("head.extra", vec![1], vec![0.0]))?;
    assert_names(&error, &["`head.extra`", "does not belong"]);
    let error = with(&|w| w.insert("head.embedding.bias", vec![4], vec![0.0; 4]))?;
    assert_names(&error, &["`head.embedding.bias`", "[3]", "found [4]"]);
    let nan = |name: &str, value: f32| {
        let name = name.to_string();
        move |w: &mut WeightSet| w.find_mut(&name).expect("a tensor of the network").data[2] = value
    };
    let error = with(&nan("head.embedding.bias", f32::NAN))?;
    assert_names(&error, &["`head.embedding.bias`", "element 2", "NaN"]);
    let error = with(&nan("backbone2d.up1.bn.running_var", -1.0))?;
    assert_names(&error, &["running_var", "not negative", "-1"]);
    let looks = |values: Vec<f32>| {
        move |w: &mut WeightSet| w.insert(LOOKS, vec![values.len()], values.clone())
    };
    let error = with(&looks(vec![0.0; LOOKS_VALUES - 1]))?;
    assert_names(&error, &["`clusters.looks`", "[1025]", "found [1024]"]);
    let error = with(&looks(
        [vec![0.0; LOOKS_VALUES - 1], vec![f32::INFINITY]].concat(),
    ))?;
    assert_names(&error, &["`clusters.looks`", "element 1024", "inf"]);
    let mut judging = weights.clone();
    looks(vec![0.5; LOOKS_VALUES])(&mut judging);
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
    assert_names(&refused(&bytes), &["`head.box.bias`", "F32", "F16"]);
    Ok(())
}

/// The field that the error names, and what makes it wrong.
type Change<'a> = (&'a str, &'a dyn Fn(&mut Manifest));

#[test]
fn every_field_out_of_bounds_is_named_and_nothing_panics() -> Fallible {
    let (manifest, weights) = fixture();
    let changes: [Change; 17] = [
        ("network.grid.voxel_size_m[0]", &|m| {
            m.network.grid.voxel_size_m[0] = 0.0
        }),
        ("network.grid.voxel_size_m[1]", &|m| {
            m.network.grid.voxel_size_m[1] = -0.1
        }),
        ("network.grid.range_max_m[2]", &|m| {
            m.network.grid.range_max_m[2] = -4.0
        }),
        ("network.grid.range_max_m[0]", &|m| {
            m.network.grid.range_max_m[0] = 6.43
        }),
        ("network.grid", &|m| {
            m.network.grid.voxel_size_m = [0.001; 3]
        }),
        ("network.grid.voxels_max", &|m| {
            m.network.grid.voxels_max = u32::MAX
        }),
        ("network.sparse[1].cin", &|m| {
            m.network.sparse[1].cin = usize::MAX
        }),
        ("network.sparse[0].kernel[0]", &|m| {
            m.network.sparse[0].kernel[0] = usize::MAX
        }),
        ("network.block2[0].stride", &|m| {
            m.network.block2[0].stride = 0
        }),
        ("network.up2.cout", &|m| m.network.up2.cout = 32),
        ("network.classes", &|m| m.network.classes = 9),
        ("classes must be 4", &|m| m.network.classes = 4),
        ("classes[1].name", &|m| m.classes[1].name = "car".into()),
        ("classes[0].size_m[2]", &|m| m.classes[0].size_m[2] = 0.0),
        ("prototype_scale", &|m| m.prototype_scale = 0.0),
        ("thresholds.objectness_min", &|m| {
            m.thresholds.objectness_min = 0.0
        }),
        ("thresholds.boxes_max", &|m| m.thresholds.boxes_max = 513),
    ];
    for (field, change) in changes {
        let mut changed = manifest.clone();
        change(&mut changed);
        assert_names(
            &refused(&unchecked(&serde_json::to_string(&changed)?, &weights)?),
            &[field],
        );
        let error =
            model_bytes(&changed, &weights).expect_err("what would be refused is not written");
        assert!(matches!(error, ModelError::Field { .. }), "{error}");
    }
    Ok(())
}

#[test]
fn the_paper_s_network_has_its_published_number_of_parameters() {
    let count = |part: &str, network: &Network| -> usize {
        let tensors = expected_tensors(network);
        let learned = tensors
            .iter()
            .filter(|(name, _)| name.starts_with(part) && !name.contains("running"));
        learned
            .map(|(_, shape)| shape.iter().product::<usize>())
            .sum()
    };
    let second = Network::second(Grid::kitti_second(), 3);
    assert!((700_000..720_000).contains(&count("backbone3d", &second)));
    assert!((4_570_000..4_620_000).contains(&count("backbone2d", &second)));
    let compact = Network::compact(Grid::kitti_compact(), 3);
    assert!(
        (500_000..620_000).contains(&count("", &compact)),
        "{}",
        count("", &compact)
    );
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
    let mut short = weights.clone();
    short.remove(name);
    assert_names(&refused(&unchecked(&json, &short)?), &[name, "missing"]);
    for value in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let mut bad = weights.clone();
        bad.find_mut(name).ok_or(name)?.data[3] = value;
        let parts = [name, "element 3", "above 0"];
        assert_names(&refused(&unchecked(&json, &bad)?), &parts);
    }
    let mut long = weights.clone();
    long.set_range("backbone2d.block2.1", vec![1.0; 97]);
    assert_names(&refused(&unchecked(&json, &long)?), &[name, "[96]", "[97]"]);
    let mut other = weights.clone();
    other.set_range("backbone2d.up1", vec![1.0; 64]);
    let parts = ["calibration.backbone2d.up1", "does not belong"];
    assert_names(&refused(&unchecked(&json, &other)?), &parts);

    weights.remove_calibration(&manifest.network);
    assert_eq!(weights, fixture().1);
    Ok(())
}
