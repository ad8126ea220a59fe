//! A refiner with one fault, named by its argument: the contract suite must find it. `sound` has none.
//!
//! It refines nothing: each candidate is published with its proposal box.

use std::time::Duration;

use bytemuck::Zeroable;
use mluc_ipc_types::{
    ContractError, Detection, Disposition, Flags, FrameHeader, HealthState, OBJECT_POINTS_MAX,
    OBJECTS_MAX, Object, Point, RunDescription, Stage, Topic,
};
use mluc_runtime::{
    Input, Instance, Message, Output, RuntimeError, Scans, Shell, Shutdown, monotonic_ns,
};

fn main() -> Result<(), RuntimeError> {
    mluc_runtime::log_to_stderr("refiner", "warn");
    let fault = std::env::args().nth(1).unwrap_or_default();
    let mut shutdown = Shutdown::on_signals()?;
    if fault == "deaf" {
        // Signals are caught and forgotten.
        shutdown = Shutdown::manual();
    }
    let instance = Instance::from_environment()?;
    let mut shell = if fault == "no_health" {
        Shell::observer(&instance, None, shutdown)?
    } else {
        Shell::stage(&instance, Stage::Refiner, shutdown)?
    };
    let mut wrong = Wrong {
        objects: shell.output(&Topic::OBJECTS, OBJECTS_MAX)?,
        object_points: shell.output(&Topic::OBJECT_POINTS, OBJECT_POINTS_MAX)?,
        scans: Scans::held(&shell)?,
        input: shell.input(&Topic::DETECTIONS)?,
        run_id: 0,
        last: None,
        fault,
    };
    shell.state(HealthState::WaitingInput, "waiting for detections")?;
    loop {
        let take = |run: Option<&RunDescription>| run.map_or(Ok(()), |run| wrong.scans.take(run));
        let Some(message) = shell.next(&mut wrong.input, take)? else {
            break;
        };
        wrong.frame(&mut shell, &message)?;
        // No heartbeat after the first frame.
        while wrong.has("silent") && !shell.is_stopping() {
            std::thread::sleep(Duration::from_millis(20));
        }
        shell.tick()?;
    }
    shell.state(HealthState::Stopping, "")
}

struct Wrong {
    // Ports and messages go before the shell.
    objects: Output<Object>,
    object_points: Output<u32>,
    scans: Scans,
    input: Input<Detection>,
    run_id: u64,
    last: Option<u64>,
    fault: String,
}

impl Wrong {
    fn has(&self, fault: &str) -> bool {
        self.fault == fault
    }

    /// Takes a frame, answers or refuses it.
    fn frame(
        &mut self,
        shell: &mut Shell,
        message: &Message<Detection>,
    ) -> Result<(), RuntimeError> {
        let mut header = *message.header();
        header.stages[3].received_ns = message.received_ns;
        header.stages[3].started_ns = monotonic_ns();
        let Some(run) = shell.run().copied() else {
            return shell.refuse("no run");
        };
        self.scans.take(&run)?;
        if self.run_id != run.run_id {
            (self.run_id, self.last) = (run.run_id, None);
        }
        if let Err(why) = self.check(&run, &header, message.elements()) {
            return shell.refuse(&why.to_string());
        }
        let is_answered = self.last >= Some(header.sequence);
        if !self.has("uncounted") {
            let next = self.last.map_or(header.sequence, |last| last + 1);
            shell.health.frames_dropped += header.sequence.saturating_sub(next);
        }
        self.last = Some(header.sequence);
        if self.has("answers_once") && is_answered {
            return Ok(());
        }
        self.answer(header, message.elements())?;
        shell.health.frames_in += 1;
        shell.health.frames_out += 1;
        if self.has("miscounts") {
            shell.health.candidates.by_disposition[0] += 77;
        }
        self.scans.let_go();
        shell.state(HealthState::Running, "")
    }

    fn check(
        &self,
        run: &RunDescription,
        header: &FrameHeader,
        detections: &[Detection],
    ) -> Result<(), ContractError> {
        let mut seen = *header;
        let mut sequences = self.last.unwrap_or(0)..self.scans.count_sent();
        match self.fault.as_str() {
            "any_version" => return Ok(()),
            "any_run" => seen.run_id = run.run_id,
            "any_sequence" => sequences = 0..u64::MAX,
            _ => (),
        }
        seen.checked_in(run, sequences)?;
        let checked = Detection::checked(header, detections, run.classes_count as usize);
        assert!(checked.is_ok() || !self.has("brittle"));
        checked.map(drop)
    }

    fn answer(
        &mut self,
        mut header: FrameHeader,
        detections: &[Detection],
    ) -> Result<(), RuntimeError> {
        let scan = self.scans.of(header.sequence);
        let scan = scan.filter(|_| !self.has("no_points"));
        let points = scan.and_then(|scan| Point::checked(scan.header(), scan.elements()).ok());
        if points.is_none() && !self.has("unflagged") {
            header.flag(Flags::POINTS_GONE.with(Flags::DEGRADED));
        }
        let points = points.unwrap_or_default();
        if !points.iter().all(Point::is_finite) {
            header.flag(Flags::NOT_FINITE);
        }
        let far = if self.has("bad_index") { 1 << 20 } else { 0 };
        let indices = &[far, 1, 2][..points.len().min(3)];
        let mut objects: Vec<Object> = detections.iter().map(object).collect();
        for object in &mut objects {
            object.points_count = indices.len() as u32;
        }
        self.spoil(&mut header, &mut objects);
        self.object_points.send(&header, indices)?;
        if !self.has("no_stamps") {
            header.stages[3].published_ns = monotonic_ns();
        }
        if self.has("hostile") {
            self.publish_hostile(&header)?;
        }
        self.objects.send(&header, &objects)
    }

    /// Sequences that never were and that go back, messages of another run, model and version.
    fn publish_hostile(&mut self, header: &FrameHeader) -> Result<(), RuntimeError> {
        let changes: [fn(&mut FrameHeader); 7] = [
            |h| h.sequence = u64::MAX - 1,
            |h| h.sequence = u64::MAX,
            |h| h.sequence += 1,
            |h| h.sequence = 0,
            |h| h.run_id ^= 1,
            |h| h.model_fingerprint ^= 1,
            |h| h.wire_version += 1,
        ];
        for change in changes {
            let mut wrong = *header;
            change(&mut wrong);
            self.objects.loan(&wrong, 0)?.publish()?;
            // The queue of a topic holds two: each is to be read.
            std::thread::sleep(Duration::from_millis(30));
        }
        Ok(())
    }

    /// What the fault does to the answer.
    fn spoil(&self, header: &mut FrameHeader, objects: &mut Vec<Object>) {
        match self.fault.as_str() {
            "moves_known" => {
                let known = objects.iter_mut().filter(|object| object.kind == 0);
                known.for_each(|object| object.center_m[0] += 0.01);
            }
            "forgets" => drop(objects.pop()),
            "renumbers" => header.sequence += 1,
            "forgets_run" => header.run_id = 0,
            "not_finite" => objects.iter_mut().for_each(|o| o.yaw_rad = f32::NAN),
            "clockwise" => objects.iter_mut().for_each(|o| o.footprint_m.swap(0, 2)),
            _ => (),
        }
    }
}

fn object(d: &Detection) -> Object {
    let [x, y, _] = d.center_m;
    let (l, w) = (d.size_m[0] / 2.0, d.size_m[1] / 2.0);
    let mut footprint_m = [[0.0; 2]; 16];
    let corners = [[l, w], [-l, w], [-l, -w], [l, -w]];
    for (to, [along, across]) in footprint_m.iter_mut().zip(corners) {
        *to = [x + along, y + across];
    }
    Object {
        kind: d.kind,
        disposition: Disposition::Published as u32,
        suppressed_by: Object::NONE,
        class_id: d.class_id,
        score: d.score,
        center_m: d.center_m,
        size_m: d.size_m,
        yaw_rad: d.yaw_rad,
        eds: d.eds,
        eds_normalised: d.eds_normalised,
        unknown_probability: d.unknown_probability,
        gate: d.gate,
        threshold: d.threshold,
        track_id: Object::NONE,
        footprint_count: 4,
        footprint_m,
        ..Object::zeroed()
    }
}
