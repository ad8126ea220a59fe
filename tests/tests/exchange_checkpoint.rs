//! `mluc-lab import` and `export`: checkpoints of every format and layout give the same weights, exports come back bit by
//! bit, and files that are damaged or want to run code are refused by name.

#[path = "exchange_support/mod.rs"]
mod support;

use mluc_lab::exchange::{
    ExchangeError, ImportRequest, SparseLayout, export, import, tensor_names,
};
use mluc_model::{
    Grid, HeadKind, Manifest, Model, Network, Tensor, WeightSet, formula_weights, model_bytes,
};
use support::{Entry, Pickle, archive, legacy, weights};

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

fn second() -> Network {
    Network {
        head: HeadKind::Sigmoid,
        ..Network::second(Grid::kitti_second(), 3)
    }
}

/// The state_dict of a network, sparse weights in `layout`.
fn entries(network: &Network, weights: &WeightSet, layout: SparseLayout) -> Fallible<Vec<Entry>> {
    let entry = |(ours, theirs, shape): (String, String, Vec<usize>)| {
        let data = weights.get(&ours, &shape)?.to_vec();
        let tensor = match <[usize; 5]>::try_from(shape.clone()) {
            Ok(ours) => from_ours(&data, ours, layout),
            Err(_) => Tensor { shape, data },
        };
        Ok((theirs, tensor))
    };
    tensor_names(network).into_iter().map(entry).collect()
}

/// The inverse of what the importer does, written the other way round: by walking the layout's own order.
fn from_ours(data: &[f32], ours: [usize; 5], layout: SparseLayout) -> Tensor {
    let [out, z, y, x, cin] = ours;
    let taps = z * y * x;
    let mut turned = vec![];
    for a in 0..taps {
        match layout {
            SparseLayout::OutTapsIn => {}
            SparseLayout::TapsInOut => {
                for i in 0..cin {
                    turned.extend((0..out).map(|o| data[(o * taps + a) * cin + i]));
                }
            }
            SparseLayout::TapsOutIn => {
                for o in 0..out {
                    turned.extend((0..cin).map(|i| data[(o * taps + a) * cin + i]));
                }
            }
        }
    }
    Tensor {
        shape: layout.shape(ours).to_vec(),
        data: if turned.is_empty() {
            data.to_vec()
        } else {
            turned
        },
    }
}

#[test]
fn every_layout_and_format_gives_the_same_weights() -> Fallible {
    let network = second();
    let expected = weights(&network);
    for layout in SparseLayout::ALL {
        let entries = entries(&network, &expected, layout)?;
        let pickle = Pickle::checkpoint(&entries);
        for file in [archive(&pickle, &entries), legacy(&pickle, &entries)] {
            let imported = import(&file, &ImportRequest::kitti())?;
            assert_eq!(imported.layout, layout);
            assert!(imported.weights == expected, "{layout:?}: weights differ");
            let manifest = imported.manifest;
            assert_eq!(manifest.network, network);
            let anchors = manifest
                .classes
                .iter()
                .map(|c| (c.name.as_str(), c.bottom_z_m));
            let expected = [("car", -1.78), ("pedestrian", -0.6), ("cyclist", -0.6)];
            assert!(anchors.eq(expected));
            assert!(manifest.empty_objectness_max < 0.01);
        }
    }
    Ok(())
}

#[test]
fn an_export_comes_back_bit_by_bit() -> Fallible {
    let udi = Network::compact(Grid::udi(), 4).with_reach_of_trucks();
    for network in [second(), Network::compact(Grid::kitti_compact(), 3), udi] {
        let weights = formula_weights(&network);
        let bytes = model_bytes(&Manifest::untrained("a name", network), &weights)?;
        comes_back(&bytes)?;
    }
    for setting in ["kitti", "udi"] {
        let path = format!(
            "{}/../weights/{setting}.safetensors",
            env!("CARGO_MANIFEST_DIR")
        );
        comes_back(&std::fs::read(path)?)?;
    }
    Ok(())
}

/// The same model gives the same bytes; a file may have been written by an older version.
fn comes_back(bytes: &[u8]) -> Fallible {
    let model = Model::from_bytes(bytes)?;
    let request = ImportRequest {
        name: "not used".into(),
        ..ImportRequest::kitti()
    };
    let imported = import(&export(&model)?, &request)?;
    let expected = model_bytes(&model.manifest, &model.weights)?;
    assert!(model_bytes(&imported.manifest, &imported.weights)? == expected);
    Ok(())
}

#[test]
fn an_export_without_our_manifest_is_read_as_a_checkpoint() -> Fallible {
    let network = second();
    let expected = weights(&network);
    let mut theirs = WeightSet::new();
    for (name, tensor) in entries(&network, &expected, SparseLayout::OutTapsIn)? {
        theirs.insert(name, tensor.shape, tensor.data);
    }
    let file = safetensors::serialize(theirs.iter(), None)?;
    assert!(import(&file, &ImportRequest::kitti())?.weights == expected);
    Ok(())
}

fn refused(file: &[u8]) -> String {
    match import(file, &ImportRequest::kitti()) {
        Ok(_) => panic!("the file was taken"),
        Err(error) => error.to_string(),
    }
}

/// A small checkpoint, and its file.
fn small() -> (Vec<Entry>, Pickle) {
    let tensor = Tensor {
        shape: vec![2, 3],
        data: vec![0.5; 6],
    };
    let entries = vec![("backbone_3d.conv_input.0.weight".to_owned(), tensor)];
    let pickle = Pickle::checkpoint(&entries);
    (entries, pickle)
}

#[test]
fn a_pickle_that_calls_anything_else_is_refused_by_name() {
    for (module, name) in [
        ("posix", "system"),
        ("builtins", "eval"),
        ("torch", "load"),
        ("torch._utils", "_rebuild_parameter"),
        ("numpy", "load"),
    ] {
        let mut pickle = Pickle::new();
        pickle.raw(format!("c{module}\n{name}\n(").as_bytes());
        pickle.text("touch /tmp/run-by-a-pickle").raw(b"tR.");
        for file in [archive(&pickle, &[]), legacy(&pickle, &[])] {
            let error = refused(&file);
            assert!(error.contains(&format!("`{module}.{name}`")), "{error}");
        }
    }
    let mut pickle = Pickle::new();
    pickle.raw(b"(U\x04spam.");
    let error = refused(&archive(&pickle, &[]));
    assert!(error.contains("opcode 'U'"), "{error}");
}

#[test]
fn what_is_missing_or_too_much_or_of_another_shape_is_named() -> Fallible {
    let network = second();
    let whole = entries(&network, &weights(&network), SparseLayout::OutTapsIn)?;
    let attempt = |change: &dyn Fn(&mut Vec<Entry>)| {
        let mut changed = whole.clone();
        change(&mut changed);
        refused(&archive(&Pickle::checkpoint(&changed), &changed))
    };
    let error = attempt(&|entries| {
        entries.pop();
    });
    assert!(
        error.contains("`dense_head.conv_dir_cls.bias` of shape [12]"),
        "{error}"
    );
    let error = attempt(&|entries| {
        let extra = Tensor {
            shape: vec![1],
            data: vec![0.0],
        };
        entries.push(("point_head.weight".into(), extra));
    });
    assert!(error.contains("`point_head.weight`"), "{error}");
    let error = attempt(&|entries| {
        for (name, tensor) in entries {
            if name == "dense_head.conv_cls.bias" {
                *tensor = Tensor {
                    shape: vec![6],
                    data: vec![0.0; 6],
                };
            }
        }
    });
    assert!(error.contains("expected shape [18], found [6]"), "{error}");
    let error = attempt(&|entries| entries[0].1.shape.swap(0, 1));
    assert!(
        error.contains("`backbone_3d.conv_input.0.weight`"),
        "{error}"
    );
    let error = attempt(&|entries| entries[0].1.data[5] = f32::NAN);
    assert!(error.contains("element 5"), "{error}");
    Ok(())
}

#[test]
fn a_network_that_sees_things_in_an_empty_scene_is_refused() -> Fallible {
    let network = second();
    let loud = formula_weights(&network);
    let entries = entries(&network, &loud, SparseLayout::OutTapsIn)?;
    let error = refused(&archive(&Pickle::checkpoint(&entries), &entries));
    assert!(error.contains("empty scene"), "{error}");
    Ok(())
}

#[test]
fn files_of_any_length_and_with_any_byte_changed_are_refused() {
    let (entries, pickle) = small();
    for file in [archive(&pickle, &entries), legacy(&pickle, &entries)] {
        assert!(
            refused(&file).contains("is missing"),
            "the whole file is read"
        );
        for length in 0..file.len() {
            refused(&file[..length]);
        }
        for place in 0..file.len() {
            for flip in [0x01, 0x80, 0xFF] {
                let mut changed = file.clone();
                changed[place] ^= flip;
                refused(&changed);
            }
        }
    }
    assert!(refused(b"").contains("found 0 bytes"));
    assert!(refused(&[0xFF; 64]).contains("a PyTorch checkpoint"));
}

#[test]
fn a_small_file_cannot_ask_for_much_memory() {
    let mut pickle = Pickle::new();
    pickle.raw(b"}(").text("model_state").raw(b"}(");
    pickle.text("w").tensor("FloatStorage", 0, &[1 << 30]);
    pickle.raw(b"uu.");
    let tensor = Tensor {
        shape: vec![1],
        data: vec![1.0],
    };
    let file = archive(&pickle, &[("w".into(), tensor)]);
    match import(&file, &ImportRequest::kitti()) {
        Err(ExchangeError::Tensor { tensor, .. }) => assert_eq!(tensor, "w"),
        other => panic!("{other:?}"),
    }
}
