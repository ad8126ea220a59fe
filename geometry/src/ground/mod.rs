//! The ground of a scan: the lowest point of every tile of 1 m, planes through them every 8 m, and heights on a grid.

mod grid;
mod lowest;
mod map;
mod plane;
pub mod tiles;

pub use grid::{GROUND_NODES, GroundGrid, ground_height_m};
pub use lowest::Lowest;
pub use map::GroundMap;
pub use plane::GroundPlane;
