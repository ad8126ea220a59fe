//! Made packets of every family (`families.txt`) through detection, cutting, loss and times; hostile ones. `tests/tests/oracle_packets.rs` has recorded ones.

use super::*;
use mluc_ipc_types::POINTS_MAX;
use proptest::prelude::*;
use std::net::SocketAddr;

/// 2023-11-14, 22:00 UTC.
pub(crate) const HOUR_NS: u64 = 1_699_999_200_000_000_000;
const NEAR: u16 = 2500;
const FAR: u16 = 5000;

/// A line of `families.txt`.
#[derive(Clone, Debug)]
struct Kind {
    product: String,
    calibration: Option<String>,
    per_turn: u32,
    points_per_packet: usize,
    interval_ns: u64,
    unit_m: f32,
    packet: Vec<String>,
}

fn kinds() -> Vec<Kind> {
    let lines = include_str!("families.txt").lines();
    let kind = |line: &str| {
        let parts: Vec<&str> = line.split("; ").collect();
        let numbers: Vec<u64> = parts[2].split(' ').map(|n| n.parse().unwrap()).collect();
        Kind {
            product: parts[0].into(),
            calibration: match parts[1].split_once(' ') {
                Some(("yaml", lasers)) => Some(yaml(lasers.parse().unwrap())),
                Some(("csv", channels)) => Some(csv(channels.parse().unwrap())),
                Some((_, profile)) => Some(metadata(profile)),
                None => None,
            },
            per_turn: numbers[0] as u32,
            points_per_packet: numbers[1] as usize,
            interval_ns: numbers[2],
            unit_m: numbers[3] as f32 / 1000.0,
            packet: parts[3].split(' ').map(String::from).collect(),
        }
    };
    lines.filter(|l| !l.starts_with('#')).map(kind).collect()
}

fn yaml(lasers: usize) -> String {
    let angle = |id| 0.1 - id as f32 * 0.003;
    let laser = |id| format!("- {{laser_id: {id}, vert_correction: {}}}\n", angle(id));
    let lasers: String = (0..lasers).map(laser).collect();
    format!("lasers:\n{lasers}")
}

fn csv(channels: usize) -> String {
    let channel = |id| format!("{id},{},-1.042\n", 15 - id);
    let channels: String = (1..=channels as i32).map(channel).collect();
    format!("Laser id,Elevation,Azimuth\n{channels}\n")
}

fn metadata(profile: &str) -> String {
    format!(
        r#"{{"beam_intrinsics": {{"beam_altitude_angles": [20, 5, -5, -20], "beam_azimuth_angles": [3, 1, -1, -3], "lidar_origin_to_beam_origin_mm": 0}},
        "lidar_data_format": {{"columns_per_frame": 512, "columns_per_packet": 16, "pixels_per_column": 4, "udp_profile_lidar": "{profile}"}},
        "lidar_intrinsics": {{"lidar_to_sensor_transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}}, "sensor_info": {{"prod_line": "OS-1-4"}}}}"#
    )
}

impl Kind {
    /// The n-th packet since azimuth 0. Of two returns the last is `FAR`, the strongest `NEAR`.
    fn packet(&self, n: u32, ns: u64) -> Vec<u8> {
        let numbers: Vec<usize> = self.packet[1..].iter().map(|n| n.parse().unwrap()).collect();
        match (&self.packet[0][..], &numbers[..]) {
            ("velodyne", &[product, alike, step, mode, last_bank]) => {
                velodyne([product, alike, step, mode, last_bank], n, ns)
            }
            ("hesai", &[channels, blocks, step, mode]) => {
                hesai(channels, blocks, step as u32, mode as u8, n, ns)
            }
            ("ouster", &[a, b, c, d, e]) => ouster([a, b, c, d, e], n, ns),
            other => panic!("{other:?}"),
        }
    }

    fn decoder(&self) -> Decoder {
        let text = self.calibration.as_ref();
        let calibration = text.map(|text| Calibration::parse(text).unwrap());
        let packet = self.packet(0, HOUR_NS);
        let found = Detector::new(calibration.as_ref()).look(&datagram(0, &packet)).unwrap();
        found.expect(&self.product)
    }
}

pub(crate) fn velodyne(numbers: [usize; 5], n: u32, ns: u64) -> Vec<u8> {
    let [product, alike, step, mode, last_bank] = numbers;
    let mut bytes = vec![];
    for block in 0..12 {
        let column = n as usize * 12 / alike + block / alike;
        bytes.extend([0xFFu8, 0xEE - 0x11 * (block % (last_bank + 1)) as u8]);
        bytes.extend(((column * step % 36_000) as u16).to_le_bytes());
        let is_last = product != 7 && mode == 0x39 && block % 2 == 0;
        let [low, high] = if is_last { FAR } else { NEAR }.to_le_bytes();
        bytes.extend([low, high, 51].repeat(32));
    }
    bytes.extend((((ns / 1000) % 3_600_000_000) as u32).to_le_bytes());
    bytes.extend([mode as u8, product as u8]);
    bytes
}

fn hesai(channels: usize, blocks: usize, step: u32, mode: u8, n: u32, ns: u64) -> Vec<u8> {
    let (header, mark, shot): (&[u8], &[u8], usize) = match channels {
        40 => (&[], &[0xFF, 0xEE], 3),
        64 => (&[0xEE, 0xFF, 64, 6, 0, 4, 0, 4], &[], 3),
        _ => (&[0xEE, 0xFF, 6, 1, 0, 0, 32, 8, 1, 4, 2, 1], &[], 4),
    };
    let returns = if mode == 0x39 { 2 } else { 1 };
    let mut bytes = header.to_vec();
    for block in 0..blocks {
        let column = n * (blocks / returns) as u32 + (block / returns) as u32;
        bytes.extend(mark);
        bytes.extend(((column * step % 36_000) as u16).to_le_bytes());
        let is_last = returns == 2 && block % 2 == 0;
        let [low, high] = if is_last { FAR } else { NEAR }.to_le_bytes();
        bytes.extend([low, high, 51, 0][..shot].repeat(channels));
    }
    let date = [[123, 11, 14, 21, 59, 59], [123, 11, 14, 22, 0, 0]];
    let date = &date[usize::from(ns >= HOUR_NS)][..];
    let micros = &((ns % 1_000_000_000 / 1000) as u32).to_le_bytes()[..];
    let tail = match channels {
        32 => [&[0; 10], &[mode, 88, 2][..], date, micros, &[0x42]].concat(),
        _ => [&[0; 10], micros, &[mode, 0x42], date].concat(),
    };
    bytes.extend(tail);
    bytes.extend(n.to_le_bytes());
    bytes
}

/// Sizes of header, column header, pixel, column footer, footer. The second echo is none.
fn ouster(sizes: [usize; 5], n: u32, ns: u64) -> Vec<u8> {
    let [header, column, pixel, tail, footer] = sizes;
    let [low, high] = ((n / 32) as u16).to_le_bytes();
    let mut bytes = [1, 0, low, high].repeat(8)[..header].to_vec();
    for i in 0..16 {
        let start = bytes.len();
        bytes.extend((ns + i * 3_125_000 / 16).to_le_bytes());
        bytes.extend((((n % 32) * 16) as u16 + i as u16).to_le_bytes());
        // Of the old layout the frame, else that it is valid.
        bytes.extend(if tail > 0 { [low, high] } else { [1, 0] });
        bytes.resize(start + column, 0);
        let reflectivity_at = [4, 2, 3][(pixel == 4) as usize + 2 * (pixel == 16) as usize];
        for _ in 0..4 {
            let mut shot = vec![0; pixel];
            shot[..2].copy_from_slice(&NEAR.to_le_bytes());
            shot[reflectivity_at] = 51;
            bytes.extend(shot);
        }
        bytes.extend(vec![0xFF; tail]);
    }
    bytes.resize(bytes.len() + footer, 0);
    bytes
}

fn datagram(stamp_ns: u64, payload: &[u8]) -> Datagram<'_> {
    Datagram {
        stamp_ns,
        from: SocketAddr::from(([192, 168, 1, 201], 2368)),
        to_port: 2368,
        payload,
    }
}

#[test]
fn every_family_gives_revolutions_with_times_and_counts_what_is_lost() {
    for kind in kinds() {
        let (product, mut decoder) = (&kind.product, kind.decoder());
        assert!(decoder.product().starts_with(product), "{product}");
        let mut scans: Vec<Revolution> = vec![];
        let mut keep = |scan: &Revolution| scans.push(scan.clone());
        // From the middle of a turn to the middle of the fourth, over the full hour, one packet lost and one of another sender in its place; two lost
        // where the third turn begins.
        let middle = kind.per_turn / 2;
        let border = 2 * kind.per_turn - 1..=2 * kind.per_turn;
        for n in (middle..middle + 3 * kind.per_turn).filter(|n| !border.contains(n)) {
            let since = i64::from(n) - 2 * i64::from(kind.per_turn);
            let ns = HOUR_NS.saturating_add_signed(since * kind.interval_ns as i64);
            let packet = kind.packet(n, ns);
            let mut datagram = datagram(ns, &packet);
            if n == middle + kind.per_turn {
                datagram.from.set_ip([192, 168, 1, 202].into());
            }
            decoder.push(&datagram, &mut keep);
        }
        decoder.finish(&mut keep);
        let expected = Counts {
            packets: u64::from(3 * kind.per_turn - 3),
            other_traffic: 1,
            lost: 3,
            revolutions: 4,
            ..Counts::default()
        };
        assert_eq!(decoder.counts(), expected, "{product}");
        let told = scans.iter().map(|s| (s.is_partial, s.packets_lost));
        let expected = [(true, 0), (false, 2), (false, 1), (true, 0)];
        assert_eq!(told.collect::<Vec<_>>(), expected, "{product}");
        for (scan, packets) in [(&scans[1], kind.per_turn - 2), (&scans[2], kind.per_turn - 1)] {
            let points = packets as usize * kind.points_per_packet;
            assert_eq!(scan.points.len(), points, "{product}");
            check_points(&kind, scan);
        }
        let turn_ns = scans[2].stamp_ns - scans[1].stamp_ns;
        let expected_ns = u64::from(kind.per_turn + 1) * kind.interval_ns;
        assert!(turn_ns.abs_diff(expected_ns) < 2000, "{product}: {turn_ns}");
    }
}

#[test]
fn a_late_packet_begins_no_turn() {
    let (kind, mut points) = (&kinds()[0], vec![]);
    let mut decoder = kind.decoder();
    let mut order: Vec<u32> = (40..40 + 3 * kind.per_turn).collect();
    order.swap(100, 101);
    for n in order {
        let ns = HOUR_NS + u64::from(n) * kind.interval_ns;
        let packet = kind.packet(n, ns);
        let mut keep = |turn: &Revolution| points.push(turn.points.len() / kind.points_per_packet);
        // Each one twice, as a recording at two interfaces has it.
        decoder.push(&datagram(ns, &packet), &mut keep);
        decoder.push(&datagram(ns, &packet), &mut keep);
    }
    let late = u64::from(1 + 3 * kind.per_turn);
    assert_eq!((points, decoder.counts().late), (vec![35, 75, 75], late));
}

#[test]
fn turns_around_a_silence_are_partial() {
    for kind in kinds() {
        let (mut decoder, mut turns) = (kind.decoder(), vec![]);
        let mut keep = |turn: &Revolution| turns.push(turn.is_partial);
        // Silence from the middle of the second turn to a tenth of the eighth.
        let turn = kind.per_turn;
        let away = 7 * turn;
        let before = 0..turn + turn / 2;
        for n in before.chain(away + turn / 10..away + 3 * turn) {
            let ns = HOUR_NS - 900_000_000 + u64::from(n) * kind.interval_ns;
            decoder.push(&datagram(ns, &kind.packet(n, ns)), &mut keep);
        }
        decoder.finish(&mut keep);
        let expected = [true, true, true, false, true];
        assert_eq!(turns, expected, "{}", kind.product);
    }
}

/// Times, ranges, and that the head turns clockwise from ahead.
fn check_points(kind: &Kind, scan: &Revolution) {
    let product = &kind.product;
    // A packet comes when its first or its last shot is made.
    let age_ns = scan.received_ns.abs_diff(scan.stamp_ns);
    assert!(age_ns < 4_000_000, "{product}: {age_ns}");
    for (i, point) in scan.points.iter().enumerate() {
        let found_m = point.x_m.hypot(point.y_m).hypot(point.z_m);
        let is_at = |range: u16| (found_m - f32::from(range) * kind.unit_m).abs() < 1e-3;
        assert!(is_at(NEAR) || is_at(FAR), "{product}: {point:?}");
        assert_eq!(point.intensity, 0.2);
        // Beams have azimuths of their own, a packet was lost.
        let off = azimuth_off(kind, scan, i);
        assert!(off.abs() < 0.04, "{product}: {off}");
    }
}

/// Of a point's azimuth from that of its time, in turns.
fn azimuth_off(kind: &Kind, scan: &Revolution, point: usize) -> f64 {
    let turn_ns = f64::from(kind.per_turn) * kind.interval_ns as f64;
    let share = f64::from(scan.offsets_ns[point]) / turn_ns;
    let point = scan.points[point];
    let azimuth = f64::from(-point.y_m).atan2(point.x_m.into()) / std::f64::consts::TAU;
    (azimuth - share + 0.5).rem_euclid(1.0) - 0.5
}

/// Two returns fill eight blocks with one firing.
fn dual_vls_128(n: u32, ns: u64) -> Vec<u8> {
    let mut packet = velodyne([161, 12, 20, 0x39, 0], n, ns);
    (0..8).for_each(|block| packet[block * 100 + 1] -= 0x11 * (block / 2) as u8);
    packet[800..1200].fill(0);
    packet
}

#[test]
fn every_firing_of_a_vls_128_turns_on() {
    let all = kinds();
    let kind = all.iter().find(|kind| kind.calibration == Some(yaml(128))).expect("a VLS-128");
    for is_dual in [false, true] {
        let (mut decoder, mut offs) = (kind.decoder(), vec![]);
        let mut keep = |scan: &Revolution| {
            let points = 0..scan.points.len();
            offs.push(points.map(|i| azimuth_off(kind, scan, i)).collect::<Vec<_>>());
        };
        let firings = if is_dual { 1 } else { 3 };
        // A packet is lost.
        for n in (0..3 * 1800 / firings).filter(|n| *n != 900) {
            let ns = HOUR_NS + u64::from(n * firings) * 53_300;
            let packet = if is_dual { dual_vls_128(n, ns) } else { kind.packet(n, ns) };
            decoder.push(&datagram(ns, &packet), &mut keep);
        }
        // A firing takes some 0.2 degrees.
        for offs in &mut offs[1..] {
            offs.sort_unstable_by(f64::total_cmp);
            let spread_deg = 360.0 * (offs[offs.len() - 1] - offs[0]);
            assert!(spread_deg < 0.03, "{is_dual}: {spread_deg}");
        }
    }
}

#[test]
fn a_sector_that_is_left_out_is_no_loss_and_no_part_of_another_turn() {
    let kind = &kinds()[0];
    let turns_of = |turns: u32, sees: fn(u32) -> bool| {
        let (mut decoder, mut found) = (kind.decoder(), vec![]);
        let mut keep = |scan: &Revolution| found.push((scan.is_partial, scan.points.len()));
        for n in (0..turns * kind.per_turn).filter(|n| sees(n % kind.per_turn)) {
            let ns = HOUR_NS + u64::from(n) * kind.interval_ns;
            decoder.push(&datagram(ns, &kind.packet(n, ns)), &mut keep);
        }
        decoder.finish(&mut keep);
        (found, decoder.counts().lost)
    };
    // From 100.8 to 259.2 degrees alone. The first gap cannot be told from a loss.
    let points = 33 * kind.points_per_packet;
    let expected = [true, false, false, true].map(|is_partial| (is_partial, points));
    let found = turns_of(4, |n| (21..54).contains(&n));
    assert_eq!(found, (expected.to_vec(), 42));
    // From 259.2 over 0 to 67.2 degrees: one scan per turn after the first two.
    let (found, _) = turns_of(8, |n| !(14..54).contains(&n));
    assert_eq!(found[4..8], [(false, 35 * kind.points_per_packet); 4]);
}

#[test]
fn a_sector_that_is_left_out_within_packets_gives_whole_turns() {
    let kind = &kinds()[0];
    for [from_deg, to_deg] in [[315, 45], [300, 60], [270, 90], [90, 270]] {
        let is_seen = |column: &u64| {
            let deg = column % 900 * 2 / 5;
            let is_aside = !(to_deg..from_deg).contains(&deg);
            is_aside && (from_deg > to_deg || (from_deg..to_deg).contains(&deg))
        };
        let columns: Vec<u64> = (0..30 * 900).filter(is_seen).collect();
        let (mut decoder, mut found) = (kind.decoder(), vec![]);
        let mut keep = |scan: &Revolution| found.push((scan.points.len(), scan.packets_lost));
        // The sensor fills a packet with the firings after the sector.
        for packet in columns.chunks_exact(12) {
            let [first_ns, last_ns] = [0, 11].map(|i| HOUR_NS + packet[i] * 110_592);
            let mut bytes = kind.packet(0, first_ns);
            for (block, column) in packet.iter().enumerate() {
                let azimuth_cdeg = (column % 900 * 40) as u16;
                bytes[block * 100 + 2..][..2].copy_from_slice(&azimuth_cdeg.to_le_bytes());
            }
            decoder.push(&datagram(last_ns, &bytes), &mut keep);
        }
        let whole = ((0..900).filter(is_seen).count() * 32, 0);
        let are_whole = found[4..].iter().all(|turn| *turn == whole);
        assert!(are_whole && found.len() > 25, "{from_deg} {whole:?} {found:?}");
    }
}

#[test]
fn equal_returns_are_one_point_and_no_return_is_none() {
    let points_of = |change: fn(&mut [u8])| {
        let kind = &kinds()[1];
        let mut packet = kind.packet(0, 0);
        change(&mut packet);
        let far_m = f32::from(FAR) * kind.unit_m - 1.0;
        let is_far = |p: &&Point| p.x_m.hypot(p.y_m).hypot(p.z_m) > far_m;
        let (mut decoder, mut points) = (kind.decoder(), [0; 2]);
        let mut keep = |scan: &Revolution| {
            points = [scan.points.len(), scan.points.iter().filter(is_far).count()];
        };
        decoder.push(&datagram(0, &packet), &mut keep);
        decoder.finish(&mut keep);
        points
    };
    let neither = |packet: &mut [u8]| [4, 5, 104, 105].iter().for_each(|at| packet[*at] = 0);
    let found = [
        points_of(|_| ()),
        points_of(|p| p[4..6].fill(0)),
        points_of(neither),
        points_of(|p| p.copy_within(4..6, 104)),
    ];
    // All, and those of the far return.
    assert_eq!(found, [[384, 192], [383, 191], [382, 191], [383, 192]]);
}

#[test]
fn a_revolution_that_never_ends_stops_growing() {
    let kind = &kinds()[0];
    let (mut packet, mut decoder) = (kind.packet(0, 0), kind.decoder());
    let mut held = 0;
    let mut keep = |scan: &Revolution| held = scan.points.len();
    for _ in 0..2_800 {
        // An intensity: of equal packets only the first counts.
        packet[6] ^= 1;
        decoder.push(&datagram(0, &packet), &mut keep);
    }
    decoder.finish(&mut keep);
    assert_eq!(held, 4 * POINTS_MAX);
}

#[test]
fn another_sensors_calibration_and_other_traffic_are_said() {
    let kinds = kinds();
    let packet = |kind: usize| kinds[kind].packet(0, 0);
    let legacy = "LEGACY, packets of 1088 bytes, found datagrams of [512]";
    let hesai = "a Hesai with 40 channels, found Velodyne";
    let velodyne = "a Velodyne with 16 lasers, found Velodyne";
    let cases = [
        (packet(0), csv(40), hesai),
        (packet(1), yaml(16), velodyne),
        (packet(3), String::new(), "the YAML file of this Velodyne"),
        (packet(6), csv(40), "40 channels, found Hesai Pandar64"),
        (packet(9), metadata("LEGACY"), legacy),
        (packet(9), String::new(), "found datagrams of [512] bytes"),
        (vec![1; 5], String::new(), "found datagrams of [5] bytes"),
    ];
    for (packet, text, expected) in cases {
        let calibration = Calibration::parse(&text).ok();
        let mut detector = Detector::new(calibration.as_ref());
        let found = match detector.look(&datagram(0, &packet)) {
            Ok(found) => found.map_or(detector.not_found(), |_| panic!("{expected}")),
            Err(error) => error,
        };
        assert!(found.to_string().contains(expected), "{found}");
    }
}

#[test]
fn a_calibration_that_cannot_be_is_an_error_with_its_place() {
    let legacy = metadata("LEGACY");
    let not_a_number = yaml(16).replace("correction: 0.1}", "correction: .nan}");
    let named_twice = yaml(16).replace("id: 3", "id: 4");
    let too_few = legacy.replace("[20, 5", "[5");
    let formats = "Velodyne's YAML, Hesai's CSV or Ouster's JSON";
    // A named format, a checksum, and metadata of old firmware are fine.
    let named = csv(40).replacen("Laser", "EEFF,1\nLaser", 1) + "0123abcd\n";
    let old = legacy.replace("_mm\"", "\"");
    assert!([named, old].iter().all(|text| Calibration::parse(text).is_ok()));
    let cases = [
        (String::new(), formats),
        ("lasers: 5".into(), "YAML: expected a list `lasers`"),
        (named_twice, "each laser_id from 0 on"),
        (not_a_number, "laser 0"),
        (yaml(16) + "distance_resolution: 7\n", "distance_resolution"),
        (csv(40).replace("\n3,", "\n5,"), "line 4"),
        (csv(40).replace("\n3,12,", "\n3,twelve,"), "line 4"),
        (csv(300), "line 107"),
        ("{".into(), "JSON"),
        ("{}".into(), "missing field `beam_altitude_angles`"),
        (metadata("RNG99"), "udp_profile_lidar: expected LEGACY"),
        (too_few, "found 3 altitudes, 512 columns"),
        (legacy.replace("512", "99999999"), "1 to 4096 columns"),
        (legacy.replace("[3, 1", "[3, 2e5"), "100000, found 200000"),
        (" ".repeat(5 << 20), "at most 4194304 bytes"),
    ];
    for (text, expected) in cases {
        let found = Calibration::parse(&text).unwrap_err().to_string();
        assert!(found.contains(expected), "{found}");
    }
}

/// A packet's number and time, bytes that are changed, where it is cut.
fn damage() -> impl Strategy<Value = (u32, u64, Vec<(usize, u8)>, Option<usize>)> {
    let changes = prop::collection::vec((0..9000usize, any::<u8>()), 0..40);
    let (number, ns, cut) = (0..100_000u32, 0..u64::MAX / 2, 0..9000usize);
    (number, ns, changes, prop::option::of(cut))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Packets of a sensor, cut short, with changed bytes, from random times: counted one way or another, bounded, never a panic.
    #[test]
    fn hostile_packets_are_counted(kind in 0..12usize, packets in prop::collection::vec(damage(), 1..40)) {
        let kind = &kinds()[kind];
        let (mut decoder, mut points, pushed) = (kind.decoder(), 0, packets.len());
        let mut check = |scan: &Revolution| {
            assert!(scan.points.iter().all(Point::is_finite));
            assert_eq!(scan.offsets_ns.len(), scan.points.len());
            points += scan.points.len();
        };
        for (n, ns, changes, cut) in packets {
            let mut packet = kind.packet(n, ns);
            let bytes = packet.len();
            changes.iter().for_each(|(at, value)| packet[at % bytes] = *value);
            packet.truncate(cut.map_or(bytes, |cut| cut % bytes));
            decoder.push(&datagram(ns, &packet), &mut check);
        }
        decoder.finish(&mut check);
        let counts = decoder.counts();
        prop_assert_eq!(counts.packets + counts.damaged + counts.other_traffic, pushed as u64);
        prop_assert!(points <= pushed * 2 * kind.points_per_packet);
    }
}
