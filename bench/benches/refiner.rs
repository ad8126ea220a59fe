//! Ground, clustering and box fit at one object of a simulated scan, and the refiner on a whole frame.

use criterion::{Criterion, criterion_group, criterion_main};
use mluc_bench::inputs;
use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, DetectionKind, Point};
use mluc_lab::simulate::SimulatedFrame;
use mluc_refiner::cluster::{Bounds, Clusterer, Dbscan, Depth, Distance, Euclidean, Literal};
use mluc_refiner::fit::{Closeness, ClusterPoints, axis_aligned, minimum_area};
use mluc_refiner::{
    FrameIndex, Gather, GroundPlane, IndexedPoint, Neighbourhood, Refined, Refiner, Settings,
};

/// Of the mounting, m.
const SENSOR_HEIGHT_M: f64 = 1.73;
const PROPOSALS: usize = 20;

/// One object's surroundings, as the refiner sees them.
struct Scene {
    points: Vec<Point>,
    object: Box3,
    index: FrameIndex,
    ground: GroundPlane,
    around: Neighbourhood,
    seed: usize,
}

/// The object with the most points.
fn scene(frame: &SimulatedFrame) -> Scene {
    let points = inputs::as_points(&frame.points);
    let largest = frame.objects.iter().max_by_key(|object| object.points);
    let object = largest.expect("an object").box_in_sensor;
    let center_m = [object.center_m[0], object.center_m[1]];
    let mut index = FrameIndex::default();
    index.start();
    index.want_all();
    index.sort(&points);
    let settings = Settings::default();
    let ground = GroundPlane::fit(&index, center_m, SENSOR_HEIGHT_M, &settings.ground);
    let seed = seed(&index, &object);
    let wanted = Gather {
        radius_m: 6.0,
        height_m: [settings.ground.clearance_m, settings.ground.height_max_m],
        points_max: settings.points_per_candidate_max as usize,
    };
    let mut around = Neighbourhood::default();
    let seed = around.gather(&index, &seed, &ground, &wanted, &[]);
    Scene {
        points,
        object,
        index,
        ground,
        around,
        seed,
    }
}

/// The point of the object nearest to its centre.
fn seed(index: &FrameIndex, object: &Box3) -> IndexedPoint {
    let center_m = [object.center_m[0], object.center_m[1]];
    let off = |point: &&IndexedPoint| {
        let [x, y, z] = [0, 1, 2].map(|i| f64::from(point.at_m[i]) - object.center_m[i]);
        x * x + y * y + z * z
    };
    let points = index.rows_around(center_m, 4.0).flatten();
    *points
        .min_by(|a, b| off(a).total_cmp(&off(b)))
        .expect("points at the object")
}

fn ground(c: &mut Criterion, scene: &Scene) {
    let center_m = [scene.object.center_m[0], scene.object.center_m[1]];
    let settings = Settings::default().ground;
    c.bench_function("ground/one candidate", |b| {
        b.iter(|| GroundPlane::fit(&scene.index, center_m, SENSOR_HEIGHT_M, &settings))
    });
    let mut index = FrameIndex::default();
    c.bench_function("index/whole scan", |b| {
        b.iter(|| {
            index.start();
            index.want_all();
            index.sort(&scene.points);
        })
    });
}

fn clustering(c: &mut Criterion, scene: &Scene) -> Vec<u32> {
    let settings = Settings::default();
    let beams = inputs::sensor().beams;
    let mut ways: [(&str, Box<dyn Clusterer>); 5] = [
        ("literal", Box::new(Literal::new(&settings.literal))),
        (
            "corrected",
            Box::new(Depth::new(&settings.corrected, beams.as_ref())),
        ),
        ("distance", Box::new(Distance::new(&settings.distance))),
        ("dbscan", Box::new(Dbscan::new(&settings.reference))),
        ("euclidean", Box::new(Euclidean::new(&settings.reference))),
    ];
    let bounds = Bounds {
        height_min_m: settings.ground.clearance_m,
        scale: 1.0,
    };
    let mut group = c.benchmark_group(format!("cluster, {} points around", scene.around.len()));
    let mut members = vec![];
    for (name, way) in &mut ways {
        group.bench_function(*name, |b| {
            b.iter(|| way.grow(&scene.around, scene.seed, &bounds, &mut members))
        });
    }
    group.finish();
    ways[2]
        .1
        .grow(&scene.around, scene.seed, &bounds, &mut members);
    members
}

fn box_fit(c: &mut Criterion, scene: &Scene, members: &[u32]) {
    let mut points = ClusterPoints::default();
    for &member in members {
        let at = member as usize;
        points.push(
            scene.around.x_m[at],
            scene.around.y_m[at],
            scene.around.z_m[at],
        );
    }
    let mut closeness = Closeness::default();
    let mut group = c.benchmark_group(format!("box fit, {} points", points.len()));
    group.bench_function("closeness", |b| b.iter(|| closeness.fit(&points)));
    group.bench_function("minimum area", |b| b.iter(|| minimum_area(&points)));
    group.bench_function("axis aligned", |b| b.iter(|| axis_aligned(&points)));
    group.finish();
}

fn whole(c: &mut Criterion, frame: &SimulatedFrame, scene: &Scene) {
    let mut refiner =
        Refiner::new(Settings::default(), &inputs::sensor()).expect("default settings");
    let detections: Vec<Detection> = frame
        .objects
        .iter()
        .cycle()
        .take(PROPOSALS)
        .map(|object| Detection {
            center_m: object.box_in_sensor.center_m.map(|value| value as f32),
            size_m: [1.8, 0.7, 1.6],
            kind: DetectionKind::Candidate as u32,
            objectness: 0.5,
            score: 0.3,
            eds: 1.0,
            ..Detection::default()
        })
        .collect();
    let mut refined = Refined::default();
    c.bench_function(&format!("refiner/{PROPOSALS} proposals"), |b| {
        b.iter(|| refiner.refine(0, &scene.points, &detections, &mut refined))
    });
}

fn all(c: &mut Criterion) {
    let frame = inputs::simulated(0).expect("a simulated scan");
    let scene = scene(&frame);
    // The neighbourhood's ground is the one that was found: a plane that is none would leave no object.
    assert!(scene.ground.height_m < -1.0, "{:?}", scene.ground);
    ground(c, &scene);
    let members = clustering(c, &scene);
    box_fit(c, &scene, &members);
    whole(c, &frame, &scene);
}

criterion_group!(benches, all);
criterion_main!(benches);
