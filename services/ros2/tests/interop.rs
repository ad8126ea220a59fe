//! Another implementation at both ends: Cyclone DDS publishes clouds and reads objects (`cyclone.py`).

use mluc::bundled::BundledScans;
use mluc_tests::{Running, Setting, built_program, python_with, root, skip, write_file};
use std::{net::UdpSocket, process::Command, time::Duration};

/// Multicast may be missing, so participants of this machine are contacted one by one.
const CYCLONE: &str = "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast></General><Discovery>\
    <ParticipantIndex>auto</ParticipantIndex><Peers><Peer address='localhost'/></Peers></Discovery></Domain></CycloneDDS>";

/// `cyclone.py`, without arguments; `None`, with a message: Cyclone DDS or a network is missing.
fn cyclone() -> Option<Command> {
    let mut cyclone = Command::new(python_with("cyclonedds")?);
    cyclone.arg(root().join("services/ros2/tests/cyclone.py"));
    cyclone.env("CYCLONEDDS_URI", CYCLONE);
    let socket = UdpSocket::bind("0.0.0.0:0").expect("a socket");
    if socket.connect("239.255.0.1:7400").is_err() {
        let why = "no network beside loopback, on which rustdds sends nothing";
        skip("mluc-ros2", why);
        return None;
    }
    Some(cyclone)
}

#[test]
fn cyclone_dds_feeds_the_pipeline_and_reads_its_objects() {
    let Some(mut cyclone) = cyclone() else { return };
    let mut setting = Setting::new("ros2", 3);
    let expected = setting.run("").lines;
    let told = setting.folder.path().join("expected.jsonl");
    let lines = expected.iter().map(|line| format!("{line}\n"));
    write_file(&told, lines.collect::<String>());
    let scans = std::mem::replace(&mut setting.input, "ros2:/points".into());
    // A domain that no other test and no robot next to this machine uses. Above 101 its ports are those that any socket may get.
    let domain = (51 + std::process::id() % 50).to_string();
    let start = |command: &mut Command| Running::start(command.env("ROS_DOMAIN_ID", &domain));
    let mut run = start(&mut setting.up_command("--pace sensor"));
    let mut publish = Command::new(built_program("mluc"));
    let publish = start(publish.args(["publish", "--instance", &setting.instance]));
    run.wait_for_words("listening");
    let mut doctor = Command::new(built_program("mluc"));
    let doctor = start(doctor.args(["doctor", "--input", "ros2:/points"]));
    // Cyclone's script compares the objects of each cloud with the objects of its file.
    let topics = format!("mluc_{}", setting.instance.replace('-', "_"));
    let cyclone = cyclone.args([scans, told]).arg(topics);
    let cyclone = start(cyclone).finish_within(Duration::from_secs(120));
    let log = [&*cyclone.log, &run.log(), &publish.log()].concat();
    assert_eq!(cyclone.code, Some(0), "{log}");
    let doctor = doctor.finish().text();
    let mut lines = doctor.lines();
    let looked = lines.find_map(|line| line.split_once(" scans of "));
    assert!(looked.is_some_and(|(count, _)| !count.ends_with(" 0")), "{doctor}");
    run.wait_for_words("expected one named y, found x, z, intensity");
    publish.stop().assert_says(&["dropped=0"]);
    let run = setting.stop(run);
    let mut damaged = 0;
    for line in &run.lines {
        let second = line["stamp_ns"].as_u64().expect("a stamp") / 1_000_000_000;
        match expected.get(second as usize - 1) {
            Some(expected) => assert_eq!(line["objects"], expected["objects"], "{second}"),
            None => damaged += line["flags"].to_string().matches("damaged_input").count(),
        }
    }
    assert!(damaged > 0, "no frame in place of the cloud without y");
}

/// A sensor that drives while it turns gives the objects of a sensor that stands still: by odometry, and by transforms.
#[test]
fn points_are_corrected_by_odometry_and_by_transforms() {
    let Some(mut cyclone) = cyclone() else { return };
    let mut setting = Setting::new("ros2-motion", 0);
    // Real objects stay the same when rounding moves the points.
    setting.model = "any-open".into();
    let bundled = BundledScans::write("ros2-motion").expect("a folder");
    setting.input = bundled.folder().join("velodyne");
    let expected = setting.run("").lines;
    let told = setting.folder.path().join("expected.jsonl");
    write_file(&told, "");
    let scans = std::mem::replace(&mut setting.input, "ros2:/points".into());
    let domain = (1 + std::process::id() % 50).to_string();
    let start = |command: &mut Command| Running::start(command.env("ROS_DOMAIN_ID", &domain));
    cyclone.args([&scans, &told]).arg("moving");
    for option in ["", "--odometry /tf"] {
        let mut run = start(&mut setting.up_command(&format!("--pace sensor --deskew {option}")));
        run.wait_for_words("listening");
        let _cyclone = start(&mut cyclone);
        run.wait_for_lines(25);
        let run = setting.stop(run);
        let mut seen = vec![0; expected.len()];
        for line in &run.lines {
            if line["flags"].to_string().contains("degraded") {
                continue;
            }
            let second = line["stamp_ns"].as_u64().expect("a stamp") / 1_000_000_000;
            let scan = (second as usize - 10) % expected.len();
            let [found, wanted] = [line, &expected[scan]].map(|line| {
                let objects = line["objects"].as_array().expect("objects").iter();
                let places = objects.map(|object| object["center_m"].clone());
                places
                    .map(|at_m| [0, 1, 2].map(|axis| at_m[axis].as_f64().expect("a place")))
                    .collect::<Vec<_>>()
            });
            let is_found = |b: &&[f64; 3]| {
                let mut near = found.iter().map(|a| a.iter().zip(*b));
                near.any(|pairs| pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 0.3)
            };
            let count = wanted.iter().filter(is_found).count();
            assert!(
                !wanted.is_empty() && count * 10 >= wanted.len() * 8,
                "{option}: {found:?} {wanted:?}"
            );
            seen[scan] += 1;
        }
        assert!(seen.iter().all(|count| *count > 0), "{option}: {seen:?} {}", run.log);
    }
}
