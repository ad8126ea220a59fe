//! The pipeline's outputs: JSON lines, ROS 2 messages and pictures, as pure functions of what the pipeline published.

pub mod lines;
pub mod picture;
pub mod ros2;
