//! What the simulator promises: the same bits for the same key, geometry that can be computed by hand, labels that read back, no unknown class in training.

use super::mesh::{Mesh, V3, v};
use super::scene::{Scene, Solid};
use super::*;
use mluc_dataset::Dataset;
use mluc_geometry::intersection_bev_m2;
use mluc_sources::Deskew;
use nalgebra::{IsometryMatrix3, Rotation3, Translation3};

/// A sensor over flat ground 1.73 m below it, with more things added by the caller.
pub(super) fn flat(things: &[(&Mesh, u16)]) -> Scene {
    let mut ground = Mesh::default();
    let g = -sensor::HEIGHT_M;
    let corners = [(-90.0, -90.0), (90.0, -90.0), (90.0, 90.0), (-90.0, 90.0)];
    ground.quad(corners.map(|(x, y)| v(x, y, g)), mesh::solid(0.9));
    let mut scene = Scene::default();
    scene.add(&ground, 0, |p| p);
    for (mesh, instance) in things {
        scene.add(mesh, *instance, |p| p);
    }
    scene
}

pub(super) fn block(center: [f32; 3], size: [f32; 3]) -> Mesh {
    let mut mesh = Mesh::default();
    mesh.block(center.into(), size.into(), mesh::solid(0.6));
    mesh
}

/// Adds a labelled block.
fn add_block(scene: &mut Scene, instance: u16, center: [f32; 3], size: [f32; 3]) -> Solid {
    let (faces, vertices) = (scene.mesh.triangles.len(), scene.mesh.vertices.len());
    scene.add(&block(center, size), instance, |p| p);
    let [[x, y, z], [l, w, h]] = [center, size].map(|of| of.map(f64::from));
    Solid {
        class: Class::Car,
        box_in_sensor: Box3::new([x, y, z, l, w, h, 0.0]),
        faces: faces..scene.mesh.triangles.len(),
        vertices: vertices..scene.mesh.vertices.len(),
    }
}

/// A turn of a usual sensor.
fn swept(key: u64, scene: &Scene) -> (sensor::Sensor, scan::Sweep) {
    let sensor = sensor::Sensor::new(key, false);
    let sweep = scan::sweep(&sensor, scene).expect("a sweep");
    (sensor, sweep)
}

/// All classes of real things, some of them twice.
pub(super) fn classes() -> impl Iterator<Item = Class> {
    let classes = |f: Family| [f.known_classes(), f.unknown_classes()].concat();
    let unseen = Split::ALL.into_iter().flat_map(Unseen::of).map(Class::Unseen);
    Family::ALL.into_iter().flat_map(classes).chain(unseen)
}

/// What changes `sim-any` must leave these as they are: the shipped networks and their figures come from them.
#[test]
fn frames_of_the_papers_families_stay_as_they_are() {
    for (family, points, objects, mean_x_m) in
        [(Family::SimUdi, 115_798, 17, -0.6782), (Family::SimKitti, 60_313, 14, 8.5295)]
    {
        let frame = frame(family, Split::Val, 1, 0, None).expect("a frame");
        let found = frame.points.len();
        let sum: f64 = frame.points.iter().map(|p| f64::from(p[0])).sum();
        let mean = sum / found as f64;
        // Another platform's sine may send a few rays past an edge.
        assert!(found.abs_diff(points) < 20, "{family:?}: {found} points");
        assert_eq!(frame.objects.len(), objects, "{family:?}");
        assert!((mean - mean_x_m).abs() < 2e-3, "{family:?}: {mean}");
    }
}

#[test]
fn a_data_set_is_the_same_bytes_with_one_and_two_threads_and_in_parts() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |threads: usize, shard: Option<[u32; 2]>| {
        let folder = folder.path().join(format!("{threads} {shard:?}"));
        let mut options = ExportOptions::new(Family::SimUdi, Split::Val, 4, 5, folder.clone());
        options.shard = shard;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| export(&options, || ())).expect("written");
        folder
    };
    let (one, two) = (run(1, None), run(2, None));
    let parts = [0, 1].map(|index| run(2, Some([index, 2])));
    let files = "velodyne/000003.bin label_2/000000.txt label_2/000003.txt instances/000002.u16 \
        calib/000001.txt planes/000001.txt ImageSets/val.txt";
    for part in files.split(' ') {
        let read = |root: &std::path::Path| std::fs::read(root.join(part));
        let [one, two] = [&one, &two].map(|root| read(root).expect("a file"));
        assert!(one == two, "{part} differs");
        assert!(!one.is_empty() || part.starts_with("label_2"), "{part}");
        let copies: Vec<_> = parts.iter().filter_map(|root| read(root).ok()).collect();
        assert!(copies.iter().all(|copy| *copy == one), "{part} differs");
        let expected = if part.starts_with("ImageSets") { 2 } else { 1 };
        assert_eq!(copies.len(), expected, "{part}");
    }
    let mut again = ExportOptions::new(Family::SimUdi, Split::Val, 1, 5, one);
    refuses(&again, "expected an empty or a new folder");
    // The roads of KITTI are dry.
    (again.family, again.without) = (Family::SimKitti, vec![Step::Weather]);
    refuses(&again, "vegetation), found weather");
}

fn refuses(options: &ExportOptions, words: &str) {
    let refused = export(options, || ()).expect_err(words).to_string();
    assert!(refused.contains(words), "{refused}");
}

#[test]
fn ground_rings_have_the_radius_of_their_elevation() {
    let (sensor, sweep) = swept(11, &flat(&[]));
    for beam in [20, 40, 63] {
        let (start, direction) = sensor.ray((beam, 100));
        let expected = (sensor::HEIGHT_M + start.z) * direction.x.hypot(direction.y) / -direction.z;
        // Rays come back beam by beam; those of one beam are found by their elevation.
        let slope = direction.z / direction.x.hypot(direction.y);
        let mut of_beam = sweep.points.iter().map(|p| (p[0].hypot(p[1]), p[2])).collect::<Vec<_>>();
        of_beam.retain(|(radius, z)| ((z - start.z) / radius - slope).abs() < 2e-4);
        let returns = of_beam.len();
        assert!(returns > 1000, "beam {beam}: {returns} returns");
        let off = of_beam.iter().map(|p| p.0).sum::<f32>() / returns as f32 - expected;
        // A beam's own bias is up to 3.5 cm.
        assert!(off.abs() < 0.05, "beam {beam}: {off} m from {expected} m");
    }
}

#[test]
fn a_block_returns_as_many_points_as_its_angles_say() {
    for range_m in [10.0f32, 18.0] {
        let (width, height) = (2.0, 1.4);
        let thing = block([range_m + 0.5, 0.0, -0.9], [1.0, width, height]);
        let (sensor, sweep) = swept(3, &flat(&[(&thing, 1)]));
        let found = sweep.instances.iter().filter(|i| **i == 1).count() as f32;
        let columns = 2.0 * (width / 2.0 / range_m).atan().to_degrees() / 0.1728;
        // The block lies in the upper beams, 0.34 degrees apart.
        let beams = ((-0.2f32 / range_m).atan() - (-1.6f32 / range_m).atan()).to_degrees() / 0.34;
        let expected = columns * beams * (1.0 - sensor.base_drop);
        let share = found / expected;
        assert!((share - 1.0).abs() < 0.2, "{range_m} m: {found} points");
    }
}

#[test]
fn a_moving_sensor_reports_what_it_saw_on_its_way_and_labels_lie_there() {
    // 10 m/s ahead; straight ahead is seen at the turn's beginning, 1 m further back, and again at its end. The beams of a JT128 look
    // behind their column, and a profile's turn begins behind: at 15 m/s they see both blocks at its beginning alone.
    let jt128 = SensorProfile::load("jt128").expect("a product");
    let hdl_64e = sensor::Sensor::new(3, false);
    let mut scene = flat(&[]);
    let solids = [(1, 0.5), (2, -0.5)]
        .map(|(i, y)| add_block(&mut scene, i, [10.5, y, -0.9], [1.0, 0.9, 1.4]));
    let calibration = labels::calibration(Family::SimUdi).expect("valid");
    for (mut sensor, speed_mps, nearest_m) in
        [(hdl_64e, 10.0, [11.0, 10.0]), (sensor::Sensor::of(&jt128, 0.0, 3), 15.0, [11.4; 2])]
    {
        sensor.motion = Some(sensor::Motion {
            velocity_mps: v(speed_mps, 0.0, 0.0),
            yaw_rate_radps: 0.0,
            labels_at_end: false,
        });
        let sweep = scan::sweep(&sensor, &scene).expect("a sweep");
        let frame = labels::label(&calibration, &sensor, &scene, &solids, sweep).expect("labels");
        assert_eq!(frame.objects.len(), 2);
        for (index, object) in frame.objects.iter().enumerate() {
            let points = frame.points.iter().zip(&frame.instances);
            let own = points.filter(|(_, i)| usize::from(**i) == index + 1);
            let own: Vec<[f32; 4]> = own.map(|(p, _)| *p).collect();
            let least = own.iter().map(|p| p[0]).fold(f32::MAX, f32::min);
            assert!((least - nearest_m[index]).abs() < 0.2, "{least}");
            let mut seen = object.box_in_sensor;
            seen.size_m = seen.size_m.map(|s| s + 0.3);
            assert!(seen.count_inside(&own) * 20 > own.len() * 19, "{seen:?}");
        }
    }
}

#[test]
fn deskewed_points_lie_where_the_rays_ended() {
    // 15 m/s, a little uphill and aside, in a bend of 0.5 rad/s; between the walls every ray ends somewhere.
    let motion = sensor::Motion {
        velocity_mps: v(15.0, 0.5, 0.3),
        yaw_rate_radps: 0.5,
        labels_at_end: false,
    };
    let walls: [[f32; 2]; 4] = [[30.0, 0.0], [-30.0, 0.0], [0.0, 30.0], [0.0, -30.0]];
    let walls = walls.map(|[x, y]| {
        let size = [2.0 + 2.0 * y.abs(), 2.0 + 2.0 * x.abs(), 40.0];
        block([x, y, 0.0], size)
    });
    let scene = flat(&walls.each_ref().map(|wall| (wall, 1)));
    let mut sensor = sensor::Sensor::new(3, false);
    sensor.motion = Some(motion);
    // What poses before and after the turn say, 0.15 s apart.
    let pose = |time_s: f32| {
        let at = motion.velocity_mps * time_s;
        let rotation = Rotation3::from_euler_angles(0.0, 0.0, f64::from(0.5 * time_s));
        let at = Translation3::from(at.to_array().map(f64::from));
        // As in a map: far from its origin, with another heading.
        let turned = Rotation3::from_euler_angles(0.0, 0.0, 2.5);
        let start = IsometryMatrix3::from_parts(Translation3::new(4.5e5, 5.4e6, 0.0), turned);
        start * IsometryMatrix3::from_parts(at, rotation)
    };
    let deskew = Deskew::new([-0.12, 0.03], [pose(-0.12), pose(0.03)]).expect("a motion");
    let all = 0..scene.mesh.triangles.len();
    let world = scene.searchable(all).expect("a mesh");
    let (mut points, mut sums_m, mut most_m) = (0, [0.0; 2], [0.0f32; 2]);
    let columns = sensor.column_count;
    for shot in (0..64 * columns).map(|i| (i / columns, i % columns)) {
        let Some(hit) = scan::trace(&world, &sensor, shot) else {
            continue;
        };
        let end = |(start, direction): (V3, V3)| start + direction * hit.range_m;
        let (truth, seen) = (end(sensor.ray(shot)), end(sensor.ray_in_sensor(shot)));
        let moved = deskew.moved(sensor.time_s(shot.1).into(), seen.to_array());
        points += 1;
        for (which, found) in [seen, moved.into()].into_iter().enumerate() {
            let error_m = (found - truth).length();
            sums_m[which] += f64::from(error_m);
            most_m[which] = most_m[which].max(error_m);
        }
    }
    let mean_m = sums_m.map(|sum_m| sum_m / f64::from(points));
    println!("{points} points as seen, deskewed: mean {mean_m:.4?} m, at most {most_m:.4?} m");
    assert!(points > 100_000 && mean_m[0] > 0.5 && most_m[0] > 1.0);
    assert!(mean_m[1] < 0.002 && most_m[1] < 0.005);
}

#[test]
fn second_returns_lie_behind_edges() {
    let scene = flat(&[(&block([8.0, 0.0, -0.9], [1.0, 2.0, 1.4]), 1)]);
    let mut sensor = sensor::Sensor::new(3, false);
    let single = scan::sweep(&sensor, &scene).expect("a sweep");
    sensor.second_returns = 1.0;
    let dual = scan::sweep(&sensor, &scene).expect("a sweep");
    let more = dual.points.len() - single.points.len();
    assert!((5..200).contains(&more), "{more}");
    let on = |sweep: &scan::Sweep| sweep.instances.iter().filter(|i| **i == 1).count();
    assert_eq!(on(&single), on(&dual));
}

#[test]
fn a_pair_shows_the_same_objects() {
    let [thin, dense] = ["vlp-16", "os1-64"].map(|name| {
        let mut sensor = SensorProfile::load(name).expect("a product");
        sensor.azimuth_step_deg = 0.8;
        sensor
    });
    let mut options = ExportOptions::new(Family::SimAny, Split::Train, 1, 3, "".into());
    options.sensor = Some(thin);
    let one = simulated(&options, 2).expect("a frame").0;
    options.scanned_by = Some(Box::new(dense));
    let other = simulated(&options, 2).expect("a frame").0;
    assert!(other.points.len() > 2 * one.points.len());
    // The sensor moves, and the label of an object lies with the points that the scan has of it.
    let places = |frame: &SimulatedFrame| -> Vec<V3> {
        let boxes = frame.objects.iter().map(|o| o.box_in_sensor.center_m);
        boxes.map(|at| V3::from(at.map(|c| c as f32))).collect()
    };
    let others = places(&other);
    let is_same = |at: &V3| others.iter().any(|other| (*at - *other).length() < 0.2);
    let same = places(&one).into_iter().filter(is_same);
    assert!(same.count() * 10 >= one.objects.len() * 9 && one.objects.len() > 3);
}

#[test]
fn visibility_is_one_in_the_open_and_less_behind_a_wall() {
    let wall = block([8.0, 1.5, -0.5], [0.2, 3.0, 3.0]);
    let seen = |walls: &[(&Mesh, u16)], rain: f32| {
        let mut scene = flat(walls);
        scene.rain = rain;
        let solid = add_block(&mut scene, 1, [15.0, 0.0, -0.95], [4.0, 2.0, 1.5]);
        let (sensor, sweep) = swept(3, &scene);
        let calibration = labels::calibration(Family::SimUdi).expect("valid");
        let frame = labels::label(&calibration, &sensor, &scene, &[solid], sweep);
        frame.expect("labels").objects[0].visibility
    };
    let [dry, wet] = [0.0, 1.0].map(|rain| seen(&[], rain));
    assert!(dry > 0.97 && wet > 0.95, "{dry} {wet}");
    let half = seen(&[(&wall, 0x8002)], 0.0);
    assert!((0.35..0.65).contains(&half), "{half}");
}

#[test]
fn labels_read_back_within_a_centimetre() {
    let folder = tempfile::tempdir().expect("a folder");
    for family in Family::ALL {
        let folder = folder.path().join(family.name());
        let options = ExportOptions::new(family, Split::Val, 2, 9, folder.clone());
        export(&options, || ()).expect("written");
        let dataset = Dataset::open_split(&folder, "val").expect("a data set");
        for (index, name) in dataset.names().iter().enumerate() {
            let frame = frame(family, Split::Val, 9, index as u32, None).expect("a frame");
            let read = dataset.boxes_in_sensor(name).expect("labels");
            assert_eq!(read.len(), frame.objects.len());
            assert_eq!(dataset.scan(name).expect("a scan"), frame.points);
            for ((label, found), object) in read.iter().zip(&frame.objects) {
                assert!(label.is(object.class.name()));
                let expected = object.box_in_sensor;
                for axis in 0..3 {
                    assert!((found.center_m[axis] - expected.center_m[axis]).abs() < 0.01);
                    assert!((found.size_m[axis] - expected.size_m[axis]).abs() < 0.01);
                }
                assert!((found.yaw_rad - expected.yaw_rad).sin().abs() < 1e-3);
            }
            let plane = std::fs::read_to_string(dataset.plane_path(name)).expect("a plane");
            let last = plane.lines().last().unwrap_or_default().split(' ');
            let numbers: Vec<f64> = last.map(|n| n.parse().expect("a number")).collect();
            let (b, d) = (numbers[1], numbers[3]);
            let is_any = family == Family::SimAny;
            let heights = if is_any { 0.29..3.01 } else { 1.5..1.9 };
            assert!(b < -0.98 && heights.contains(&d), "plane {b} {d}");
        }
    }
}

#[test]
fn every_object_of_a_frame_is_labelled_with_its_own_points() {
    for family in Family::ALL {
        let frame = frame(family, Split::Test, 2, 1, None).expect("a frame");
        assert_eq!(frame.points.len(), frame.instances.len());
        assert!(frame.objects.len() > 3);
        for (index, object) in frame.objects.iter().enumerate() {
            let points = frame.points.iter().zip(&frame.instances);
            let of_object = points.filter(|(_, i)| usize::from(**i) == index + 1);
            let own: Vec<[f32; 4]> = of_object.map(|(p, _)| *p).collect();
            let mut grown = object.box_in_sensor;
            grown.size_m = grown.size_m.map(|s| s + 0.5);
            let (inside, count) = (grown.count_inside(&own), own.len());
            assert!(count > 0 && object.points > 0);
            let what = format!("{:?}: {inside} of {count} in its box", object.class);
            assert!(inside * 10 >= count * 9, "{what}");
        }
    }
}

/// Classes and footprints of a frame, without casting a ray.
fn objects_of(family: Family, split: Split, index: u32) -> Vec<layout::Placed> {
    objects_in(&ExportOptions::new(family, split, 1, 1, "".into()), index)
}

fn objects_in(options: &ExportOptions, index: u32) -> Vec<layout::Placed> {
    let (family, split) = (options.family, options.split);
    let key = random::hash(&[1, family as u64, split as u64, u64::from(index)]);
    let ground = ground::Ground::draw(family, None, &mut Dice::new(&[key, 1]));
    layout::place_objects(options, &ground, ego::CAR, &mut Dice::new(&[key, 2])).placed
}

#[test]
fn training_never_shows_an_unknown_class_and_validation_does() {
    for family in Family::ALL {
        let unknown = |split: Split, frames: u32| {
            let all = (0..frames).flat_map(|i| objects_of(family, split, i));
            let unknown = all.filter(|o| !family.known_classes().contains(&o.class));
            unknown.count() as f32 / frames as f32
        };
        assert_eq!(unknown(Split::Train, 1500), 0.0);
        let mean = unknown(Split::Val, 400);
        assert!((0.4..0.8).contains(&mean), "{family:?}: {mean} a frame");
    }
}

#[test]
fn classes_that_are_also_known_stand_in_training() {
    let mut options = ExportOptions::new(Family::SimAny, Split::Train, 1, 1, "".into());
    options.known = vec![Class::Forklift];
    let all = (0..200).flat_map(|index| objects_in(&options, index));
    let all: Vec<Class> = all.map(|object| object.class).collect();
    let count = |class| all.iter().filter(|c| **c == class).count();
    assert!(count(Class::Forklift) > 200, "{}", count(Class::Forklift));
    assert_eq!(count(Class::GolfCart) + count(Class::Van), 0);
}

#[test]
fn unseen_classes_stand_in_one_split_and_never_in_training() {
    for family in Family::ALL {
        for split in [Split::Val, Split::Test] {
            let mut options = ExportOptions::new(family, split, 1, 1, "".into());
            options.unseen = true;
            let all = (0..400).flat_map(|index| objects_in(&options, index));
            let mut shown: Vec<Class> = all.map(|object| object.class).collect();
            shown.retain(|class| !family.known_classes().contains(class));
            let count = shown.len();
            shown.sort();
            shown.dedup();
            assert!(Unseen::of(split).map(Class::Unseen).eq(shown));
            assert!(count > 160, "{family:?} {split:?}: {count}");
        }
        // A folder's name may begin as an option does.
        let mut options = ExportOptions::new(family, Split::Train, 1, 1, "-train".into());
        options.unseen = true;
        refuses(&options, "expected the split val or test, found train");
    }
}

#[test]
fn an_export_goes_on_where_it_was_interrupted() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut options = ExportOptions::new(Family::SimKitti, Split::Val, 3, 5, folder.path().into());
    export(&options, || ()).expect("written");
    let path = |part: &str| folder.path().join(part);
    let scan = std::fs::read(path("velodyne/000001.bin")).expect("a scan");
    // Cut while frame 1 was written; frame 0 is there, whatever is in it.
    std::fs::write(path("velodyne/000001.bin"), &scan[..16]).expect("written");
    std::fs::write(path("velodyne/000000.bin"), "kept").expect("written");
    std::fs::remove_file(path("planes/000001.txt")).expect("removed");
    options.resume = true;
    export(&options, || ()).expect("written");
    assert!(std::fs::read(path("velodyne/000001.bin")).expect("a scan") == scan);
    let kept = std::fs::read(path("velodyne/000000.bin"));
    assert_eq!(kept.expect("a scan"), b"kept");
}

#[test]
fn synthetic_unknown_objects_are_labelled_and_bring_no_unknown_class() {
    for family in Family::ALL {
        let mut options = ExportOptions::new(family, Split::Train, 1, 1, "".into());
        options.synthetic_unknown = true;
        let frames = (0..4).map(|index| simulated(&options, index).expect("a frame").0);
        let objects: Vec<SimulatedObject> = frames.flat_map(|frame| frame.objects).collect();
        let is_synthetic = |o: &&SimulatedObject| o.class == Class::SyntheticUnknown;
        let (count, synthetic) = (objects.len(), objects.iter().filter(is_synthetic).count());
        assert!((3..=16).contains(&synthetic), "{family:?}: {synthetic}");
        assert!(count > 3 * synthetic, "{family:?}: {count}");
        let is_unknown = |o: &SimulatedObject| family.unknown_classes().contains(&o.class);
        assert!(!objects.iter().any(is_unknown));
        // Nor outside of training.
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("val");
        let mut options = ExportOptions::new(family, Split::Val, 1, 1, out);
        options.synthetic_unknown = true;
        refuses(&options, "expected the split train, found val");
    }
}

#[test]
fn objects_never_stand_in_each_other() {
    for index in 0..150 {
        let objects = objects_of(Family::SimUdi, Split::Val, index);
        let boxes = objects.iter().map(|o| {
            let (f, [l, w]) = (o.footprint, o.footprint.half.map(|half| 2.0 * half));
            Box3::new([f.x, f.y, 0.0, l, w, 1.0, f.yaw].map(f64::from))
        });
        let boxes: Vec<Box3> = boxes.collect();
        for (i, a) in boxes.iter().enumerate() {
            for b in &boxes[..i] {
                assert!(intersection_bev_m2(a, b) < 1e-6, "frame {index}");
            }
        }
    }
}

#[test]
fn labels_of_sim_udi_carry_the_level_of_their_points() {
    let object = SimulatedObject {
        class: Class::Car,
        box_in_sensor: Box3::new([9.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]),
        visibility: 1.0,
        points: 9,
        image_box_px: [0.0, 0.0, 100.0, 100.0],
        truncated: 0.0,
        number: 0,
    };
    assert_eq!(Family::ALL.map(|family| object.occluded(family)), [3, 0, 0]);
    let at = |visibility: f32| {
        SimulatedObject { visibility, points: 10, ..object }.occluded(Family::SimUdi)
    };
    assert_eq!([1.0, 0.74, 0.39, 0.09].map(at), [0, 1, 2, 3]);
}

#[test]
fn a_sequence_shows_the_same_scene_from_a_moving_sensor() {
    let (family, split, seed, steps) = (Family::SimUdi, Split::Test, 3, 10);
    let mut options = ExportOptions::new(family, split, 1, seed, "".into());
    options.sequence = Some(steps);
    let shown = |index, step| simulated(&options, steps * index + step).unwrap();
    // The first turn is at the place, and with the objects, of the frame without a sequence.
    let (first, start) = shown(0, 0);
    assert_eq!(start, [0.0; 3]);
    let alone = frame(family, split, seed, 0, None).unwrap();
    let places = |frame: &SimulatedFrame| -> Vec<Box3> {
        frame.objects.iter().map(|o| o.box_in_sensor).collect()
    };
    assert_eq!(places(&first), places(&alone));
    let mut still = 0;
    let mut drove = false;
    for index in 0..4 {
        let (first, _) = shown(index, 0);
        let (last, at) = shown(index, steps - 1);
        drove |= at[0].hypot(at[1]) > 1.0;
        assert!(at[0].hypot(at[1]) < 12.0 && at[2].abs() < 1.0, "{at:?}");
        // It keeps its height above the plane of each frame.
        let [was_m, is_m] = [&first, &last].map(|f| f.plane[3] / f.plane[2]);
        assert!((was_m - is_m).abs() < 1e-4, "{was_m} {is_m}");
        // What stands still is found where it was, once the sensor's way is added.
        for object in &last.objects {
            let moved = |axis: usize| object.box_in_sensor.center_m[axis] + at[axis];
            let same_place = |o: &&SimulatedObject| {
                let there = o.box_in_sensor.center_m;
                o.class == object.class && (there[0] - moved(0)).hypot(there[1] - moved(1)) < 0.01
            };
            still += usize::from(first.objects.iter().any(|o| same_place(&o)));
        }
    }
    assert!(drove, "no sensor drove");
    assert!(still > 10, "{still} objects stood still");
    // The longest sequence stays on the ground, where nothing is in the way either.
    let ground = ground::Ground::draw(family, None, &mut Dice::new(&[1]));
    let mut empty = layout::place_objects(&options, &ground, ego::CAR, &mut Dice::new(&[2]));
    (empty.taken, empty.placed) = (vec![ego::CAR], vec![]);
    let last = Turn { step: 99, steps: 100, moves: false };
    let drive = |key| drive::drive(&mut empty, last, &mut Dice::new(&[key]))[0];
    let farthest_m = (0..20).map(drive).map(|at| at.x.hypot(at.y)).fold(0.0, f32::max);
    assert!((50.0..60.0).contains(&farthest_m), "{farthest_m}");
}

#[test]
fn every_class_of_the_simulator_is_known_to_the_dataset() {
    let mut named = classes().chain([Class::SyntheticUnknown]).map(Class::name);
    assert!(named.all(mluc_dataset::is_recognized));
    let unseen = Split::ALL.into_iter().flat_map(Unseen::of);
    assert!(unseen.map(Unseen::name).eq(mluc_dataset::unseen_classes()));
    assert!(!mluc_dataset::is_recognized("Carr"));
}
