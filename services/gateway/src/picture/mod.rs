//! Pictures of scans and boxes from above and from behind, without any window system: for `mluc demo`, `mluc-lab render` and the documentation.

mod bird_eye;
mod canvas;
mod captions;
mod font;
mod legend;
mod perspective;
mod view;

pub use bird_eye::bird_eye;
pub use canvas::{Canvas, Color};
pub use perspective::perspective;
pub(crate) use view::label_color;
pub use view::{BoxKind, DrawnBox, View, ramp};
