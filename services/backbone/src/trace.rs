//! Looking at a frame between the layers, for tests against other implementations.

use crate::{precision::Value, quant_scale::QuantScale, sites::Sites};

/// Where the rows of a level lie.
#[derive(Clone, Copy, Debug)]
pub enum Place<'a> {
    /// One row a site of a sparse map.
    Sites(&'a Sites),
    /// One row a cell of a map with so many rows (y) and columns (x), in that order.
    Map([usize; 2]),
}

/// The output of one layer.
#[derive(Clone, Copy, Debug)]
pub struct Level<'a> {
    /// `voxels`, `bev`, or the layer's name.
    pub name: &'a str,
    /// Where its rows lie.
    pub place: Place<'a>,
    /// Of a row.
    pub channels: usize,
    /// Row after row.
    pub values: &'a [f32],
}

/// Called with each level of a frame, in order.
pub type Observer<'a> = &'a mut dyn FnMut(Level);

/// Called after each step of a frame, in order, with its name (`ground`, `voxels`, `rulebooks`, `bev`, `rows`, or the layer's): the caller may look at a clock.
pub type Steps<'a> = &'a mut dyn FnMut(&str);

/// Who looks on while a frame is computed.
pub(crate) enum Watch<'a> {
    Nobody,
    Steps(Steps<'a>),
    /// With room for rows that are not f32 and have to be written out.
    Levels(Observer<'a>, Vec<f32>),
}

impl Watch<'_> {
    /// Shows the rows of a level, in the scale given; whether anybody looks is decided here.
    pub(crate) fn level<V: Value>(
        &mut self,
        name: &str,
        place: Place,
        channels: usize,
        (values, scale): (&[V], &QuantScale),
    ) {
        if let Watch::Levels(observer, written_out) = self {
            let mut values = V::as_f32(values, written_out);
            if scale.0.is_some() {
                scale.apply(written_out);
                values = written_out;
            }
            observer(Level {
                name,
                place,
                channels,
                values,
            });
        }
    }

    pub(crate) fn step(&mut self, name: &str) {
        if let Watch::Steps(steps) = self {
            steps(name);
        }
    }
}
