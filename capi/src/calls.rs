//! The functions that C calls. No panic reaches the caller.

use crate::error::{Code, Failure, last, remember};
use crate::{consumer::Consumer, refiner::Refiner, source::Source};
use bytemuck::Zeroable;
use mluc_ipc_types::{
    Detection, Flags, FrameHeader, Object, Point, RunDescription, Status, WIRE_VERSION,
};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::{from_ref, null};
use std::{ffi::CStr, ffi::c_char, time::Duration};

/// `mluc_frame` in C: where a frame lies in shared memory. Readable until the next call with the same handle.
#[derive(Clone, Copy, Debug, Zeroable)]
#[repr(C)]
pub struct MlucFrame {
    /// The detections' header.
    pub header: *const FrameHeader,
    /// The run that it belongs to.
    pub run: *const RunDescription,
    /// Points of the same scan; none when they are gone (the header's flags say so).
    pub points: *const Point,
    /// Number of points.
    pub points_count: usize,
    /// Checked detections: classes, kinds and boxes make sense.
    pub detections: *const Detection,
    /// Number of detections.
    pub detections_count: usize,
}

/// `mluc_result` in C: a pipeline's newest frame and status. Readable until the next call with the same handle.
#[derive(Clone, Copy, Debug, Zeroable)]
#[repr(C)]
pub struct MlucResult {
    /// Null: no frame came.
    pub header: *const FrameHeader,
    /// The run that it belongs to.
    pub run: *const RunDescription,
    /// The pipeline's status; null: no supervisor has published one.
    pub status: *const Status,
    /// Points of the scan; none when they are gone.
    pub points: *const Point,
    /// Number of points.
    pub points_count: usize,
    /// Checked objects.
    pub objects: *const Object,
    /// Number of objects.
    pub objects_count: usize,
    /// The objects' points: indices into `points`; none when these are gone.
    pub indices: *const u32,
    /// Number of indices.
    pub indices_count: usize,
}

fn guarded(call: impl FnOnce() -> Result<Code, Failure>) -> i32 {
    let bug = || Failure::new(Code::Internal, "a bug in mluc-capi: see stderr");
    let result = catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|_| Err(bug()));
    let code = result.unwrap_or_else(|failure| {
        remember(&failure.words);
        failure.code
    });
    code as i32
}

/// The version of the contract that this library speaks.
#[unsafe(no_mangle)]
pub extern "C" fn mluc_wire_version() -> u32 {
    WIRE_VERSION
}

/// The message of this thread's last error; valid until its next error.
#[unsafe(no_mangle)]
pub extern "C" fn mluc_last_error() -> *const c_char {
    last()
}

/// A handle of C's, and the functions that open and close it.
macro_rules! handle {
    ($handle:ident, $own:ty, $open:ident, $close:ident, $what:literal) => {
        /// A handle in C.
        pub struct $handle($own);

        #[doc = concat!("Joins the instance that `MLUC_INSTANCE` names (\"default\" without it) as ", $what, ".")]
        ///
        /// # Safety
        /// `place` is null or points to writable memory for a pointer.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $open(place: *mut *mut $handle) -> i32 {
            guarded(|| {
                // SAFETY: by the caller's promise.
                let place = unsafe { place.as_mut() }
                    .ok_or_else(|| Failure::new(Code::Usage, "open: the handle's place is null"))?;
                *place = std::ptr::null_mut();
                let own = <$own>::open().map_err(|error| Failure::new(Code::Open, error))?;
                *place = Box::into_raw(Box::new($handle(own)));
                Ok(Code::Ok)
            })
        }

        /// Leaves the instance and closes the handle. Null is allowed.
        ///
        /// # Safety
        /// `handle` comes from the function that opens it, is closed once, and is used no more.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $close(handle: *mut $handle) {
            guarded(|| {
                if !handle.is_null() {
                    // SAFETY: by the caller's promise it is ours, and nobody else uses it.
                    drop(unsafe { Box::from_raw(handle) });
                }
                Ok(Code::Ok)
            });
        }
    };
}

handle!(MlucRefiner, Refiner, mluc_refiner_open, mluc_refiner_close, "its refiner");
handle!(
    MlucConsumer,
    Consumer,
    mluc_consumer_open,
    mluc_consumer_close,
    "a consumer; the pipeline may start later"
);
handle!(
    MlucSource,
    Source,
    mluc_source_open,
    mluc_source_close,
    "its source of scans, in ingest's place"
);

/// Waits for the newest frame, at most `timeout_ms`. Heartbeats go out while it waits; call it again and again.
///
/// # Safety
/// `refiner` comes from [`mluc_refiner_open`] and was not closed, or is null; `frame` is null or points to writable memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mluc_refiner_wait(
    refiner: *mut MlucRefiner,
    timeout_ms: u32,
    frame: *mut MlucFrame,
) -> i32 {
    guarded(|| {
        // SAFETY: by the caller's promise.
        let (refiner, frame) = unsafe { (refiner.as_mut(), frame.as_mut()) };
        let (Some(refiner), Some(frame)) = (refiner, frame) else {
            let words = "wait: the handle or the frame is null";
            return Err(Failure::new(Code::Usage, words));
        };
        *frame = MlucFrame::zeroed();
        let code = refiner.0.wait(Duration::from_millis(timeout_ms.into()))?;
        if let Some((header, run, points, detections)) = refiner.0.frame() {
            *frame = MlucFrame {
                header,
                run,
                points: points.as_ptr(),
                points_count: points.len(),
                detections: detections.as_ptr(),
                detections_count: detections.len(),
            };
        }
        Ok(code)
    })
}

/// Publishes the objects of the frame that [`mluc_refiner_wait`] gave, once. `flags` are added to the header's.
///
/// # Safety
/// `refiner` as above; `objects` and `indices` point to as many elements as said, or their count is 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mluc_refiner_publish(
    refiner: *mut MlucRefiner,
    objects: *const Object,
    objects_count: usize,
    indices: *const u32,
    indices_count: usize,
    flags: u32,
) -> i32 {
    guarded(|| {
        // SAFETY: by the caller's promise.
        let refiner = unsafe { refiner.as_mut() }
            .ok_or_else(|| Failure::new(Code::Usage, "publish: null handle"))?;
        // SAFETY: by the caller's promise; every bit pattern is a sound Object.
        let objects = unsafe { slice_of("objects", objects, objects_count)? };
        // SAFETY: as above.
        let indices = unsafe { slice_of("indices", indices, indices_count)? };
        refiner.0.publish(objects, indices, Flags(flags))?;
        Ok(Code::Ok)
    })
}

/// Waits for the newest frame, at most `timeout_ms`. The status is given in any case.
///
/// # Safety
/// `consumer` comes from [`mluc_consumer_open`] and was not closed, or is null; `result` is null or points to writable memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mluc_consumer_wait(
    consumer: *mut MlucConsumer,
    timeout_ms: u32,
    result: *mut MlucResult,
) -> i32 {
    guarded(|| {
        // SAFETY: by the caller's promise.
        let (consumer, result) = unsafe { (consumer.as_mut(), result.as_mut()) };
        let (Some(MlucConsumer(consumer)), Some(result)) = (consumer, result) else {
            let words = "wait: the handle or the result is null";
            return Err(Failure::new(Code::Usage, words));
        };
        *result = MlucResult::zeroed();
        let code = consumer.wait(Duration::from_millis(timeout_ms.into()))?;
        result.status = consumer.status.as_ref().map_or(null(), from_ref);
        if let (Some(frame), Some(run)) = (&consumer.frame, consumer.run()) {
            let points = consumer.points(frame.header.sequence);
            (result.header, result.run) = (&frame.header, run);
            (result.points, result.points_count) = (points.as_ptr(), points.len());
            (result.objects, result.objects_count) = (frame.objects.as_ptr(), frame.objects.len());
            (result.indices, result.indices_count) = (frame.indices.as_ptr(), frame.indices.len());
        }
        Ok(code)
    })
}

/// # Safety
/// `handle` is null or an open one.
unsafe fn opened<'a>(handle: *mut MlucSource) -> Result<&'a mut Source, Failure> {
    // SAFETY: by the caller's promise.
    let handle = unsafe { handle.as_mut() };
    let null = || Failure::new(Code::Usage, "the source's handle is null");
    handle.map(|MlucSource(source)| source).ok_or_else(null)
}

/// Sleeps for `wait_ms` and sends heartbeats; gives the sequence of the next scan if one can be taken.
///
/// # Safety
/// `source` comes from [`mluc_source_open`] and was not closed, or is null; `sequence` is null or points to writable memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mluc_source_wait(
    source: *mut MlucSource,
    wait_ms: u32,
    sequence: *mut u64,
) -> i32 {
    guarded(|| {
        // SAFETY: by the caller's promise.
        let (source, sequence) = unsafe { (opened(source)?, sequence.as_mut()) };
        let code = source.wait(Duration::from_millis(wait_ms.into()))?;
        if let (Some(place), Some(next)) = (sequence, source.next) {
            *place = next;
        }
        Ok(code)
    })
}

/// Publishes a scan. `stamp_ns` 0: now; `name` null or empty: its number.
///
/// # Safety
/// `source` as above; `points` points to as many as said, or their count is 0; `name` is null or ends with NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mluc_source_publish(
    source: *mut MlucSource,
    points: *const Point,
    points_count: usize,
    stamp_ns: u64,
    name: *const c_char,
) -> i32 {
    guarded(|| {
        // SAFETY: by the caller's promise.
        let source = unsafe { opened(source)? };
        // SAFETY: as above; every bit pattern is a Point.
        let points = unsafe { slice_of("points", points, points_count)? };
        // SAFETY: by the caller's promise.
        let name = (!name.is_null()).then(|| unsafe { CStr::from_ptr(name) }.to_string_lossy());
        source.publish(points, stamp_ns, name.as_deref().filter(|name| !name.is_empty()))?;
        Ok(Code::Ok)
    })
}

/// Waits until the last scan has passed, at most `timeout_ms`, and reports the end of the input: the run ends.
///
/// # Safety
/// `source` as above.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mluc_source_finish(source: *mut MlucSource, timeout_ms: u32) -> i32 {
    // SAFETY: by the caller's promise.
    guarded(|| unsafe { opened(source) }?.finish(Duration::from_millis(timeout_ms.into())))
}

/// # Safety
/// `first` points to `count` elements, or `count` is 0.
unsafe fn slice_of<'a, T>(what: &str, first: *const T, count: usize) -> Result<&'a [T], Failure> {
    if count == 0 {
        return Ok(&[]);
    }
    if first.is_null() || !first.is_aligned() || count > isize::MAX as usize / size_of::<T>() {
        let words = format!("publish: {what}: expected {count} elements, found address {first:?}");
        return Err(Failure::new(Code::Usage, words));
    }
    // SAFETY: by the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(first, count) })
}
