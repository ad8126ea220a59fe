//! What a measured run says: from one record a frame to percentiles, a page, a verdict between two runs, and a trace.
//!
//! Pure functions of records: no clock, file or process. `mluc bench` makes the records from the stamps in the frames'
//! headers and writes what comes out of here. The terms:
//!
//! - **due**: when the scan should have entered, by the fixed rate (open loop). Everything counts from there.
//! - **latency** of a frame: from due to the publication of its objects. A frame that was dropped counts too, with the time
//!   until a newer frame's objects were out: so long did the vehicle know nothing newer. So a stall of a second at 10 Hz
//!   makes ten late frames, not one (no coordinated omission).
//! - **queue** of a stage: from the publication of its input to the start of computing. **run**: from there to the
//!   publication of its result. Queue and run of all stages, with ingest's wait for its time, add up to the latency.
//! - **hand-over** of a topic: from publication to the consumer having it, of frames whose consumer was idle. What a busy
//!   consumer adds is queueing and no property of the transport.

mod bootstrap;
mod chart;
mod compare;
mod csv;
mod error;
mod frame;
mod histogram;
mod page;
mod random;
mod report;
mod series;
mod statistics;
mod timeline;
mod trace;
mod waterfall;

pub use compare::{Comparison, Options as CompareOptions, Row, Verdict, compare};
pub use csv::{read_frames, write_frames};
pub use error::ReportError;
pub use frame::{Frame, HOPS, STAGES, Stamps};
pub use page::page;
pub use report::{
    ByHop, ByStage, FirstFrame, FrameCounts, Hop, HopsTogether, REPORT_VERSION, Report, Resources,
    StageReport, check_version,
};
pub use series::{Series, series};
pub use statistics::{Percentiles, quantile};
pub use timeline::Sample;
pub use trace::{Selection, Span, chrome_trace, parse_span};
