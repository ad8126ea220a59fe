//! The ground of a scan: the lowest point of every tile of 1 m, the plane that most of them lie on, and a surface through them.

mod grid;
mod lowest;
mod plane;
pub mod tiles;

pub use grid::{GROUND_HALF_M, GROUND_NODES, GroundGrid, ground_height_m};
pub use lowest::{Lowest, lower_point};
pub use plane::GroundPlane;
