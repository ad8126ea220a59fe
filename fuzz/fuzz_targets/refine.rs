//! Detections and points for the refiner: any output of the refiner passes the check of the later stages.
#![no_main]

use bytemuck::pod_collect_to_vec as elements;
use mluc_ipc_types::{FrameHeader, Object};
use mluc_refiner::{Refiner, RefinerOutput, Sensor, Settings};

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let (detections, points) = data.split_at(data.len() / 2);
    let points = elements(points);
    let sensor = Sensor { tells_unknown: true, ..Sensor::plain(&["car", "van"]) };
    let mut refiner = Refiner::new(Settings::default(), &sensor).expect("sound settings");
    let mut out = RefinerOutput::default();
    refiner.refine(1, &points, &elements(detections), &mut out);
    let header = FrameHeader::new(0, "a");
    Object::checked(&header, &out.objects, 2).expect("sound objects");
    Object::checked_points(&header, &out.object_points, points.len()).expect("sound indices");
    Object::checked_ranges(&out.objects, out.object_points.len()).expect("sound ranges");
});
