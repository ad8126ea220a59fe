//! The figures as Markdown, side by side with the reference where there is one.

use super::{ClassStatistics, RANGE_BINS, Reference, Statistics, Summary};
use std::fmt::Write as _;

/// All tables.
pub fn table(statistics: &Statistics, reference: Option<&Reference>) -> String {
    let mut text = overview(statistics, reference);
    text += "\n| class | objects | figure | data set | reference |\n|---|---|---|---|---|\n";
    for (class, figures) in &statistics.classes {
        text += &class_rows(class, figures, reference);
    }
    text += "\nPoints in a box by distance: 10th, 50th and 90th percentile.\n\n| class | distance, m | objects | data set | reference |\n|---|---|---|---|---|\n";
    for (class, figures) in &statistics.classes {
        text += &point_rows(class, figures, reference);
    }
    text
}

fn overview(statistics: &Statistics, reference: Option<&Reference>) -> String {
    let points = &statistics.points_per_scan;
    let mut text = String::from("| | data set | reference |\n|---|---|---|\n");
    let scans = reference
        .and_then(Reference::points_per_scan)
        .map_or("-".to_owned(), |[mean, sd]| {
            format!("{mean:.0} ± {sd:.0} (full circle)")
        });
    let objects = reference
        .and_then(Reference::objects_per_frame)
        .map_or("-".to_owned(), |mean| format!("{mean:.2}"));
    // Writing into a String cannot fail.
    let _ = writeln!(text, "| frames | {} | |", statistics.frames);
    let _ = writeln!(
        text,
        "| points a scan | {:.0} ± {:.0} | {scans} |",
        points.mean(),
        points.deviation()
    );
    let _ = writeln!(
        text,
        "| objects a frame | {:.2} | {objects} |",
        statistics.objects_per_frame.mean()
    );
    text
}

fn class_rows(class: &str, figures: &ClassStatistics, reference: Option<&Reference>) -> String {
    let given = |place: &str, index: usize| {
        reference
            .and_then(|r| r.numbers(class, place))
            .and_then(|list| list.get(index).copied())
    };
    let pair = |mean: Option<f64>, deviation: Option<f64>| match (mean, deviation) {
        (Some(m), Some(d)) => format!("{m:.2} ± {d:.2}"),
        _ => "-".to_owned(),
    };
    let own = |s: &Summary| pair(Some(s.mean()), Some(s.deviation()));
    let mut text = String::new();
    let mut row = |figure: &str, found: String, expected: String| {
        let _ = writeln!(
            text,
            "| {class} | {} | {figure} | {found} | {expected} |",
            figures.range_m.count()
        );
    };
    for (i, name) in ["length, m", "width, m", "height, m"]
        .into_iter()
        .enumerate()
    {
        row(
            name,
            own(&figures.size_m[i]),
            pair(given("lwh_mean", i), given("lwh_std", i)),
        );
    }
    let percentiles = |list: [Option<f64>; 4]| match list {
        [Some(mean), Some(low), Some(middle), Some(high)] => {
            format!("{mean:.1} ({low:.0}, {middle:.0}, {high:.0})")
        }
        _ => "-".to_owned(),
    };
    let range = &figures.range_m;
    row(
        "distance, m: mean (5th, 50th, 95th percentile)",
        percentiles([
            Some(range.mean()),
            range.percentile(5.0),
            range.percentile(50.0),
            range.percentile(95.0),
        ]),
        percentiles([
            given("range_m/mean", 0),
            given("range_m/pct_5_25_50_75_95", 0),
            given("range_m/pct_5_25_50_75_95", 2),
            given("range_m/pct_5_25_50_75_95", 4),
        ]),
    );
    row(
        "bottom, m",
        own(&figures.bottom_m),
        pair(
            given("z_bottom_velo/mean", 0),
            given("z_bottom_velo/std", 0),
        ),
    );
    let [a, b, c, d] = figures.occluded.map(|share| 100.0 * share);
    row(
        "occlusion level 0, 1, 2, 3, %",
        format!("{a:.0}, {b:.0}, {c:.0}, {d:.0}"),
        "-".to_owned(),
    );
    text
}

fn point_rows(class: &str, figures: &ClassStatistics, reference: Option<&Reference>) -> String {
    let mut text = String::new();
    let list = |v: [f64; 3]| v.map(|x| format!("{x:.0}")).join(", ");
    for bin in 0..RANGE_BINS {
        let points = &figures.points[bin];
        let [Some(low), Some(middle), Some(high)] =
            [10.0, 50.0, 90.0].map(|p| points.percentile(p))
        else {
            continue;
        };
        let name = format!("{}-{}", bin * 10, bin * 10 + 10);
        let expected = reference
            .and_then(|r| {
                r.numbers(
                    class,
                    &format!("points_in_box_by_range/{name}/pct_10_50_90"),
                )
            })
            .and_then(|v| v.try_into().ok())
            .map_or("-".to_owned(), list);
        let _ = writeln!(
            text,
            "| {class} | {name} | {} | {} | {expected} |",
            points.count(),
            list([low, middle, high])
        );
    }
    text
}
