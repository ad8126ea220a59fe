//! Observation of a frame between the layers, for tests against other implementations.

use crate::{precision::Value, quant_scale::QuantScale, sites::Sites};

/// The positions of a level's rows.
#[derive(Clone, Copy, Debug)]
pub enum Place<'a> {
    /// One row per site of a sparse map.
    Sites(&'a Sites),
    /// One row per cell of a map with this number of rows (y) and columns (x), in that order.
    Map([usize; 2]),
}

/// The output of one layer.
#[derive(Clone, Copy, Debug)]
pub struct Level<'a> {
    /// Name: `voxels`, `bev`, or the layer's name.
    pub name: &'a str,
    /// The positions of its rows.
    pub place: Place<'a>,
    /// Number of channels of a row.
    pub channels: usize,
    /// Values, row after row.
    pub values: &'a [f32],
}

/// Called with each level of a frame, in order.
pub type Observer<'a> = &'a mut dyn FnMut(Level);

/// Called after each step of a frame, in order, with its name (`ground`, `voxels`, `rulebooks`, `bev`, `rows`, or the layer's), to measure times.
pub type Steps<'a> = &'a mut dyn FnMut(&str);

/// The observer of a frame while it is computed.
pub(crate) enum Watch<'a> {
    Nobody,
    Steps(Steps<'a>),
    /// With room for rows that have to be converted to f32.
    Levels(Observer<'a>, Vec<f32>),
}

impl Watch<'_> {
    /// Passes the rows of a level, with their scale applied, to the observer, if there is one.
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
            observer(Level { name, place, channels, values });
        }
    }

    pub(crate) fn step(&mut self, name: &str) {
        if let Watch::Steps(steps) = self {
            steps(name);
        }
    }
}
