//! The calls that tensors need, and no other.

use super::machine::{AXES_MAX, Machine};
use super::{Global, Id, Object, Storage, TensorPlace};
use crate::exchange::ExchangeError;

impl Machine<'_> {
    /// Two lines: module and name.
    pub(super) fn global(&mut self) -> Result<(), ExchangeError> {
        let offset = self.at;
        let (module, name) = (self.line()?, self.line()?);
        match Global::find(&module, &name) {
            Some(global) => self.push(Object::Global(global)),
            None => {
                let global = format!("{module}.{name}");
                return Err(ExchangeError::Global { offset, global });
            }
        }
        Ok(())
    }

    pub(super) fn call(&mut self) -> Result<(), ExchangeError> {
        let (arguments, function) = (self.pop("arguments")?, self.pop("a global to call")?);
        let made = match self.heap.get(function) {
            Object::Global(Global::OrderedDict) => self.ordered(arguments)?,
            Object::Global(Global::RebuildTensor) => self.tensor(arguments)?,
            Object::Global(Global::Ignored) => Object::Ignored,
            other => {
                let found = other.kind();
                return Err(self.fault("a global to call", found));
            }
        };
        self.push(made);
        Ok(())
    }

    fn ordered(&self, arguments: Id) -> Result<Object, ExchangeError> {
        match self.heap.get(arguments) {
            Object::List(items) if items.is_empty() => Ok(Object::Dictionary(vec![])),
            _ => Err(self.fault("OrderedDict without arguments", "some")),
        }
    }

    /// (storage, offset, shape, stride, requires_grad, hooks).
    fn tensor(&self, arguments: Id) -> Result<Object, ExchangeError> {
        let fault = || self.fault("storage, offset, shape, stride of a tensor", "others");
        let Object::List(items) = self.heap.get(arguments) else {
            return Err(fault());
        };
        let [storage, offset, shape, stride, ..] = items[..] else {
            return Err(fault());
        };
        let Object::Storage(storage) = self.heap.get(storage) else {
            return Err(fault());
        };
        let offset = self.heap.size(offset).ok_or_else(fault)?;
        let shape = self.heap.sizes(shape).ok_or_else(fault)?;
        let stride = self.heap.sizes(stride).ok_or_else(fault)?;
        if shape.len() != stride.len() || shape.len() > AXES_MAX {
            return Err(self.fault("a stride for each of at most 8 axes", "others"));
        }
        Ok(Object::Tensor(TensorPlace {
            storage: storage.clone(),
            offset,
            shape,
            stride,
        }))
    }

    /// ('storage', type, key, device, count).
    pub(super) fn persistent(&mut self) -> Result<(), ExchangeError> {
        let id = self.pop("a persistent id")?;
        let Object::List(items) = self.heap.get(id) else {
            return Err(self.fault("the id of a storage", "another"));
        };
        let objects: Vec<&Object> = items.iter().map(|item| self.heap.get(*item)).collect();
        let storage = match objects[..] {
            [
                Object::Text(kind),
                Object::Global(Global::Storage(element)),
                Object::Text(key),
                Object::Text(_),
                Object::Integer(count),
                ..,
            ] if kind == "storage" && *count >= 0 => Storage {
                key: key.clone(),
                element: *element,
                count: *count as usize,
            },
            _ => return Err(self.fault("the id of a storage", "another")),
        };
        self.push(Object::Storage(storage));
        Ok(())
    }

    /// Attributes of a dictionary (`_metadata` of a state_dict) and of numpy's types say nothing of weights.
    pub(super) fn build(&mut self) -> Result<(), ExchangeError> {
        self.pop("a state")?;
        match self.stack.last().map(|id| self.heap.get(*id)) {
            Some(Object::Dictionary(_) | Object::Ignored) => Ok(()),
            Some(other) => Err(self.fault("a dictionary to be given a state", other.kind())),
            None => Err(self.fault("a dictionary to be given a state", "an empty stack")),
        }
    }
}
