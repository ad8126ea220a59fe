//! A running pipeline as ROS 2 messages, for programs that show, record or publish it.

mod follow;
mod subscriptions;

pub use follow::{Follower, Messages, Moment, TOPICS, yield_to_stages};
pub use subscriptions::subscribe;
