//! A frame as ROS 2 messages for recordings and viewers. No ROS installation is needed.
//!
//! A message is JSON with its type's field names; [`RosTopic::encode`] turns it into CDR. Points are too many for JSON.
//! Geometry stays in the sensor's frame; [`transform`] says where the sensor sits on the robot.

mod cdr;
mod messages;

pub use cdr::{BYTES_AT, RosTopic, encode_bytes, line_topic, stage_topic, topics};
pub use messages::{detections, diagnostics, header, markers, point_cloud, transform};
