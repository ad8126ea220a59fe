//! Orders of axes of a sparse convolution's weights: they changed between versions of spconv, and a file does not say
//! which it has. The layers whose channels differ in number tell.

use mluc_model::Tensor;

/// (z, y, x) are the taps of the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SparseLayout {
    /// spconv 2: (out, z, y, x, in), which is also ours.
    OutTapsIn,
    /// spconv 1: (z, y, x, in, out).
    TapsInOut,
    /// spconv 2 with its native algorithm: (z, y, x, out, in).
    TapsOutIn,
}

impl SparseLayout {
    /// Every layout that is read, the likeliest first.
    pub const ALL: [SparseLayout; 3] = [
        SparseLayout::OutTapsIn,
        SparseLayout::TapsInOut,
        SparseLayout::TapsOutIn,
    ];

    /// The shape in this layout of a tensor with shape `ours`.
    pub fn shape(self, [out, z, y, x, cin]: [usize; 5]) -> [usize; 5] {
        match self {
            SparseLayout::OutTapsIn => [out, z, y, x, cin],
            SparseLayout::TapsInOut => [z, y, x, cin, out],
            SparseLayout::TapsOutIn => [z, y, x, out, cin],
        }
    }

    /// The first layout that fits every layer: pairs of our shape and the shape found.
    pub fn of(layers: &[([usize; 5], Vec<usize>)]) -> Option<SparseLayout> {
        let fits = |layout: &SparseLayout| {
            let mut layers = layers.iter();
            layers.all(|(ours, found)| layout.shape(*ours)[..] == found[..])
        };
        SparseLayout::ALL.into_iter().find(fits)
    }

    /// From this layout to ours, (out, z, y, x, in). `tensor` has [`SparseLayout::shape`] of `ours`.
    pub fn to_ours(self, tensor: &Tensor, ours: [usize; 5]) -> Tensor {
        let [out, z, y, x, cin] = ours;
        let taps = z * y * x;
        let at = |o: usize, tap: usize, i: usize| match self {
            SparseLayout::OutTapsIn => (o * taps + tap) * cin + i,
            SparseLayout::TapsInOut => (tap * cin + i) * out + o,
            SparseLayout::TapsOutIn => (tap * out + o) * cin + i,
        };
        let places = (0..out * taps * cin).map(|n| at(n / cin / taps, n / cin % taps, n % cin));
        Tensor {
            shape: ours.to_vec(),
            data: places.map(|place| tensor.data[place]).collect(),
        }
    }
}
