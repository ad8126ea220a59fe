//! `mluc-lab render`: a picture of a scan.

use super::terminal::print_out;
use anyhow::{Context, bail};
use clap::Args;
use mluc_lab::render::{ColorBy, RenderOptions, render};
use std::path::PathBuf;

/// Draw a scan from above as a PNG, with the boxes of its labels.
#[derive(Args)]
pub(crate) struct RenderArguments {
    /// Scan: x, y, z, intensity as little-endian f32.
    #[arg(long)]
    scan: PathBuf,
    /// Labels in KITTI's format. Without it, label_2/NAME.txt beside the scan's folder is taken when it exists.
    #[arg(long)]
    labels: Option<PathBuf>,
    /// Calibration of the frame. Without it, calib/NAME.txt beside the scan's folder.
    #[arg(long)]
    calib: Option<PathBuf>,
    /// Colour of the points.
    #[arg(long, value_enum, default_value = "height")]
    color: ColorBy,
    /// Pixels a metre.
    #[arg(long, default_value_t = 10.0, value_parser = scale)]
    px_per_m: f32,
    /// Show only what lies ahead, out to 70 m, instead of the full circle.
    #[arg(long)]
    ahead: bool,
    /// Picture to write.
    #[arg(long)]
    out: PathBuf,
}

fn scale(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(value) if (1.0..=60.0).contains(&value) => Ok(value),
        _ => Err("expected a number from 1 to 60".to_owned()),
    }
}

pub(crate) fn run(arguments: RenderArguments) -> anyhow::Result<()> {
    let beside = |folder: &str| {
        let name = arguments.scan.with_extension("txt");
        let root = arguments.scan.parent()?.parent()?;
        Some(root.join(folder).join(name.file_name()?)).filter(|path| path.is_file())
    };
    let labels = match (
        arguments.labels.clone().or_else(|| beside("label_2")),
        arguments.calib.clone().or_else(|| beside("calib")),
    ) {
        (Some(labels), Some(calibration)) => Some((labels, calibration)),
        (Some(labels), None) => bail!(
            "{}: labels need a calibration: give --calib",
            labels.display()
        ),
        (None, _) => None,
    };
    let options = RenderOptions {
        scan: arguments.scan,
        labels,
        color: arguments.color,
        px_per_m: arguments.px_per_m,
        ahead: arguments.ahead,
    };
    let canvas = render(&options)?;
    let out = arguments.out.display();
    std::fs::write(&arguments.out, canvas.png())
        .with_context(|| format!("{out}: cannot create"))?;
    print_out(arguments.out.display())
}
