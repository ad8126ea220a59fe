//! `mluc-lab sensor`: estimates the sensor of some scans, and shows a profile.

mod noise;
mod picture;

use super::terminal::{print_err, print_out, write_out};
use anyhow::{Result, ensure};
use clap::Args;
use mluc_evaluate::render;
use mluc_ingest::{POINT_BYTES, bin_points, estimate::Estimator, estimate::SensorEstimate};
use mluc_ipc_types::Point;
use mluc_model::SensorProfile;
use mluc_sources::{LayoutArgs, Next, Scan, Source};
use serde_json::json;
use std::{path::Path, path::PathBuf, time::Duration, time::Instant};

/// Estimate a sensor's profile from its scans: beams, columns, field, range, noise, height, tilt, own body; compared with the nearest product.
///
/// The profile is what `--sensor` takes. What the scans do not show is that of a product with the same beams, else a guess; `source` in the file names it.
/// --sensor without --input shows that sensor: its beams, and how many of them hit a car.
#[derive(Args)]
pub(crate) struct SensorArguments {
    /// Scans, as `mluc up` takes them: files, a capture, a recording, a live sensor's packets.
    #[arg(long, required_unless_present = "sensor")]
    input: Option<PathBuf>,
    /// Scans to look at: spread over files and recordings, the first of a capture or a live sensor.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=64))]
    scans: u32,
    /// Compare with this product or profile, or show it [default: the nearest product].
    #[arg(long, value_name = "NAME|FILE")]
    sensor: Option<String>,
    /// Profile to write, TOML.
    #[arg(long, requires = "input")]
    out: Option<PathBuf>,
    /// Picture to write, PNG: the histogram of elevations beside the other sensor's beams; without --input the beams with cars before them.
    #[arg(long)]
    picture: Option<PathBuf>,
    #[command(flatten)]
    layout: LayoutArgs,
}

/// Number of scans for the noise estimate.
const NOISE_SCANS: usize = 5;
/// Maximum wait for a live sensor.
const PATIENCE: Duration = Duration::from_secs(5);

pub(crate) fn run(arguments: SensorArguments) -> Result<()> {
    match (&arguments.input, &arguments.sensor) {
        (Some(input), _) => estimate(input, &arguments),
        (None, Some(name)) => show(&SensorProfile::load(name)?, arguments.picture.as_deref()),
        (None, None) => anyhow::bail!("expected --input or --sensor, found neither"),
    }
}

/// Prints a profile, and draws its picture.
fn show(profile: &SensorProfile, picture: Option<&Path>) -> Result<()> {
    let beams = profile.elevations_deg.len() * profile.units.len().max(1);
    let [near_m, far_m] = profile.range_m;
    let [top_deg, bottom_deg] = profile.vertical_field_deg();
    print_out(format_args!(
        "{}: {beams} beams, {top_deg:.1} to {bottom_deg:.1} degrees, columns {} degrees apart, range {near_m} to {far_m} m",
        profile.name, profile.azimuth_step_deg
    ))?;
    let cars = picture::CARS_M.iter().zip(picture::rings_on_cars(profile));
    let cars: Vec<String> = cars.map(|(m, rings)| format!("{rings} at {m} m")).collect();
    print_out(format_args!("rings on a car: {}", cars.join(", ")))?;
    picture.map_or(Ok(()), |path| write_out(path, &picture::of_profile(profile).png()))
}

fn estimate(input: &Path, arguments: &SensorArguments) -> Result<()> {
    let mut source = Source::open(input, &arguments.layout.layout()?, false)?;
    let wanted = u64::from(arguments.scans);
    let all = source.count().map_or(wanted, |all| all.max(1));
    let wanted = wanted.min(all);
    let mut estimator = Estimator::new();
    let (mut scans, mut scan) = (Vec::new(), Scan::default());
    for number in 0..wanted {
        let heard = Instant::now();
        let mut next = Next::NotYet;
        while next == Next::NotYet && !(source.is_live() && heard.elapsed() > PATIENCE) {
            next = source.load(number * all / wanted, &mut scan)?;
        }
        if next != Next::Scan {
            break;
        }
        if scan.bytes.is_empty() {
            let (path, name) = (input.display(), &scan.name);
            let what = "is empty or cannot be read";
            print_err(format_args!("warning: {path}: scan {name} {what}"));
            continue;
        }
        let points: Vec<Point> = bin_points(&scan.bytes).filter(Point::is_finite).collect();
        let not_finite = scan.bytes.len() / POINT_BYTES - points.len();
        estimator.look(&points, not_finite as u32);
        if scans.len() < NOISE_SCANS {
            scans.push(points);
        }
    }
    let found = estimator.estimate().clone();
    let (path, seen) = (input.display(), found.scans);
    let silence = source.silence().unwrap_or_default();
    ensure!(found.beams > 0, "{path}: no beams found in {seen} scans. {silence}");
    if seen < 3 {
        print_err(format_args!(
            "warning: {path}: {seen} scans, and blind sectors are found in three or more"
        ));
    }
    let noise_m = noise::range_noise_m(&scans, &found);
    let (name, other) = other_sensor(arguments.sensor.as_deref(), &found)?;
    print(&found, noise_m, &name, &other)?;
    if let Some(path) = &arguments.out {
        let up = found.up.name();
        ensure!(
            up == "z",
            "{}: expected scans with z up to write a profile of, found {up}: turn their axes first",
            input.display()
        );
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut profile = found.profile(&name, noise_m);
        profile.blind = estimator.blind();
        let text = toml::to_string(&profile)?;
        // A profile that cannot be read back must not be written.
        SensorProfile::parse(&text, &path.display().to_string())?;
        write_out(path, text.as_bytes())?;
    }
    if let Some(path) = &arguments.picture {
        let canvas = picture::of_scans(&estimator.elevations.counts, &found, &name, &other);
        write_out(path, &canvas.png())?;
    }
    Ok(())
}

/// The sensor to compare with: the given one, or the nearest product; evenly spaced beams where no beams are clear.
fn other_sensor(given: Option<&str>, found: &SensorEstimate) -> Result<(String, SensorProfile)> {
    if let Some(name) = given {
        return Ok((name.to_string(), SensorProfile::load(name)?));
    }
    Ok(match found.nearest().filter(|_| found.are_beams_clear) {
        Some(near) => (near.names.join(" or "), near.profile),
        None => ("even beams".into(), found.profile("even beams", None)),
    })
}

fn print(
    found: &SensorEstimate,
    noise_m: Option<f32>,
    name: &str,
    other: &SensorProfile,
) -> Result<()> {
    let text = |value: f32| value.to_string();
    let metres = |value: f32| format!("{value:.3}");
    let field_deg = [found.field_deg, other.field_deg.unwrap_or([0.0, 360.0])].map(|f| f[1]);
    let values = json!({
        "name": name, "found": found, "other": other,
        "spacing_deg": found.spacing_deg(), "apart_deg": found.distance_deg(other),
        "field": field_deg.map(text), "noise": noise_m.map_or("-".into(), metres), "other_noise": metres(other.range_noise_m),
        "axes": [found.unit.name(), found.up.name()],
        "intensity": text(found.intensity_max), "own_body": text(found.own_body_deg),
    });
    print_out(render(include_str!("estimate.txt"), values))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::BlindSector;

    #[test]
    fn a_made_up_sensor_comes_back_as_a_profile_and_a_picture() {
        let folder = tempfile::tempdir().expect("a folder");
        // 16 beams 2 degrees apart over flat ground 1 m below, a wall at 20 m all around, a part of the robot on the left. The first scan is
        // a part of a turn, and a person passes in the second one.
        let ray = |n: usize, scan: usize| {
            let deg = 15.0 - 2.0 * (n % 16) as f32;
            let azimuth_deg = (n / 16) as f32 * 0.4;
            let (sin, cos) = azimuth_deg.to_radians().sin_cos();
            let tan = deg.to_radians().tan();
            let top_deg = if scan == 1 { 20.0 } else { 4.0 };
            let is_robot = (80.0..100.0).contains(&azimuth_deg) && (0.0..top_deg).contains(&deg);
            let distance = match tan {
                _ if is_robot => 1.0,
                // The lowest beams end closer than the range in which a robot's own body is searched.
                ..-0.02 => 0.4 / -tan,
                _ => 20.0,
            };
            // Uniform noise with a deviation of 3 cm.
            let dice = (n as f32 * 12.9898).sin() * 43_758.547;
            let stray_m = 0.03 * 12.0_f32.sqrt() * (dice - dice.floor() - 0.5);
            let distance = distance + stray_m / tan.hypot(1.0);
            [distance * cos, distance * sin, distance * tan, 0.5]
        };
        for scan in 0..4 {
            let first = if scan == 0 { 16 * 450 } else { 0 };
            let points: Vec<[f32; 4]> = (first..16 * 900).map(|n| ray(n, scan)).collect();
            let path = folder.path().join(format!("{scan}.bin"));
            std::fs::write(path, mluc_dataset::scan_bytes(&points)).expect("written");
        }
        let [out, picture] = ["mine.toml", "mine.png"].map(|name| folder.path().join(name));
        let arguments = SensorArguments {
            input: Some(folder.path().to_path_buf()),
            scans: 5,
            sensor: None,
            out: Some(out.clone()),
            picture: Some(picture.clone()),
            layout: LayoutArgs::default(),
        };
        run(arguments).expect("an estimate");
        let profile = SensorProfile::load(&out.to_string_lossy()).expect("a profile");
        assert_eq!(profile.elevations_deg.len(), 16);
        assert!((profile.azimuth_step_deg - 0.4).abs() < 0.02, "{profile:?}");
        let noise_m = profile.range_noise_m;
        assert!((noise_m - 0.03).abs() < 0.005, "{noise_m}");
        let height_m = profile.height_m.expect("a ground");
        assert!((height_m - 0.4).abs() < 0.05, "{height_m}");
        let own_body = BlindSector { azimuth_deg: [90.0, 20.0], below_deg: 5.0 };
        assert_eq!(profile.blind, [own_body]);
        let picture = std::fs::read(picture).expect("a picture");
        assert!(picture.starts_with(b"\x89PNG"));
    }

    #[test]
    fn every_product_has_its_picture_on_the_page() {
        let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/sensors");
        let page = std::fs::read_to_string(docs.join("README.md")).expect("the page");
        for name in SensorProfile::names() {
            assert!(docs.join(format!("{name}.png")).is_file(), "{name}");
            let profile = SensorProfile::load(name).expect(name);
            assert!(!profile.source.is_empty(), "{name}");
            let row = page.lines().find(|row| row.contains(&format!("({name}.png)")));
            let [top_deg, bottom_deg] = profile.vertical_field_deg();
            let field = format!("| {top_deg:.1} to {bottom_deg:.1} |");
            assert!(row.expect(name).contains(&field), "{name}: {field}");
            // With even beams the farther car never has more rings than the nearer one.
            let rings = picture::rings_on_cars(&profile);
            assert!(rings[0] >= rings[4], "{name}: {rings:?}");
        }
        let vlp_16 = SensorProfile::load("vlp-16").expect("a product");
        // Of the beams at -1, -3, .. degrees, the ones from -10.2 to -1.7 at 10 m; one from -2.1 to -0.3 at 50 m.
        assert_eq!(picture::rings_on_cars(&vlp_16), [4, 3, 2, 1, 1]);
    }
}
