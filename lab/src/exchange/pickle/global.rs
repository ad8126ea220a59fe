//! The names that a pickle may call.

/// How a storage's elements are laid out, little endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// IEEE double.
    F64,
    /// IEEE single.
    F32,
    /// IEEE half.
    F16,
    /// The upper half of an IEEE single.
    Bf16,
    /// An integer or truth value of so many bytes: counters, never weights.
    Integer(usize),
}

impl Element {
    /// Bytes of one.
    pub fn bytes(self) -> usize {
        match self {
            Element::F64 => 8,
            Element::F32 => 4,
            Element::F16 | Element::Bf16 => 2,
            Element::Integer(bytes) => bytes,
        }
    }
}

/// What a pickle may name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Global {
    /// `collections.OrderedDict`.
    OrderedDict,
    /// `torch._utils._rebuild_tensor_v2`.
    RebuildTensor,
    /// `torch.FloatStorage` and its kin.
    Storage(Element),
    /// Numbers of numpy, in an optimiser's state: read over, their value is not needed.
    Ignored,
}

impl Global {
    /// None for everything that is not on the list.
    pub fn find(module: &str, name: &str) -> Option<Global> {
        let storage = |element| Some(Global::Storage(element));
        match (module, name) {
            ("collections", "OrderedDict") => Some(Global::OrderedDict),
            ("torch._utils", "_rebuild_tensor_v2") => Some(Global::RebuildTensor),
            ("torch", "DoubleStorage") => storage(Element::F64),
            ("torch", "FloatStorage") => storage(Element::F32),
            ("torch", "HalfStorage") => storage(Element::F16),
            ("torch", "BFloat16Storage") => storage(Element::Bf16),
            ("torch", "LongStorage") => storage(Element::Integer(8)),
            ("torch", "IntStorage") => storage(Element::Integer(4)),
            ("torch", "ShortStorage") => storage(Element::Integer(2)),
            ("torch", "CharStorage" | "ByteStorage" | "BoolStorage") => {
                storage(Element::Integer(1))
            }
            ("numpy.core.multiarray" | "numpy._core.multiarray", "scalar") => Some(Global::Ignored),
            ("numpy", "dtype") | ("_codecs", "encode") => Some(Global::Ignored),
            _ => None,
        }
    }
}
