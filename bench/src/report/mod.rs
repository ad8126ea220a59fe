//! Evaluates a measured run: from one record per frame to percentiles, a page, and a verdict between two runs.
//!
//! Pure functions of records: no clock, file or process. The terms:
//!
//! - **due**: when the scan should have entered, by the fixed rate (open loop). All times count from there.
//! - **latency** of a frame: from due to the publication of its objects. A frame that was dropped counts too, with the time
//!   until a newer frame's objects were out (the age of the newest available result). So a stall of a second at 10 Hz makes
//!   ten late frames, not one (no coordinated omission).
//! - **queue** of a stage: from the publication of its input to the start of computing. **run**: from there to the
//!   publication of its result. Queue and run of all stages, with ingest's wait for its time, add up to the latency.
//! - **hand-over** of a topic: from publication until the consumer has it, of frames whose consumer was idle. The delay of a busy
//!   consumer is queueing and no property of the transport.

mod bootstrap;
mod charts;
mod compare;
mod csv;
mod figures;
mod frame;
mod page;
mod series;

pub(crate) use compare::{FRAMES_MIN, compare, comparison_table};
pub(crate) use csv::{read_frames, write_frames};
pub(crate) use figures::{Resources, check_version, number, report_of};
pub(crate) use frame::{FrameRecord, HOPS, STAGES, Stamps};
pub(crate) use page::{page, render, table};
