//! The page's pictures: latency over time, where the time of single frames went, percentiles.

use super::frame::{FrameRecord, STAGES, micros};
use super::{figures::short, series::Series, series::series};
use mluc_geometry::quantile;
use plotters::coord::Shift;
use plotters::prelude::*;

const WIDTH_PX: u32 = 980;
const FONT: (&str, u32) = ("sans-serif", 12);
/// One colour per stage, distinct for readers with common colour blindness.
const STAGE_COLORS: [RGBColor; 4] = [
    RGBColor(125, 133, 144),
    RGBColor(47, 126, 216),
    RGBColor(224, 138, 43),
    RGBColor(29, 158, 116),
];
const TOTAL_COLOR: RGBColor = RGBColor(130, 80, 223);
const ALARM_COLOR: RGBColor = RGBColor(209, 36, 47);
const PALE_COLOR: RGBColor = RGBColor(185, 192, 201);
/// Above this number, dots are left out to keep the page small; dropped frames are never left out.
const DOTS_MAX: usize = 4000;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// An SVG for embedding in a page; empty if it cannot be drawn.
fn svg(height_px: u32, draw: impl FnOnce(&Area) -> Drawn) -> String {
    let mut text = String::new();
    let root = SVGBackend::with_string(&mut text, (WIDTH_PX, height_px)).into_drawing_area();
    let drawn = root.fill(&WHITE).and_then(|()| draw(&root));
    let is_drawn = drawn.and_then(|()| root.present()).is_ok();
    drop(root);
    // HTML does not need the namespace.
    let text = text.replace(" xmlns=\"http://www.w3.org/2000/svg\"", "");
    if is_drawn { text } else { String::new() }
}

pub(crate) fn latency_over_time(frames: &[FrameRecord], period_ms: Option<f64>) -> String {
    let starts_s = round_starts_s(frames);
    let place = |(frame, us): (&FrameRecord, f64)| {
        let at_s = starts_s[frame.round as usize] + frame.due_ns as f64 * 1e-9;
        (at_s, us / 1000.0)
    };
    let latency_us = series(frames).latency_us;
    let places: Vec<(f64, f64)> = frames.iter().zip(latency_us).map(place).collect();
    if places.is_empty() {
        return String::new();
    }
    let period_ms = period_ms.unwrap_or(0.0);
    let end_s = places.iter().map(|place| place.0).fold(0.1, f64::max);
    let high_ms = places.iter().map(|place| place.1).fold(period_ms, f64::max);
    let step = frames.len().div_ceil(DOTS_MAX);
    svg(300, |root| {
        let mut chart = ChartBuilder::on(root)
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(46)
            .build_cartesian_2d(0.0..end_s, 0.0..1.05 * high_ms)?;
        let mut mesh = chart.configure_mesh();
        mesh.x_desc("time, s").y_desc("ms").label_style(FONT);
        mesh.light_line_style(TRANSPARENT).draw()?;
        let period = [(0.0, period_ms), (end_s, period_ms)];
        chart.draw_series(LineSeries::new(period, PALE_COLOR))?;
        for (index, (frame, place)) in frames.iter().zip(places).enumerate() {
            let root = chart.plotting_area();
            if !frame.is_out() {
                root.draw(&Cross::new(place, 3, ALARM_COLOR))?;
            } else if index % step == 0 {
                let color = [TOTAL_COLOR, PALE_COLOR][usize::from(frame.is_warm_up)];
                root.draw(&Circle::new(place, 2, color.filled()))?;
            }
        }
        Ok(())
    })
}

fn round_starts_s(frames: &[FrameRecord]) -> Vec<f64> {
    let first = frames.first().map_or(0, |frame| frame.round as usize);
    let mut starts_s = vec![0.0; first + 1];
    for pair in frames.windows(2) {
        if pair[0].round < pair[1].round {
            let length_s = pair[0].due_ns as f64 * 1e-9 + 1.0;
            let next_s = starts_s.last().map_or(0.0, |start_s| start_s + length_s);
            starts_s.resize(pair[1].round as usize + 1, next_s);
        }
    }
    starts_s
}

/// Lanes per frame: its name, one per stage, a gap.
const LANES: f64 = 5.5;

/// The median frame and the slowest delivered frames on one scale: one lane per stage, waiting in a pale colour, computing in full colour.
pub(crate) fn waterfall(frames: &[FrameRecord]) -> String {
    let measured = frames.iter().filter(|frame| !frame.is_warm_up);
    let mut out: Vec<(f64, &FrameRecord)> =
        measured.filter_map(|frame| Some((frame.delivered_us()? / 1000.0, frame))).collect();
    out.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(slowest_ms, _)) = out.last() else {
        return String::new();
    };
    let (median, others) = (out[(out.len() - 1) / 2], out.len() - 1);
    let words = ["slowest", "second slowest", "third slowest"];
    let slowest = words.into_iter().zip(out.into_iter().rev().take(others));
    let chosen: Vec<_> = [("median", median)].into_iter().chain(slowest).collect();
    let lanes = LANES * chosen.len() as f64;
    svg(50 + 18 * lanes as u32, |root| {
        // Leaves room for the text next to the longest bar.
        let mut chart = ChartBuilder::on(root)
            .margin(10)
            .x_label_area_size(36)
            .build_cartesian_2d(0.0..1.25 * slowest_ms.max(0.001), lanes..0.0)?;
        let mut mesh = chart.configure_mesh();
        mesh.x_desc("ms since the scan was due").label_style(FONT);
        mesh.disable_y_mesh().disable_y_axis();
        mesh.light_line_style(TRANSPARENT).draw()?;
        let area = chart.plotting_area();
        for (number, (word, (ms, frame))) in chosen.into_iter().enumerate() {
            let top = LANES * number as f64;
            let text = format!("{word}: frame {}, {} ms", frame.sequence, short(ms));
            area.draw(&Text::new(text, (0.0, top + 0.2), FONT))?;
            let at_ms = |ns: i64| micros(ns - frame.due_ns) / 1000.0;
            let mut input_ms = 0.0;
            for (stage, own) in frame.stamps.iter().flatten().enumerate() {
                let (begin_ms, end_ms) = (at_ms(own.started_ns), at_ms(own.published_ns));
                let lane = top + 1.0 + stage as f64;
                let bar = |from_ms, to_ms, color: RGBColor| {
                    Rectangle::new([(from_ms, lane + 0.1), (to_ms, lane + 0.8)], color.filled())
                };
                area.draw(&bar(input_ms, begin_ms, PALE_COLOR))?;
                area.draw(&bar(begin_ms, end_ms, STAGE_COLORS[stage]))?;
                let run_ms = frame.run_us(stage).unwrap_or(0.0) / 1000.0;
                let text = format!("  {} {} ms", STAGES[stage], short(run_ms));
                area.draw(&Text::new(text, (end_ms, lane + 0.2), FONT))?;
                input_ms = end_ms;
            }
        }
        Ok(())
    })
}

/// Position of a time on a logarithmic axis in ms; times below 1 us count as 1 us.
fn log_ms(us: f64) -> f64 {
    (us.max(1.0) / 1000.0).log10()
}

/// Percentile curves: each step to the right shows frames ten times as rare, up to p99.9.
pub(crate) fn percentile_curves(series: &Series) -> String {
    let runs_us = series.run_us.iter().zip(STAGES).zip(STAGE_COLORS);
    let runs_us = runs_us.map(|((us, name), color)| (name, color, us));
    let total = ("end to end", TOTAL_COLOR, &series.latency_us);
    let figures: Vec<_> = [total].into_iter().chain(runs_us).collect();
    let all = figures.iter().flat_map(|figure| figure.2);
    let [least, most] =
        all.fold([f64::INFINITY, 0.0], |[least, most], us| [us.min(least), us.max(most)]);
    if least > most {
        return String::new();
    }
    let share = |decade: &f64| format!("{} %", short(100.0 - 100.0 * 10f64.powf(-decade)));
    let time = |at: &f64| short(10f64.powf(*at));
    svg(330, |root| {
        let mut chart = ChartBuilder::on(root)
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(46)
            .build_cartesian_2d(0.0..3.0, log_ms(least) - 0.05..log_ms(most) + 0.05)?;
        let mut mesh = chart.configure_mesh();
        mesh.x_desc("share of frames that take at most so long");
        mesh.x_labels(4).x_label_formatter(&share);
        mesh.y_desc("ms").y_label_formatter(&time);
        mesh.label_style(FONT);
        mesh.light_line_style(TRANSPARENT).draw()?;
        for (name, color, us) in figures {
            let key = move |(x, y)| Rectangle::new([(x, y - 4), (x + 8, y + 4)], color.filled());
            let line = LineSeries::new(percentile_curve(us), color.stroke_width(2));
            chart.draw_series(line)?.label(name).legend(key);
        }
        let mut names = chart.configure_series_labels();
        names.position(SeriesLabelPosition::UpperLeft);
        names.legend_area_size(14).background_style(WHITE.mix(0.8));
        names.label_font(FONT).draw()
    })
}

fn percentile_curve(us: &[f64]) -> Vec<(f64, f64)> {
    let mut ascending = us.to_vec();
    ascending.sort_by(f64::total_cmp);
    let at = |step| {
        let decade = f64::from(step) / 50.0;
        let us = quantile(&ascending, 1.0 - 10f64.powf(-decade))?;
        Some((decade, log_ms(us)))
    };
    (0..=150).filter_map(at).collect()
}
