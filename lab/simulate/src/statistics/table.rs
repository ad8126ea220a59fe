//! The figures as Markdown, side by side with the reference where there is one.

use super::collect::Object;
use super::{Reference, Statistics, Summary};

/// Ranges are looked at in bins of 10 m, this many of them.
const RANGE_BINS: usize = 8;

/// All tables.
pub fn table(statistics: &Statistics, reference: Option<&Reference>) -> String {
    let mut text = overview(statistics, reference);
    text += "\n| class | objects | figure | data set | reference |\n|---|---|---|---|---|\n";
    for (class, objects) in &statistics.classes {
        text += &class_rows(class, objects, reference);
    }
    text += "\nPoints in a box by distance: 10th, 50th and 90th percentile.\n\n";
    text += "| class | distance, m | objects | data set | reference |\n|---|---|---|---|---|\n";
    for (class, objects) in &statistics.classes {
        text += &point_rows(class, objects, reference);
    }
    text
}

/// A figure, or a dash where there is none.
fn or_dash(figure: Option<String>) -> String {
    figure.unwrap_or("-".to_owned())
}

fn overview(statistics: &Statistics, reference: Option<&Reference>) -> String {
    let full_circle = |[mean, sd]: [f64; 2]| format!("{mean:.0} ± {sd:.0} (full circle)");
    let given_points = reference.and_then(Reference::points_per_scan);
    let given_points = or_dash(given_points.map(full_circle));
    let given_objects = reference.and_then(Reference::objects_per_frame);
    let given_objects = or_dash(given_objects.map(|mean| format!("{mean:.2}")));
    let points = &statistics.points_per_scan;
    let (frames, mean, sd) = (points.count(), points.mean(), points.deviation());
    let objects = statistics.objects_per_frame.mean();
    format!(
        "| | data set | reference |\n|---|---|---|\n| frames | {frames} | |\n\
         | points a scan | {mean:.0} ± {sd:.0} | {given_points} |\n\
         | objects a frame | {objects:.2} | {given_objects} |\n"
    )
}

fn class_rows(class: &str, objects: &[Object], reference: Option<&Reference>) -> String {
    let given = |place: &str, index| reference?.numbers(class, place)?.get(index).copied();
    let spread = |mean, deviation| Some(format!("{:.2} ± {:.2}", mean?, deviation?));
    let given_spread = |mean, sd, index| or_dash(spread(given(mean, index), given(sd, index)));
    let own = |value: &dyn Fn(&Object) -> f64| {
        let s = Summary::new(objects.iter().map(value).collect());
        or_dash(spread(Some(s.mean()), Some(s.deviation())))
    };
    let mut text = String::new();
    let mut row = |figure: &str, found: String, expected: String| {
        let count = objects.len();
        text += &format!("| {class} | {count} | {figure} | {found} | {expected} |\n");
    };
    for (i, name) in ["length", "width", "height"].into_iter().enumerate() {
        let found = own(&|o| o.box_in_sensor.size_m[i]);
        let expected = given_spread("lwh_mean", "lwh_std", i);
        row(&format!("{name}, m"), found, expected);
    }
    let percentiles = |mean: Option<f64>, [low, middle, high]: [Option<f64>; 3]| {
        let (mean, low, middle, high) = (mean?, low?, middle?, high?);
        Some(format!("{mean:.1} ({low:.0}, {middle:.0}, {high:.0})"))
    };
    let range = Summary::new(objects.iter().map(Object::range_m).collect());
    let found = [5.0, 50.0, 95.0].map(|p| range.percentile(p));
    let found = or_dash(percentiles(Some(range.mean()), found));
    let expected = [0, 2, 4].map(|i| given("range_m/pct_5_25_50_75_95", i));
    let expected = or_dash(percentiles(given("range_m/mean", 0), expected));
    let figure = "distance, m: mean (5th, 50th, 95th percentile)";
    row(figure, found, expected);
    let found = own(&|o| o.box_in_sensor.center_m[2] - o.box_in_sensor.size_m[2] / 2.0);
    let expected = given_spread("z_bottom_velo/mean", "z_bottom_velo/std", 0);
    row("bottom, m", found, expected);
    let shares = [0, 1, 2, 3].map(|level| {
        let is_level = |o: &&Object| usize::try_from(o.occluded).map_or(3, |l| l.min(3)) == level;
        let share = objects.iter().filter(is_level).count() as f64 / objects.len().max(1) as f64;
        format!("{:.0}", 100.0 * share)
    });
    let figure = "occlusion level 0, 1, 2, 3, %";
    row(figure, shares.join(", "), or_dash(None));
    text
}

fn point_rows(class: &str, objects: &[Object], reference: Option<&Reference>) -> String {
    let list = |v: [f64; 3]| v.map(|x| format!("{x:.0}")).join(", ");
    let mut text = String::new();
    for bin in 0..RANGE_BINS {
        let in_bin = objects
            .iter()
            .filter(|o| (o.range_m() / 10.0) as usize == bin);
        let points = Summary::new(in_bin.map(|o| o.points as f64).collect());
        let found = [10.0, 50.0, 90.0].map(|p| points.percentile(p));
        let [Some(low), Some(middle), Some(high)] = found else {
            continue;
        };
        let name = format!("{}-{}", bin * 10, bin * 10 + 10);
        let place = format!("points_in_box_by_range/{name}/pct_10_50_90");
        let expected = reference.and_then(|r| r.numbers(class, &place)?.try_into().ok());
        let (found, expected) = (list([low, middle, high]), or_dash(expected.map(list)));
        let count = points.count();
        text += &format!("| {class} | {name} | {count} | {found} | {expected} |\n");
    }
    text
}
