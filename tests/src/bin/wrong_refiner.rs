//! A refiner with one fault, named by its argument: the contract suite must find it. `sound` has none.
//!
//! It refines nothing: each candidate is published with its proposal box.

use mluc_ipc_types::{
    CLASSES_MAX, Detection, Fate, Flags, FrameHeader, HealthState, OBJECT_POINTS_MAX, OBJECTS_MAX,
    Object, Point, Stage, Topic,
};
use mluc_runtime::{
    Input, Message, RuntimeError, Scans, Shell, ShellOptions, Shutdown, StageEnvironment,
    monotonic_ns,
};

fn main() -> Result<(), RuntimeError> {
    let fault = std::env::args().nth(1).unwrap_or_default();
    let environment = StageEnvironment::read()?;
    let shutdown = match fault.as_str() {
        // Signals are caught and forgotten.
        "deaf" => {
            Shutdown::on_signals()?;
            Shutdown::manual()
        }
        _ => Shutdown::on_signals()?,
    };
    let options = ShellOptions::new(environment.instance.clone());
    let shell = match fault.as_str() {
        "no_health" => Shell::observer(options, None, shutdown)?,
        _ => Shell::stage(options, Stage::Refiner, shutdown)?,
    };
    Wrong { fault, environment }.run(shell)
}

struct Wrong {
    fault: String,
    environment: StageEnvironment,
}

impl Wrong {
    fn has(&self, fault: &str) -> bool {
        self.fault == fault
    }

    fn run(&self, mut shell: Shell) -> Result<(), RuntimeError> {
        let mut objects_out = shell.output::<Object>(&Topic::OBJECTS, OBJECTS_MAX)?;
        let mut points_out = shell.output::<u32>(&Topic::OBJECT_POINTS, OBJECT_POINTS_MAX)?;
        let mut scans = Scans::new(shell.side_input::<Point>(&Topic::POINTS)?);
        let mut input = shell.input::<Detection>(&Topic::DETECTIONS)?;
        shell.state(HealthState::WaitingInput, "waiting for detections")?;
        let mut last = None;
        while let Some(message) = self.next(&mut shell, &mut input, &mut scans)? {
            let mut header = *message.header();
            header.stages[3].received_ns = message.received_ns;
            header.stages[3].started_ns = monotonic_ns();
            scans.take()?;
            if let Err(why) = self.check(&header, message.elements()) {
                shell.refuse(&why)?;
                continue;
            }
            let points = scans.of(header.sequence).filter(|_| !self.has("no_points"));
            let points =
                points.filter(|scan| Point::checked(scan.header(), scan.elements()).is_ok());
            let points = match points {
                Some(scan) => scan.elements(),
                None => {
                    if !self.has("unflagged") {
                        header.flag(Flags::POINTS_GONE.with(Flags::DEGRADED));
                    }
                    &[]
                }
            };
            if !points.iter().all(Point::is_finite) {
                header.flag(Flags::NOT_FINITE);
            }
            if self.has("answers_once") && last >= Some(header.sequence) {
                continue;
            }
            last = Some(header.sequence);
            let mut objects: Vec<Object> = message.elements().iter().map(object).collect();
            self.spoil(&mut header, &mut objects);
            if points.len() > 3 {
                for object in &mut objects {
                    object.points_count = 3;
                }
            }
            let far = if self.has("bad_index") { 1 << 20 } else { 0 };
            let indices = [far, 1, 2];
            let mut draft = points_out.draft(&header, points.len().min(3))?;
            let count = draft.elements_mut().len();
            draft.elements_mut().copy_from_slice(&indices[..count]);
            draft.publish()?;
            let mut draft = objects_out.draft(&header, objects.len())?;
            draft.elements_mut().copy_from_slice(&objects);
            draft.header_mut().stages[3].published_ns = match self.has("no_stamps") {
                true => 0,
                false => monotonic_ns(),
            };
            draft.publish()?;
            shell.counters.frames_in += 1;
            shell.counters.frames_out += 1;
            if !self.has("uncounted") {
                shell.counters.frames_dropped = input.dropped();
            }
            if self.has("miscounts") {
                shell.counters.candidates.by_fate[0] += 77;
            }
            scans.let_go();
            shell.state(HealthState::Running, "")?;
            shell.tick()?;
        }
        shell.state(HealthState::Stopping, "")
    }

    fn next(
        &self,
        shell: &mut Shell,
        input: &mut Input<Detection>,
        scans: &mut Scans,
    ) -> Result<Option<Message<Detection>>, RuntimeError> {
        match self.has("silent") {
            // No heartbeat while it waits.
            true => loop {
                if shell.is_stopping() {
                    return Ok(None);
                }
                scans.take()?;
                if let Some(message) = input.newest()? {
                    return Ok(Some(message));
                }
                shell.wait(input, std::time::Duration::from_millis(20));
            },
            false => shell.next(input, &Topic::DETECTIONS, || scans.take()),
        }
    }

    fn check(&self, header: &FrameHeader, detections: &[Detection]) -> Result<(), String> {
        if self.has("any_version") {
            return Ok(());
        }
        let classes = match self.environment.classes.len() {
            0 => CLASSES_MAX,
            count => count,
        };
        let checked = Detection::checked(header, detections, classes);
        if self.has("brittle") {
            checked.expect("sound detections");
        } else {
            checked.map_err(|error| error.to_string())?;
        }
        match (self.environment.fingerprint, header.model_fingerprint) {
            // Started by hand, it was not told which model runs.
            (0, _) => Ok(()),
            (own, found) if own == found => Ok(()),
            (_, found) => Err(format!("frames of model {found}")),
        }
    }

    /// What the fault does to the answer.
    fn spoil(&self, header: &mut FrameHeader, objects: &mut Vec<Object>) {
        match self.fault.as_str() {
            "moves_known" => {
                for object in objects.iter_mut().filter(|object| object.kind == 0) {
                    object.center_m[0] += 0.01;
                }
            }
            "forgets" => {
                objects.pop();
            }
            "renumbers" => header.sequence += 1,
            "not_finite" => {
                for object in objects.iter_mut() {
                    object.yaw_rad = f32::NAN;
                }
            }
            _ => (),
        }
    }
}

fn object(d: &Detection) -> Object {
    let [x, y, _] = d.center_m;
    let (l, w) = (d.size_m[0] / 2.0, d.size_m[1] / 2.0);
    let mut footprint_m = [[0.0; 2]; 16];
    footprint_m[..4].copy_from_slice(&[
        [x + l, y + w],
        [x - l, y + w],
        [x - l, y - w],
        [x + l, y - w],
    ]);
    Object {
        kind: d.kind,
        fate: Fate::Published as u32,
        by: Object::NONE,
        class_id: d.class_id,
        score: d.score,
        center_m: d.center_m,
        size_m: d.size_m,
        yaw_rad: d.yaw_rad,
        eds: d.eds,
        eds_normalised: d.eds_normalised,
        threshold: d.threshold,
        points_first: 0,
        points_count: 0,
        flags: 0,
        track_id: Object::NONE,
        overlap: 0.0,
        footprint_count: 4,
        footprint_m,
    }
}
