//! `mluc-lab import` and `export`: checkpoints of every layout give the same weights, exports return bit by bit, and
//! damaged files and PyTorch files are refused with a message that names the expected content.

use crate::Folder;
use mluc_lab::exchange::{self, SparseLayout, anchor, export, import, tensor_names};
use mluc_model::{Grid, Manifest, Model, Network, Tensor, WeightSet, formula_weights, model_bytes};
use std::collections::BTreeMap;

type Fallible<T = ()> = anyhow::Result<T>;
/// Tensors by their names in OpenPCDet.
type Entries = BTreeMap<String, Tensor>;

/// The model as OpenPCDet configures it for KITTI.
pub(crate) fn on_kitti() -> Manifest {
    let classes = ["car", "pedestrian", "cyclist"].map(|class| anchor(class).expect("known"));
    exchange::second("kitti", classes.into())
}

fn second() -> Network {
    on_kitti().network
}

/// Weights by formula that give no detection in an empty scene.
fn weights(network: &Network) -> WeightSet {
    let mut weights = formula_weights(network);
    if let Some(bias) = weights.find_mut("head.class.bias") {
        bias.data.fill(-30.0);
    }
    weights
}

/// The state_dict of a network, with sparse weights in `layout`.
fn entries(network: &Network, weights: &WeightSet, layout: SparseLayout) -> Fallible<Entries> {
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

/// The inverse of the importer's conversion, implemented in another way: it walks the layout's own order.
fn from_ours(data: &[f32], ours: [usize; 5], layout: SparseLayout) -> Tensor {
    let [out, z, y, x, cin] = ours;
    let taps = z * y * x;
    let place = |n: usize| match layout {
        SparseLayout::OutTapsIn => n,
        SparseLayout::TapsInOut => n % out * taps * cin + n / out,
        SparseLayout::TapsOutIn => (n / cin % out * taps + n / cin / out) * cin + n % cin,
    };
    Tensor {
        shape: layout.shape(ours).to_vec(),
        data: (0..data.len()).map(|n| data[place(n)]).collect(),
    }
}

/// A safetensors file without our manifest.
fn file(entries: &Entries) -> Vec<u8> {
    safetensors::serialize(entries, None).expect("a file")
}

#[test]
fn every_layout_gives_the_same_weights() -> Fallible {
    let network = second();
    let expected = weights(&network);
    for layout in SparseLayout::ALL {
        let file = file(&entries(&network, &expected, layout)?);
        let imported = import(&file, on_kitti())?;
        assert_eq!(imported.layout, layout);
        assert!(imported.weights == expected, "{layout:?}: weights differ");
        let manifest = imported.manifest;
        assert_eq!(manifest.network, network);
        let anchors = manifest.classes.iter().map(|class| (class.name.as_str(), class.bottom_z_m));
        assert!(anchors.eq([("car", -1.78), ("pedestrian", -0.6), ("cyclist", -0.6)]));
        assert!(manifest.empty_objectness_max < 0.01);
    }
    Ok(())
}

#[test]
fn an_export_comes_back_bit_by_bit() -> Fallible {
    let udi = Network::compact(Grid::udi(), 4).with_reach_of_trucks();
    for network in [second(), Network::compact(Grid::kitti_compact(), 3), udi] {
        let mut weights = formula_weights(&network);
        weights.insert("baseline.osis.a", vec![1], vec![0.5]);
        let bytes = model_bytes(&Manifest::untrained("a name", network), &weights)?;
        comes_back(&bytes)?;
    }
    // The file may be from an older version.
    let older = include_bytes!("../../../../weights/paper/kitti.safetensors");
    comes_back(older)
}

/// Checks that the same model gives the same bytes.
fn comes_back(bytes: &[u8]) -> Fallible {
    let model = Model::from_bytes(bytes)?;
    let imported = import(&export(&model)?, on_kitti())?;
    let expected = model_bytes(&model.manifest, &model.weights)?;
    assert!(model_bytes(&imported.manifest, &imported.weights)? == expected);
    Ok(())
}

fn refused(file: &[u8]) -> String {
    match import(file, on_kitti()) {
        Ok(_) => panic!("the file was taken"),
        Err(error) => format!("{error:#}"),
    }
}

#[test]
fn what_is_missing_or_too_much_or_of_another_shape_is_named() -> Fallible {
    let network = second();
    let whole = entries(&network, &weights(&network), SparseLayout::OutTapsIn)?;
    let zeros = |count: usize| Tensor { shape: vec![count], data: vec![0.0; count] };
    let first = "backbone_3d.conv_input.0.weight";
    let [mut turned, mut broken] = [(); 2].map(|()| whole[first].clone());
    turned.shape.rotate_left(1);
    broken.data[5] = f32::NAN;
    let (direction, class) = ("dense_head.conv_dir_cls.bias", "dense_head.conv_cls.bias");
    let missing = "`dense_head.conv_dir_cls.bias` of shape [12]";
    let no_order = "every sparse layer in the same of these orders";
    let cases = [
        (direction, None, missing),
        ("point_head.weight", Some(zeros(1)), "`point_head.weight`"),
        (class, Some(zeros(6)), "expected shape [18], found [6]"),
        // In spconv 1's order: no layout fits all layers.
        (first, Some(turned), no_order),
        (first, Some(broken), "element 5"),
    ];
    for (name, tensor, words) in cases {
        let mut changed = whole.clone();
        changed.remove(name);
        changed.extend(tensor.map(|tensor| (name.into(), tensor)));
        let error = refused(&file(&changed));
        assert!(error.contains(words), "{error}");
    }
    Ok(())
}

#[test]
fn a_network_that_sees_things_in_an_empty_scene_is_refused() -> Fallible {
    let network = second();
    let loud = formula_weights(&network);
    let error = refused(&file(&entries(&network, &loud, SparseLayout::OutTapsIn)?));
    assert!(error.contains("empty scene"), "{error}");
    Ok(())
}

#[test]
fn files_of_any_length_and_with_any_byte_changed_are_refused() {
    let tensor = Tensor { shape: vec![2, 3], data: vec![0.5; 6] };
    let name = "backbone_3d.conv_input.0.weight".to_owned();
    let file = file(&BTreeMap::from([(name, tensor)]));
    let whole = refused(&file);
    assert!(whole.contains("is missing"), "it was read whole");
    for length in 0..file.len() {
        assert_ne!(refused(&file[..length]), whole, "{length}");
    }
    for place in 0..file.len() {
        for flip in [0x01, 0x80, 0xFF] {
            let mut changed = file.clone();
            changed[place] ^= flip;
            refused(&changed);
        }
    }
    assert!(refused(b"").contains("found 0 bytes"));
}

#[test]
fn a_file_of_pytorch_is_sent_to_the_tool() {
    let folder = Folder::new();
    for head in [&b"PK\x03\x04 a zip archive"[..], b"\x80\x02\x8a\x0a a pickle"] {
        folder.write("second.pth", head);
        let words = ["second.pth", "tools/checkpoint_to_safetensors.py"];
        let import = "import --checkpoint second.pth --out never.safetensors";
        folder.refuses(import, &words);
    }
}
