//! The stack machine: opcodes of protocol 2, and the calls that tensors need.

use std::collections::HashMap;

use super::{Heap, Id, Object, PICKLE_BYTES_MAX};
use crate::exchange::ExchangeError;

/// Axes of a tensor.
pub(super) const AXES_MAX: usize = 8;

/// Reads one pickle at the start of `bytes`: every object, the one that it leaves, and how many bytes it took.
pub fn read(bytes: &[u8]) -> Result<(Heap, Id, usize), ExchangeError> {
    let mut machine = Machine {
        bytes: &bytes[..bytes.len().min(PICKLE_BYTES_MAX)],
        at: 0,
        stack: vec![],
        marks: vec![],
        memo: HashMap::new(),
        heap: Heap::default(),
    };
    while !machine.step()? {}
    let root = machine.pop("an object to leave")?;
    Ok((machine.heap, root, machine.at))
}

pub(super) struct Machine<'a> {
    bytes: &'a [u8],
    pub(super) at: usize,
    pub(super) stack: Vec<Id>,
    /// Heights of the stack.
    marks: Vec<usize>,
    memo: HashMap<u32, Id>,
    pub(super) heap: Heap,
}

impl Machine<'_> {
    /// One opcode; true at the end.
    fn step(&mut self) -> Result<bool, ExchangeError> {
        let opcode = self.take::<1>()?[0];
        match opcode {
            b'.' => return Ok(true),
            0x80 => self.protocol()?,
            b'}' => self.push(Object::Dictionary(vec![])),
            b']' | b')' => self.push(Object::List(vec![])),
            b'N' => self.push(Object::Nothing),
            0x88 | 0x89 => self.push(Object::Truth(opcode == 0x88)),
            b'J' => self.integer::<4>(|b| i64::from(i32::from_le_bytes(b)))?,
            b'K' => self.integer::<1>(|b| i64::from(b[0]))?,
            b'M' => self.integer::<2>(|b| i64::from(u16::from_le_bytes(b)))?,
            0x8A => self.long()?,
            b'G' => {
                let value = f64::from_be_bytes(self.take()?);
                self.push(Object::Float(value));
            }
            b'X' => self.text()?,
            b'(' => self.marks.push(self.stack.len()),
            b't' | b'l' => {
                let items = self.since_mark()?;
                self.push(Object::List(items));
            }
            0x85..=0x87 => self.tuple(usize::from(opcode - 0x84))?,
            b'q' => self.remember::<1>(|b| u32::from(b[0]))?,
            b'r' => self.remember::<4>(u32::from_le_bytes)?,
            b'h' => self.recall::<1>(|b| u32::from(b[0]))?,
            b'j' => self.recall::<4>(u32::from_le_bytes)?,
            b'c' => self.global()?,
            b'R' => self.call()?,
            b'Q' => self.persistent()?,
            b'b' => self.build()?,
            b's' => {
                let (value, key) = (self.pop("a value")?, self.pop("a key")?);
                self.set_items(&[key, value])?;
            }
            b'u' => {
                let items = self.since_mark()?;
                self.set_items(&items)?;
            }
            b'a' => {
                let item = self.pop("an item")?;
                self.append(vec![item])?;
            }
            b'e' => {
                let items = self.since_mark()?;
                self.append(items)?;
            }
            other => {
                let found = format!("opcode {:?} (0x{other:02x})", char::from(other));
                return Err(self.fault("an opcode of a protocol 2 pickle of tensors", found));
            }
        }
        Ok(false)
    }

    pub(super) fn fault(&self, expected: &'static str, found: impl Into<String>) -> ExchangeError {
        ExchangeError::Pickle {
            offset: self.at,
            expected,
            found: found.into(),
        }
    }

    fn slice(&mut self, count: usize) -> Result<&[u8], ExchangeError> {
        let left = self.bytes.len() - self.at;
        if count > left {
            return Err(self.fault("more bytes", format!("its end after {left}")));
        }
        self.at += count;
        Ok(&self.bytes[self.at - count..self.at])
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], ExchangeError> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.slice(N)?);
        Ok(bytes)
    }

    pub(super) fn push(&mut self, object: Object) {
        let id = self.heap.add(object);
        self.stack.push(id);
    }

    /// Never below a mark.
    pub(super) fn pop(&mut self, expected: &'static str) -> Result<Id, ExchangeError> {
        let floor = self.marks.last().copied().unwrap_or(0);
        match self.stack.len() > floor {
            true => self
                .stack
                .pop()
                .ok_or_else(|| self.fault(expected, "an empty stack")),
            false => Err(self.fault(expected, "an empty stack")),
        }
    }

    fn since_mark(&mut self) -> Result<Vec<Id>, ExchangeError> {
        match self.marks.pop() {
            Some(height) => Ok(self.stack.split_off(height)),
            None => Err(self.fault("a mark", "none")),
        }
    }

    fn protocol(&mut self) -> Result<(), ExchangeError> {
        match self.take::<1>()? {
            [2] => Ok(()),
            [other] => Err(self.fault("protocol 2", format!("protocol {other}"))),
        }
    }

    fn integer<const N: usize>(&mut self, value: fn([u8; N]) -> i64) -> Result<(), ExchangeError> {
        let bytes = self.take()?;
        self.push(Object::Integer(value(bytes)));
        Ok(())
    }

    /// Two's complement, little endian, as short as can be.
    fn long(&mut self) -> Result<(), ExchangeError> {
        let count = usize::from(self.take::<1>()?[0]);
        let bytes = self.slice(count)?;
        let fill = bytes.last().map_or(0, |last| ((*last as i8) >> 7) as u8);
        let mut whole = [fill; 8];
        let Some(low) = whole.get_mut(..count) else {
            return Err(self.fault("an integer of at most 8 bytes", format!("{count} bytes")));
        };
        low.copy_from_slice(bytes);
        self.push(Object::Integer(i64::from_le_bytes(whole)));
        Ok(())
    }

    fn text(&mut self) -> Result<(), ExchangeError> {
        let count = u32::from_le_bytes(self.take()?) as usize;
        let bytes = self.slice(count)?.to_vec();
        match String::from_utf8(bytes) {
            Ok(text) => self.push(Object::Text(text)),
            Err(_) => return Err(self.fault("text in UTF-8", "other bytes")),
        }
        Ok(())
    }

    fn tuple(&mut self, count: usize) -> Result<(), ExchangeError> {
        let mut items = (0..count)
            .map(|_| self.pop("an item of a tuple"))
            .collect::<Result<Vec<_>, _>>()?;
        items.reverse();
        self.push(Object::List(items));
        Ok(())
    }

    fn remember<const N: usize>(&mut self, key: fn([u8; N]) -> u32) -> Result<(), ExchangeError> {
        let key = key(self.take()?);
        match self.stack.last() {
            Some(id) => self.memo.insert(key, *id),
            None => return Err(self.fault("an object to remember", "an empty stack")),
        };
        Ok(())
    }

    fn recall<const N: usize>(&mut self, key: fn([u8; N]) -> u32) -> Result<(), ExchangeError> {
        let key = key(self.take()?);
        match self.memo.get(&key) {
            Some(id) => self.stack.push(*id),
            None => return Err(self.fault("a remembered object", format!("none under {key}"))),
        }
        Ok(())
    }

    pub(super) fn line(&mut self) -> Result<String, ExchangeError> {
        let rest = &self.bytes[self.at..];
        match rest.iter().take(256).position(|byte| *byte == b'\n') {
            Some(length) => {
                let line = String::from_utf8_lossy(&rest[..length]).into_owned();
                self.at += length + 1;
                Ok(line)
            }
            None => Err(self.fault("a line of at most 255 bytes", "no end of it")),
        }
    }

    fn set_items(&mut self, items: &[Id]) -> Result<(), ExchangeError> {
        let fault = self.fault("keys and values for a dictionary", "others");
        let Some(dictionary) = self.stack.last() else {
            return Err(fault);
        };
        match self.heap.get_mut(*dictionary) {
            Object::Dictionary(entries) if items.len().is_multiple_of(2) => {
                entries.extend(items.chunks_exact(2).map(|pair| (pair[0], pair[1])));
                Ok(())
            }
            _ => Err(fault),
        }
    }

    fn append(&mut self, items: Vec<Id>) -> Result<(), ExchangeError> {
        let fault = self.fault("a list to append to", "none");
        let Some(list) = self.stack.last() else {
            return Err(fault);
        };
        match self.heap.get_mut(*list) {
            Object::List(old) => {
                old.extend(items);
                Ok(())
            }
            _ => Err(fault),
        }
    }
}
