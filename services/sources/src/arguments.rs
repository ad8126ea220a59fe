//! Command-line options that set how an input is read.

use crate::{files::Layout, shard::shard};
use clap::Args;
use serde::Serialize;
use std::path::PathBuf;

/// The heading of the input's options in the help.
pub const INPUT: &str = "Input";

/// How to read files of points, where they are not as KITTI's.
#[derive(Args, Clone, Debug, Default, Serialize)]
#[command(next_help_heading = INPUT)]
pub struct LayoutArgs {
    /// Columns of a .bin or .npy file in their order, `x,y,z,intensity,ring` for instance. Only x, y, z, intensity and, with --deskew, the time are read
    /// [default: x,y,z,intensity; .pcd.bin and .npy also ring, .npy also time].
    #[arg(long, value_delimiter = ',', value_name = "NAME,..")]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    columns: Vec<String>,
    /// Where the sensor is in the coordinates of the files, which may be those of a map [default: 0,0,0].
    #[arg(long, value_name = "X,Y,Z", value_parser = origin)]
    #[arg(allow_hyphen_values = true)]
    origin: Option<[f64; 3]>,
    /// Metres per unit of the coordinates, 0.001 for mm [default: 1].
    #[arg(long)]
    scale: Option<f64>,
    /// What intensity is multiplied by, so that it is 0 to 1 [default: 1].
    #[arg(long)]
    intensity_scale: Option<f64>,
    /// Which of the file's axes point forward, to the left and up, `y,-x,z` for instance [default: x,y,z].
    #[arg(long, allow_hyphen_values = true)]
    axes: Option<String>,
    /// Calibration of the sensor's unit, for captures and live sensors: Velodyne's YAML, Hesai's CSV, Ouster's JSON [default: the product's].
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Topic of the scans in a recording [default: the only one that has some].
    #[arg(long)]
    topic: Option<String>,
    /// Correct the points for the sensor's motion within a turn: each is moved to its position at the scan's stamp. The poses come from poses.txt and
    /// timestamps.txt next to the scans, from a recording's odometry or transforms, or from ROS 2. Other inputs are refused.
    #[arg(long)]
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    deskew: bool,
    /// With --deskew: topic of the poses [default: in a recording /tf, else its only topic of poses; from ROS 2 /odom].
    #[arg(long)]
    odometry: Option<String>,
    /// Read only part I (0 to N-1) of N, for job arrays: every Nth scan of files, a capture or a recording.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    shard: Option<[u32; 2]>,
}

impl LayoutArgs {
    /// The layout, with defaults where nothing was given.
    pub fn layout(&self) -> anyhow::Result<Layout> {
        Ok(toml::Table::try_from(self)?.try_into()?)
    }
}

fn origin(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
    numbers.ok_or_else(|| format!("expected three numbers, as in 1.5,-2,0, found '{text}'"))
}
