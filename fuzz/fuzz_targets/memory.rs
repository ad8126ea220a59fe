//! Messages of shared memory, given to their readers. The first byte selects the kind; a header follows.
#![no_main]

use bytemuck::pod_collect_to_vec as elements;
use mluc_gateway::lines::line;
use mluc_ipc_types::*;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let (choice, data) = data.split_at(data.len().min(1));
    let (head, body) = data.split_at(data.len().min(size_of::<FrameHeader>()));
    let mut header = elements::<_, FrameHeader>(head).pop().unwrap_or_default();
    header.wire_version = WIRE_VERSION;
    match choice.first().map_or(0, |choice| choice % 6) {
        0 => drop(FeatureRows::checked(&header, &elements(body), 400, 32, 3)),
        1 => {
            for run in elements::<_, RunDescription>(body) {
                let _ = run.checked().map(|run| header.checked_in(run, 0..9));
            }
        }
        2 => drop(Detection::checked(&header, &elements(body), 2)),
        3 => elements::<_, Health>(body).iter().for_each(|health| drop(health.checked())),
        4 => elements::<_, Status>(body).iter().for_each(|status| drop(status.checked())),
        // What passes the check must be writable as output.
        _ => {
            let (objects, indices) = body.split_at(body.len() / 2);
            let (objects, indices) = (elements(objects), elements(indices));
            let _ = Object::checked_points(&header, &indices, 1000);
            if let Ok(objects) = Object::checked(&header, &objects, 2) {
                let _ = Object::checked_ranges(objects, indices.len());
                let line = line(&header, objects, &[], &Status::default());
                serde_json::to_string(&line).expect("a line");
            }
        }
    }
});
