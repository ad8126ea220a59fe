use super::*;
use crate::estimate::SensorEstimate;
use mluc_ipc_types::Flags;
use mluc_model::{Grid, Manifest, Network, SensorProfile, Takes};

fn expected(takes: Takes) -> Expected {
    let network = Network::compact(Grid::kitti_compact(), 3);
    let mut manifest = Manifest::untrained("guard", network);
    manifest.takes = Some(takes);
    Expected::new(&manifest, None)
}

const TAKES: Takes =
    Takes { beams: [0, 200], height_m: [1.0, 2.0], tilt_max_deg: 5.0, points: [0, 200_000] };

/// Flat ground at this depth below the sensor.
fn ground(height_m: f32, shift: f32) -> Vec<Point> {
    let point = |number: usize| {
        let angle = (number % 900) as f32 * 0.4_f32.to_radians() + shift;
        let range_m = 3.0 + (number / 900) as f32 * 1.5;
        let (sin, cos) = angle.sin_cos();
        bytemuck::cast::<[f32; 4], Point>([range_m * cos, range_m * sin, -height_m, 0.5])
    };
    (0..900 * 40).map(point).collect()
}

/// What a VLP-16 sees of a wide floor, and of a ceiling at this height above it.
fn floor(height_m: f32, ceiling_m: f32) -> Vec<Point> {
    let point = |number: u16| {
        let (sin, cos) = (f32::from(number / 16) * 0.4).to_radians().sin_cos();
        let slope = (f32::from(number % 16) * 2.0 - 15.0).to_radians().tan();
        let z_m = if slope < 0.0 { -height_m } else { ceiling_m - height_m };
        let at_m = z_m / slope;
        let point = [at_m * cos, at_m * sin, z_m, 0.5];
        (at_m < 90.0).then(|| bytemuck::cast::<[f32; 4], Point>(point))
    };
    (0..16 * 900).filter_map(point).collect()
}

#[test]
fn open_ground_and_low_ceilings_are_no_faults() {
    let mut sensor = SensorProfile::load("vlp-16").expect("a product");
    let takes = Takes { height_m: [0.3, 3.0], ..TAKES };
    for (height_m, ceiling_m) in [(1.7, f32::MAX), (0.4, f32::MAX), (0.5, 2.5), (0.8, 2.8)] {
        sensor.height_m = Some(height_m);
        let mut expected = expected(takes.clone());
        expected.sensor = Some(sensor.clone());
        let mut guard = Guard::new(expected);
        let found = guard.check(&floor(height_m, ceiling_m), &DecodeReport::default());
        assert_eq!(found, [], "{height_m} {ceiling_m}");
    }
}

#[test]
fn a_tilt_beyond_the_limit_and_its_margin_is_told() {
    let is_told = |pitch_deg| {
        let found = SensorEstimate {
            points: 20_000,
            height_m: Some(1.5),
            pitch_deg,
            ..SensorEstimate::default()
        };
        let mut reasons = vec![];
        expected(TAKES).judge(&found, &mut reasons);
        reasons.iter().any(|r| r.flag() == Flags::SUSPECT_TILT)
    };
    assert_eq!([5.9, -5.9, 6.1, -6.1].map(is_told), [false, false, true, true]);
}

#[test]
fn a_fault_that_begins_is_told_within_ten_scans_and_forgotten_when_it_ends() {
    let mut guard = Guard::new(expected(TAKES));
    let report = DecodeReport::default();
    let mut told = Vec::new();
    for scan in 0..40 {
        let height_m = if (9..20).contains(&scan) { 0.5 } else { 1.5 };
        let points = ground(height_m, scan as f32 * 0.001);
        told.push(guard.check(&points, &report).to_vec());
    }
    let has = |scan: usize| !told[scan].is_empty();
    assert!(!has(9) && has(19) && !has(36), "{told:?}");
    let text = told[19][0].to_string();
    let start = "sensor 0.50 m above the ground, expected 1.00 to 2.00 m: ";
    assert!(text.starts_with(start), "{text}");
    assert_eq!(told[19][0].flag(), Flags::SUSPECT_HEIGHT);
}

#[test]
fn columns_and_a_field_that_are_not_the_given_sensors_are_told() {
    let mut sensor = SensorProfile::load("vlp-16").expect("a product");
    sensor.field_deg = Some([0.0, 120.0]);
    let mut expected = expected(TAKES);
    let found = |step_deg: f32, middle_deg: f32| SensorEstimate {
        points: 20_000,
        beams: 16,
        are_beams_clear: true,
        elevations_deg: sensor.elevations_deg.clone(),
        vertical_field_deg: sensor.vertical_field_deg(),
        azimuth_step_deg: Some(step_deg),
        field_deg: [middle_deg, 118.0],
        ..SensorEstimate::default()
    };
    expected.sensor = Some(sensor.clone());
    expected.takes.beams = [38, 103];
    let step_deg = sensor.azimuth_step_deg;
    let told = |found: &SensorEstimate, flag: Flags| {
        let mut reasons = vec![];
        expected.judge(found, &mut reasons);
        reasons.retain(|reason| reason.flag() == flag);
        reasons
    };
    let (sensor, field) = (Flags::SUSPECT_SENSOR, Flags::SUSPECT_FIELD);
    let mut half = found(2.0 * step_deg, 5.0);
    assert_eq!((told(&half, sensor), told(&half, field)), (vec![], vec![]));
    half.field_deg[1] = 40.0;
    let gap = told(&half, field);
    assert!(matches!(gap[..], [Reason::Field(75.0..85.0)]), "{gap:?}");
    let wide = found(3.0 * step_deg, 0.0);
    let step = Reason::SensorStep(3.0 * step_deg, step_deg);
    assert_eq!(told(&wide, sensor), [step]);
    let aside = found(step_deg, -170.0);
    assert_eq!(told(&aside, sensor), [Reason::SensorField(169.0)]);
    let beams = Reason::Beams(16, [38, 103]);
    assert_eq!(told(&aside, Flags::SUSPECT_BEAMS), [beams]);
    let blind = [Reason::IntensityMissing];
    assert_eq!(told(&aside, Flags::SUSPECT_INTENSITY), blind);
}

#[test]
fn scans_from_elsewhere_in_another_unit_or_with_returns_at_one_place_are_told() {
    type Change = fn(usize, [f32; 3]) -> [f32; 3];
    let cases: [(Change, &str); 9] = [
        (|_, [x, y, z]| [x + 200.0, y + 90.0, z], "map coordinates"),
        (|_, [x, y, z]| [x, y, z + 130.0], "map coordinates"),
        (|_, [x, y, z]| [x, y, z - 130.0], "map coordinates"),
        (|_, [x, y, z]| [x, y, z + 520.0], "map coordinates"),
        (|_, [x, y, z]| [x, y, z - 2600.0], "map coordinates"),
        (|_, at| at.map(|v| v * 0.01), "scaled twice"),
        (|i, at| [at, [5.0; 3]][i % 2], "lie at one place"),
        (|i, at| [at, [3e38; 3]][usize::from(i % 200 == 0)], ""),
        (|_, at| at, ""),
    ];
    for (change, words) in cases {
        let mut scan = ground(1.5, 0.0);
        for (i, p) in scan.iter_mut().enumerate() {
            [p.x_m, p.y_m, p.z_m] = change(i, [p.x_m, p.y_m, p.z_m]);
        }
        let mut guard = Guard::new(expected(TAKES));
        let reasons = guard.check(&scan, &DecodeReport::default());
        let found = reasons.iter().map(Reason::to_string).collect::<String>();
        assert!(found.contains(words) && found.is_empty() == words.is_empty(), "{words}: {found}");
    }
}

#[test]
fn a_bridge_is_no_other_unit() {
    let (street, below) = (ground(1.5, 0.0), ground(5.0, 0.0));
    let (height, unit) = (Flags::SUSPECT_HEIGHT, Flags::SUSPECT_UNIT);
    for (scans_before, looks, expected_flag) in [(0, 2, unit), (1, 2, height), (1, 310, unit)] {
        let mut guard = Guard::new(expected(TAKES));
        let scans = std::iter::repeat_n(&street, scans_before);
        scans.chain(std::iter::repeat_n(&below, looks)).for_each(|scan| guard.look(scan, 0));
        let flags = guard.reasons.iter().map(Reason::flag);
        assert_eq!(flags.collect::<Vec<_>>(), [expected_flag], "{looks}");
    }
}

#[test]
fn the_same_scan_four_times_is_frozen_and_empty_ones_are_not() {
    let mut guard = Guard::new(expected(TAKES));
    let report = DecodeReport::default();
    let frozen = |guard: &mut Guard, points: &[Point]| {
        guard.check(points, &report).iter().any(|r| r.flag() == Flags::SUSPECT_FROZEN)
    };
    let scan = ground(1.5, 0.0);
    let told: Vec<bool> = (0..6).map(|_| frozen(&mut guard, &scan)).collect();
    assert_eq!(told, [false, false, false, true, true, true]);
    assert!(!frozen(&mut guard, &ground(1.5, 0.1)));
    assert!((0..6).all(|_| !frozen(&mut guard, &[])));
}
