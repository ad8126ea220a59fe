//! PyTorch's format before 1.6, in which OpenPCDet's published checkpoints are: five pickles (a magic number, a version,
//! the system, the object, the storages' keys), then each storage as its count (u64) and elements, little endian.

use std::collections::HashMap;

use super::{Checkpoint, state};
use crate::exchange::ExchangeError;
use crate::exchange::pickle::{self, Heap, Object, Storage};

/// The first two pickles: the number 0x1950a86a20f9469cfc6c, and 1001.
pub(super) const MAGIC: [u8; 21] =
    *b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.\x80\x02M\xe9\x03.";

pub(super) fn read(bytes: &[u8]) -> Result<Checkpoint, ExchangeError> {
    let mut at = MAGIC.len();
    let mut next = || -> Result<(Heap, usize), ExchangeError> {
        let (heap, root, taken) = pickle::read(&bytes[at..])?;
        at += taken;
        Ok((heap, root))
    };
    let (system, root) = next()?;
    let little = system.entry(root, "little_endian");
    if little.is_some_and(|id| *system.get(id) == Object::Truth(false)) {
        return Err(fault("system", "little endian", "big endian"));
    }
    let (heap, root) = next()?;
    let (keys, list) = next()?;
    let counts = counts(&heap);
    let storages = storages(&keys, list, &counts, &bytes[at..])?;
    let tensors = state::tensors(&heap, root, bytes.len(), |storage: &Storage| {
        let bytes = storages.get(storage.key.as_str());
        bytes.ok_or_else(|| fault(&storage.key, "in the list of storages", "none"))
    })?;
    Ok(Checkpoint {
        tensors,
        manifest: None,
    })
}

/// Every storage that the object names.
fn counts(heap: &Heap) -> HashMap<&str, &Storage> {
    let storages = heap.objects().filter_map(|object| match object {
        Object::Storage(storage) => Some((storage.key.as_str(), storage)),
        _ => None,
    });
    storages.collect()
}

/// The bytes of each storage, in the order of the keys.
fn storages<'a>(
    keys: &'a Heap,
    list: usize,
    named: &HashMap<&str, &Storage>,
    mut bytes: &'a [u8],
) -> Result<HashMap<&'a str, &'a [u8]>, ExchangeError> {
    let Object::List(ids) = keys.get(list) else {
        return Err(fault("keys", "a list", keys.get(list).kind()));
    };
    let mut found = HashMap::new();
    for id in ids {
        let Object::Text(key) = keys.get(*id) else {
            return Err(fault("keys", "texts", keys.get(*id).kind()));
        };
        let storage = named.get(key.as_str());
        let storage = storage.ok_or_else(|| fault(key, "a tensor that uses it", "none"))?;
        let (count, rest) = bytes
            .split_first_chunk::<8>()
            .ok_or_else(|| fault(key, "its count", "the end of the file"))?;
        let count = u64::from_le_bytes(*count);
        if count != storage.count as u64 {
            let expected = format!("{} elements", storage.count);
            return Err(fault(key, &expected, &count.to_string()));
        }
        let size = storage.count.checked_mul(storage.element.bytes());
        let (data, rest) = size
            .and_then(|size| rest.split_at_checked(size))
            .ok_or_else(|| fault(key, "its elements", "the end of the file"))?;
        found.insert(key.as_str(), data);
        bytes = rest;
    }
    Ok(found)
}

fn fault(record: &str, expected: &str, found: &str) -> ExchangeError {
    ExchangeError::Record {
        record: record.into(),
        expected: expected.into(),
        found: found.into(),
    }
}
