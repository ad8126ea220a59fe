//! `mluc doctor --input`: which sensor the scans are from, and whether the model takes them.

use super::{Failure, Finding, Fine, Warning};
use mluc_geometry::quantile_of;
use mluc_ingest::estimate::{Estimator, SensorEstimate};
use mluc_ingest::{Expected, decode_bin, inspect_bin};
use mluc_ipc_types::{Flags, POINTS_MAX, Point};
use mluc_sources::{Next, Open, Scan, Source, files::Layout, idle_options};
use std::{path::Path, time::Duration, time::Instant};

/// Number of scans that are examined, spread over the input.
const SCANS: u64 = 20;
/// How long to wait for a live sensor.
const PATIENCE: Duration = Duration::from_secs(5);
/// Most beams whose angles are all printed.
const ANGLES_MAX: usize = 16;

pub(super) fn findings(
    input: &Path,
    layout: &Layout,
    expected: &Expected,
    open: Open,
) -> anyhow::Result<Vec<Finding>> {
    let mut source = open(input, layout, false)?;
    let mut estimator = Estimator::new();
    let Examined { damaged, times } = examine(&mut source, &mut estimator)?;
    let found = estimator.estimate();
    let (mut reasons, mut findings) = (Vec::new(), Vec::new());
    let sees_nothing = found.points == 0 || found.zero_share.max(found.not_finite_share) >= 1.0;
    if found.points > 0 {
        expected.judge(found, &mut reasons);
        let rate = about_rate(&times);
        let told = [about_scans(found), rate, about_beams(found), about_mounting(found)];
        findings.extend(told.map(|text| (Fine, text)));
        findings.push((Fine, about_model(expected)));
    }
    findings.extend(reasons.iter().map(|reason| (Warning, reason.to_string())));
    let idle = idle_options(input, layout).into_iter();
    findings.extend(idle.map(|option| (Warning, format!("{option} has no effect on this input"))));
    if !damaged.is_empty() {
        let text = format!("scans that are empty, cut short or unreadable: {}", damaged.join(", "));
        findings.push((Warning, text));
    }
    if sees_nothing {
        findings.push((Failure, about_silence(&source, found)));
    }
    let command = match reasons[..] {
        [] if !sees_nothing => command(found, expected),
        _ => "first follow the warnings above".to_string(),
    };
    findings.push((Fine, format!("to use: {command}")));
    Ok(findings)
}

fn about_silence(source: &Source, found: &SensorEstimate) -> String {
    if source.is_live() && found.points == 0 {
        let silence = source.silence().unwrap_or_default();
        return format!("no scan of a known sensor came within 5 s: does it send here? {silence}");
    }
    "no returns in these scans: see the warnings above; of a .bin or .npy, does --columns name its columns?"
        .to_string()
}

struct Examined {
    /// Names of the scans that are empty, cut short or unreadable.
    damaged: Vec<String>,
    /// Number in the input and time, ns, of each scan that has a time.
    times: Vec<(u64, u64)>,
}

/// Shows the estimator scans that are spread over the input.
fn examine(source: &mut Source, estimator: &mut Estimator) -> anyhow::Result<Examined> {
    let (mut scan, mut points) = (Scan::default(), vec![Point::default(); POINTS_MAX]);
    let step = source.count().map_or(1, |count| count.div_ceil(SCANS));
    let begun = Instant::now();
    let (mut damaged, mut times) = (vec![], vec![]);
    let (mut is_last_part, mut missed) = (false, 0);
    for number in 0..SCANS {
        let next = loop {
            let next = source.load(number * step, &mut scan)?;
            let is_silent = source.is_live() && begun.elapsed() > PATIENCE;
            if next != Next::NotYet || is_silent {
                break next;
            }
        };
        if next != Next::Scan {
            // So is the last one of a capture.
            if is_last_part {
                damaged.pop();
            }
            break;
        }
        missed += scan.missed;
        let time_ns = scan.offset_ns.or(scan.stamp_ns);
        times.extend(time_ns.map(|time_ns| (number * step + missed, time_ns)));
        // The count is determined first: points beyond the limit are cut off, as ingest does.
        let kept = inspect_bin(&scan.bytes).points_out as usize;
        let report = decode_bin(&scan.bytes, &mut points[..kept]);
        // The first revolution of a capture or a live sensor is incomplete.
        is_last_part = source.count().is_none() && scan.flags == Flags::DAMAGED_INPUT;
        let is_part = number == 0 && is_last_part;
        if kept == 0 || (scan.flags != Flags::default() && !is_part) {
            damaged.push(scan.name.clone());
        }
        if kept == 0 && report.dropped_not_finite == 0 {
            continue;
        }
        estimator.look(&points[..kept], report.dropped_not_finite);
    }
    Ok(Examined { damaged, times })
}

/// The rate is the median over neighbouring scans: pauses and an incomplete first revolution do not change it.
fn about_rate(times: &[(u64, u64)]) -> String {
    let rates = times.windows(2).map(|pair| {
        let elapsed_ns = pair[1].1 as f64 - pair[0].1 as f64;
        (pair[1].0 - pair[0].0) as f64 * 1e9 / elapsed_ns
    });
    let rates = rates.filter(|rate| rate.is_finite() && *rate > 0.0);
    match quantile_of(rates.collect(), 0.5) {
        Some(rate) => format!("{rate:.1} scans per second"),
        None if times.is_empty() => {
            "scans per second: not known, the scans have no times".to_string()
        }
        None => "scans per second: not known, no two scans have different times".to_string(),
    }
}

fn about_scans(found: &SensorEstimate) -> String {
    let percent = |share: f32| (share * 100.0).round();
    format!(
        "{} scans of {} points, {} % not finite, {} % at the origin, {} % copies; unit {}, {} up, intensity up to {}",
        found.scans,
        found.points,
        percent(found.not_finite_share),
        percent(found.zero_share),
        percent(found.duplicate_share),
        found.unit.name(),
        found.up.name(),
        found.intensity_max
    )
}

fn about_beams(found: &SensorEstimate) -> String {
    let [top, bottom] = found.vertical_field_deg;
    let angles = found.elevations_deg.iter().map(|angle_deg| format!("{angle_deg:.1}"));
    let beams = match found.spacing_deg() {
        Some(_) if angles.len() <= ANGLES_MAX => {
            let angles = angles.collect::<Vec<_>>().join(", ");
            format!("{} beams at {angles} degrees; returns", found.beams)
        }
        Some(spacing) => format!("{} beams, {spacing:.2} degrees apart", found.beams),
        None => format!("no clear beams, about {}", found.beams),
    };
    let step = found.azimuth_step_deg;
    let step = step.map(|step| format!(", a column every {step:.2}"));
    let near = found.nearest().filter(|_| found.are_beams_clear);
    let near = near.map(|near| {
        let names = near.names.join(" or ");
        format!("; like {names}, {:.2} degrees off", near.distance_deg)
    });
    format!(
        "{beams} from {top:.1} to {bottom:.1}{}, {} degrees around; half of the returns within {:.0} m, all within {:.0} m{}",
        step.unwrap_or_default(),
        found.field_deg[1],
        found.range_median_m,
        found.range_longest_m,
        near.unwrap_or_default()
    )
}

fn about_mounting(found: &SensorEstimate) -> String {
    match found.height_m {
        Some(height_m) => format!(
            "sensor {height_m:.2} m above the ground, pitch {:.1} and roll {:.1} degrees; the robot itself hides {} degrees",
            found.pitch_deg, found.roll_deg, found.own_body_deg
        ),
        None => "no ground found with z up".to_string(),
    }
}

fn about_model(expected: &Expected) -> String {
    let takes = &expected.takes;
    let any = |[low, high]: [u32; 2]| match high {
        u32::MAX => "any number of".to_string(),
        _ => format!("{low} to {high}"),
    };
    let [low_m, high_m] = takes.height_m;
    format!(
        "the model takes {} beams, {} points, {low_m:.2} to {high_m:.2} m high, tilted by up to {} degrees",
        any(takes.beams),
        any(takes.points),
        takes.tilt_max_deg
    )
}

/// The command for these scans: `mluc up` with the arguments that doctor was given.
fn command(found: &SensorEstimate, expected: &Expected) -> String {
    let names = found.product().map(|near| near.names).unwrap_or_default();
    let sensor = match (expected.sensor(), &names[..]) {
        (Some(_), _) | (None, []) => String::new(),
        (None, [name]) => format!(" --sensor {name}"),
        (None, [name, others @ ..]) => {
            let others = others.join(", ");
            format!(" --sensor {name}   # name yours; the same beams: {others}")
        }
    };
    let given = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
    let given = given.skip_while(|word| word != "doctor");
    let is_plain = |c: char| c.is_alphanumeric() || "_./,:=+-".contains(c);
    let quoted = |word: String| match word.chars().all(is_plain) {
        true => format!(" {word}"),
        false => format!(" '{}'", word.replace('\'', r"'\''")),
    };
    let given: String = given.skip(1).map(quoted).collect();
    format!("mluc up{given}{sensor}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_of_scans_not_of_those_examined() {
        // Every third scan of a sensor with 20 Hz, with a pause, and a clock that is set back.
        let times = [(0, 0), (3, 150), (6, 300), (9, 9_000), (12, 9_150), (15, 100), (18, 250)];
        let times = times.map(|(number, ms)| (number, ms * 1_000_000));
        assert_eq!(about_rate(&times), "20.0 scans per second");
        for times in [&times[..1], &[(0, 5), (1, 5)]] {
            assert!(about_rate(times).contains("no two scans"), "{times:?}");
        }
        assert!(about_rate(&[]).contains("no times"));
    }

    #[test]
    fn the_angles_of_a_few_clear_beams_are_printed() {
        let beams = |count: u32| {
            let elevations_deg = (0..count).map(|i| 15.0 - 2.0 * i as f32).collect();
            let are_beams_clear = true;
            about_beams(&SensorEstimate {
                beams: count,
                are_beams_clear,
                elevations_deg,
                ..SensorEstimate::default()
            })
        };
        assert!(beams(4).starts_with("4 beams at 15.0, 13.0, 11.0, 9.0 degrees; returns from"));
        assert!(beams(17).starts_with("17 beams, 2.00 degrees apart from"));
    }
}
