//! Pictures of scans and boxes from above, without any window system: for `mluc demo`, `mluc-lab render` and the documentation.

mod bird_eye;
mod canvas;
mod captions;
mod color;
mod font;
mod legend;

pub use bird_eye::{BoxKind, DrawnBox, PointColor, View, bird_eye};
pub use canvas::{Canvas, Color, PictureError};
pub use color::{label_color, ramp};
