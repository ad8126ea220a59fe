//! `mluc-lab import`: converts weights of other programs to a model file.

use super::terminal::{print_err, write_out};
use anyhow::{Context, bail};
use clap::Args;
use mluc_lab::exchange::{self, import, second};
use mluc_model::{AnchorClass, Manifest, model_bytes};
use std::path::PathBuf;

/// Turn a checkpoint of OpenPCDet's SECOND into a model file with its closed-set head.
///
/// The checkpoint is a safetensors file: tools/checkpoint_to_safetensors.py makes it of a PyTorch file. Weights of spconv
/// 1 and 2 are read; what `mluc-lab export` wrote comes back as it was. The network must be SECOND on KITTI's range
/// (second.yaml); its classes and anchors are not in the checkpoint: name the classes in the order of its configuration.
#[derive(Args)]
pub(crate) struct ImportArguments {
    /// The checkpoint.
    #[arg(long, value_name = "FILE.safetensors")]
    checkpoint: PathBuf,
    /// The model file to be written.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Classes in the order of the checkpoint's configuration.
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..", value_parser = lower)]
    #[arg(default_value = "car,pedestrian,cyclist")]
    classes: Vec<String>,
    /// Anchor of a class, m; bottom is its z in the sensor frame. Those of OpenPCDet's KITTI configurations are known.
    #[arg(long, value_parser = anchor, value_name = "CLASS=LENGTH,WIDTH,HEIGHT,BOTTOM")]
    anchor: Vec<AnchorClass>,
    /// Boxes below this score are not reported.
    #[arg(long, default_value_t = 0.1)]
    score_min: f32,
}

/// OpenPCDet writes `Car`; a model file has `car`.
fn lower(name: &str) -> Result<String, std::convert::Infallible> {
    Ok(name.to_ascii_lowercase())
}

fn anchor(text: &str) -> Result<AnchorClass, String> {
    let expected = "CLASS=LENGTH,WIDTH,HEIGHT,BOTTOM with numbers in m";
    let (name, values) = text.split_once('=').ok_or(expected)?;
    let values: Result<Vec<f32>, _> = values.split(',').map(str::parse).collect();
    match values.as_deref() {
        Ok([length, width, height, bottom]) => Ok(AnchorClass {
            name: name.to_ascii_lowercase(),
            size_m: [*length, *width, *height],
            bottom_z_m: *bottom,
            // These overlaps are used only in training.
            matched_iou: 0.5,
            unmatched_iou: 0.35,
        }),
        _ => Err(expected.into()),
    }
}

impl ImportArguments {
    fn manifest(&self) -> anyhow::Result<Manifest> {
        for given in &self.anchor {
            if !self.classes.contains(&given.name) {
                let name = &given.name;
                bail!("--anchor: expected a class that --classes names, found {name}");
            }
        }
        let class = |name: &String| {
            let given = self.anchor.iter().find(|anchor| anchor.name == *name);
            given.cloned().map_or_else(|| exchange::anchor(name), Ok)
        };
        let classes: anyhow::Result<_> = self.classes.iter().map(class).collect();
        let mut manifest = second("kitti", classes?);
        manifest.thresholds.objectness_min = self.score_min;
        Ok(manifest)
    }
}

pub(crate) fn run(arguments: ImportArguments) -> anyhow::Result<()> {
    let path = arguments.checkpoint.display();
    let bytes = std::fs::read(&arguments.checkpoint).with_context(|| path.to_string())?;
    let imported = import(&bytes, arguments.manifest()?).with_context(|| path.to_string())?;
    let (manifest, weights) = (&imported.manifest, &imported.weights);
    let model = model_bytes(manifest, weights)?;
    let classes = manifest.classes.iter().map(|class| class.name.as_str());
    print_err(format_args!(
        "{} tensors, architecture {}, {:?} head, classes {}, sparse weights {:?}, score of an empty scene at most {:.3}",
        weights.iter().count(),
        manifest.network.profile,
        manifest.network.head,
        classes.collect::<Vec<_>>().join(", "),
        imported.layout,
        manifest.empty_objectness_max,
    ));
    write_out(&arguments.out, &model)
}
