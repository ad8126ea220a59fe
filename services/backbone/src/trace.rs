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

/// A step of a frame that has just ended.
#[derive(Clone, Copy)]
pub struct Step<'a> {
    /// `ground`, `voxels`, `rulebooks`, `bev`, `rows`, or the layer's name.
    pub name: &'a str,
    /// Number of sites or cells with a row; of `ground` and `rulebooks` 0.
    pub sites: usize,
    /// Counts the products of an input row with the weights of a tap: by the layer's definition, and as multiplied (tiles need
    /// fewer). It takes time.
    pub products: &'a dyn Fn() -> [usize; 2],
}

/// Called after each step of a frame, in order, to measure times and count.
pub type Steps<'a> = &'a mut dyn FnMut(Step);

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

    /// Reports a step without products.
    pub(crate) fn step(&mut self, name: &str, sites: usize) {
        self.layer(name, sites, &|| [0; 2]);
    }

    pub(crate) fn layer(&mut self, name: &str, sites: usize, products: &dyn Fn() -> [usize; 2]) {
        if let Watch::Steps(steps) = self {
            steps(Step { name, sites, products });
        }
    }
}
