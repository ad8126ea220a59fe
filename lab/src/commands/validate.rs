//! `mluc-lab validate`.

use std::path::PathBuf;

use clap::Args;
use mluc_lab::dataset::Dataset;
use mluc_lab::train::validate;
use mluc_model::Model;

/// Run a model file over a labelled folder and print the average precision of its classes.
#[derive(Args)]
pub(crate) struct Validate {
    /// Model file.
    #[arg(long)]
    model: PathBuf,
    /// Folder in KITTI's format: velodyne, label_2, calib.
    #[arg(long)]
    data: PathBuf,
    /// First so many frames.
    #[arg(long, default_value_t = 1_000_000)]
    frames: usize,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Runs it.
pub(crate) fn run(arguments: Validate) -> anyhow::Result<()> {
    let model = Model::read(&arguments.model)?;
    let figures = validate(&model, &Dataset::open(&arguments.data)?, arguments.frames)?;
    if arguments.json {
        println!("{}", serde_json::to_string(&figures)?);
        return Ok(());
    }
    println!(
        "step {}, {} frames, {:.1} boxes a frame",
        figures.step, figures.frames, figures.boxes_per_frame
    );
    println!(
        "{:12} {:>5} {:>7} {:>7} {:>7} {:>7}",
        "class", "IoU", "AP R40", "AP all", "recall", "labels"
    );
    for c in &figures.classes {
        println!(
            "{:12} {:5.2} {:7.2} {:7.2} {:7.2} {:7}",
            c.class, c.iou_min, c.ap_r40, c.ap_all, c.recall, c.labels
        );
    }
    println!(
        "mean of the known classes, AP R40: {:.2}",
        figures.map_known
    );
    Ok(())
}
