//! What a pickle builds.

use super::{Element, Global};

/// Place of an object in its [`Heap`].
pub type Id = usize;

/// A run of equal elements somewhere in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Storage {
    /// Its name in the file.
    pub key: String,
    /// What it holds.
    pub element: Element,
    /// How many, as the pickle says; the record itself must agree.
    pub count: usize,
}

/// A tensor: a strided view of a storage. Nothing of it has been checked against the storage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorPlace {
    /// Where its numbers are.
    pub storage: Storage,
    /// Element of the storage that is the tensor's first.
    pub offset: usize,
    /// Elements along each axis.
    pub shape: Vec<usize>,
    /// Elements of the storage between neighbours of each axis.
    pub stride: Vec<usize>,
}

/// One value.
#[derive(Clone, Debug, PartialEq)]
pub enum Object {
    /// `None`.
    Nothing,
    /// Truth value.
    Truth(bool),
    /// Integer of at most 8 bytes.
    Integer(i64),
    /// Floating point number.
    Float(f64),
    /// Text.
    Text(String),
    /// Tuple or list.
    List(Vec<Id>),
    /// Dictionary in its order.
    Dictionary(Vec<(Id, Id)>),
    /// One of the allowed names.
    Global(Global),
    /// By a persistent id.
    Storage(Storage),
    /// By `_rebuild_tensor_v2`.
    Tensor(TensorPlace),
    /// Something whose value is not needed.
    Ignored,
}

impl Object {
    /// For messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Object::Nothing => "None",
            Object::Truth(_) => "a truth value",
            Object::Integer(_) => "an integer",
            Object::Float(_) => "a number",
            Object::Text(_) => "a text",
            Object::List(_) => "a list or tuple",
            Object::Dictionary(_) => "a dictionary",
            Object::Global(_) => "a global",
            Object::Storage(_) => "a storage",
            Object::Tensor(_) => "a tensor",
            Object::Ignored => "a value of numpy",
        }
    }
}

/// Every object of a pickle. They refer to each other by index, so a cycle is harmless to whoever does not follow it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heap {
    objects: Vec<Object>,
}

impl Heap {
    pub(super) fn add(&mut self, object: Object) -> Id {
        self.objects.push(object);
        self.objects.len() - 1
    }

    /// The object of an id of this heap.
    pub fn get(&self, id: Id) -> &Object {
        &self.objects[id]
    }

    pub(super) fn get_mut(&mut self, id: Id) -> &mut Object {
        &mut self.objects[id]
    }

    /// Every object, in the order of making.
    pub fn objects(&self) -> impl Iterator<Item = &Object> {
        self.objects.iter()
    }

    /// The entries of a dictionary; none where `id` is none.
    pub fn entries(&self, id: Id) -> &[(Id, Id)] {
        match self.get(id) {
            Object::Dictionary(entries) => entries,
            _ => &[],
        }
    }

    /// The value under a text key; the last one given counts.
    pub fn entry(&self, dictionary: Id, key: &str) -> Option<Id> {
        let named =
            |(name, _): &&(Id, Id)| matches!(self.get(*name), Object::Text(text) if text == key);
        let entry = self.entries(dictionary).iter().rev().find(named);
        entry.map(|(_, value)| *value)
    }

    /// A list's items as sizes, none where one is no integer from 0 on.
    pub(super) fn sizes(&self, id: Id) -> Option<Vec<usize>> {
        let Object::List(items) = self.get(id) else {
            return None;
        };
        items.iter().map(|item| self.size(*item)).collect()
    }

    pub(super) fn size(&self, id: Id) -> Option<usize> {
        match self.get(id) {
            Object::Integer(value) => usize::try_from(*value).ok(),
            _ => None,
        }
    }
}
