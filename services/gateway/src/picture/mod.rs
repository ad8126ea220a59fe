//! Pictures of scans and boxes from above, without any window system: for `mluc demo`, `mluc-lab render` and the documentation.

mod bird_eye;
mod canvas;
mod captions;
mod font;
mod legend;
mod view;

pub use bird_eye::bird_eye;
pub use canvas::{Canvas, Color};
pub(crate) use view::label_color;
pub use view::{BoxKind, DrawnBox, View, ramp};
