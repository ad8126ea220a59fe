//! The state_dict within a pickle.

use std::collections::BTreeMap;

use mluc_model::Tensor;

use super::values;
use crate::exchange::ExchangeError;
use crate::exchange::pickle::{Element, Heap, Id, Object, Storage};

/// Where the trainers of the world keep it.
const KEYS: [&str; 2] = ["model_state", "state_dict"];
/// Before every name where several devices trained.
const PARALLEL: &str = "module.";

/// Every tensor of floating point numbers, together at most `elements_max` of them: a small file could show one storage
/// under many names. `bytes` gives those of a storage.
pub(super) fn tensors<'a, B: AsRef<[u8]> + 'a>(
    heap: &Heap,
    root: Id,
    mut elements_max: usize,
    mut bytes: impl FnMut(&Storage) -> Result<B, ExchangeError>,
) -> Result<BTreeMap<String, Tensor>, ExchangeError> {
    let named = KEYS.iter().find_map(|key| heap.entry(root, key));
    let state = named.unwrap_or(root);
    let mut tensors = BTreeMap::new();
    for (name, value) in heap.entries(state) {
        let (Object::Text(name), Object::Tensor(place)) = (heap.get(*name), heap.get(*value))
        else {
            continue;
        };
        if !matches!(place.storage.element, Element::Integer(_)) {
            let left = elements_max.checked_sub(place.storage.count);
            elements_max = left.ok_or_else(|| ExchangeError::Tensor {
                tensor: name.clone(),
                expected: "no more elements than the file has bytes".into(),
                found: format!("{} further ones", place.storage.count),
            })?;
            let tensor = values::tensor(name, place, bytes(&place.storage)?.as_ref())?;
            tensors.insert(name.clone(), tensor);
        }
    }
    if tensors.is_empty() {
        return Err(ExchangeError::NoState {
            found: description(heap, root),
        });
    }
    Ok(without_prefix(tensors))
}

fn without_prefix(tensors: BTreeMap<String, Tensor>) -> BTreeMap<String, Tensor> {
    if !tensors.keys().all(|name| name.starts_with(PARALLEL)) {
        return tensors;
    }
    let bare = |(name, tensor): (String, Tensor)| (name[PARALLEL.len()..].to_owned(), tensor);
    tensors.into_iter().map(bare).collect()
}

fn description(heap: &Heap, root: Id) -> String {
    let keys = heap.entries(root).iter().take(8);
    let names = keys.filter_map(|(key, _)| match heap.get(*key) {
        Object::Text(text) => Some(text.as_str()),
        _ => None,
    });
    match heap.get(root) {
        Object::Dictionary(_) => {
            let names: Vec<_> = names.collect();
            format!("a dictionary with {names:?} and no tensors in it")
        }
        other => other.kind().into(),
    }
}
