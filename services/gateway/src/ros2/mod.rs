//! A frame as ROS 2 messages, without a ROS installation: what recordings hold and viewers show.
//!
//! A message is JSON by its type's field names, and [`RosTopic::encode`] turns it into CDR; points are too many for that.
//! Geometry stays in the sensor's frame; [`transform`] says where the sensor sits on the robot.

mod cdr;
mod messages;

pub use cdr::{BYTES_AT, RosTopic, encode_bytes, line_topic, stage_topic, topics};
pub use messages::{detections, diagnostics, header, markers, point_cloud, transform};
