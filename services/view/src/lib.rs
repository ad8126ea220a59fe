//! A running pipeline as ROS 2 messages, for programs that show, record or publish it.

mod follow;
mod subscriptions;

pub use follow::{Follower, Messages, Moment, TOPICS};
pub use subscriptions::subscribe;
