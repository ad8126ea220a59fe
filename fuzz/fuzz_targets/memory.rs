//! Messages of shared memory, to those who read them. The first byte chooses; a header comes first.
#![no_main]

use bytemuck::Pod;
use mluc_gateway::lines::line;
use mluc_ipc_types::*;
use mluc_refiner::{Refiner, RefinerOutput, Sensor, Settings};

fn elements<T: Pod>(bytes: &[u8]) -> Vec<T> {
    let chunks = bytes.chunks_exact(size_of::<T>());
    chunks.map(bytemuck::pod_read_unaligned).collect()
}

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let (choice, data) = data.split_at(data.len().min(1));
    let (head, body) = data.split_at(data.len().min(size_of::<FrameHeader>()));
    let mut header = elements::<FrameHeader>(head).pop().unwrap_or_default();
    header.wire_version = WIRE_VERSION;
    let objects = match choice.first().map_or(0, |choice| choice % 4) {
        0 => return drop(FeatureRows::checked(&header, &elements(body), 400, 32, 3)),
        1 => {
            return elements::<RunDescription>(body)
                .iter()
                .for_each(|run| drop(run.checked()));
        }
        2 => elements(body),
        _ => {
            // What a refiner makes of anything passes the check of those behind it.
            let (detections, points) = body.split_at(body.len() / 2);
            let points = elements(points);
            let sensor = Sensor::plain(&["car", "van"]);
            let mut refiner = Refiner::new(Settings::default(), &sensor).expect("sound settings");
            let mut out = RefinerOutput::default();
            refiner.refine(header.sequence, &points, &elements(detections), &mut out);
            header = FrameHeader::new(0, "a");
            Object::checked(&header, &out.objects, 2).expect("sound objects");
            out.objects
        }
    };
    if let Ok(objects) = Object::checked(&header, &objects, 2) {
        let line = line(&header, objects, &[], &Status::default());
        serde_json::to_string(&line).expect("a line");
    }
});
