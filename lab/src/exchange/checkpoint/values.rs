//! Bytes of a storage as f32.

use mluc_model::Tensor;

use crate::exchange::ExchangeError;
use crate::exchange::pickle::{Element, TensorPlace};

/// Little-endian elements as f32; f64 is rounded. Integers give nothing.
pub(super) fn numbers(bytes: &[u8], element: Element) -> Vec<f32> {
    let halves = |convert: fn(u16) -> f32| -> Vec<f32> {
        let values = bytes.as_chunks::<2>().0.iter();
        values.map(|b| convert(u16::from_le_bytes(*b))).collect()
    };
    match element {
        Element::F32 => {
            let values = bytes.as_chunks::<4>().0.iter();
            values.map(|b| f32::from_le_bytes(*b)).collect()
        }
        Element::F64 => {
            let values = bytes.as_chunks::<8>().0.iter();
            values.map(|b| f64::from_le_bytes(*b) as f32).collect()
        }
        Element::Bf16 => halves(|bits| f32::from_bits(u32::from(bits) << 16)),
        Element::F16 => halves(half),
        Element::Integer(_) => vec![],
    }
}

/// IEEE half: 1 sign, 5 exponent, 10 fraction bits.
fn half(bits: u16) -> f32 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f32::from(bits & 0x3FF));
    let size = match exponent {
        0 => fraction * 2.0_f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1024.0 + fraction) * 2.0_f32.powi(exponent - 25),
    };
    if bits >> 15 == 1 { -size } else { size }
}

/// The tensor's numbers out of its storage's bytes, row-major.
pub(super) fn tensor(
    name: &str,
    place: &TensorPlace,
    bytes: &[u8],
) -> Result<Tensor, ExchangeError> {
    let storage = &place.storage;
    let fault = |expected: String, found: String| ExchangeError::Tensor {
        tensor: name.into(),
        expected,
        found,
    };
    if storage.count.checked_mul(storage.element.bytes()) != Some(bytes.len()) {
        let expected = format!("{} elements of {:?}", storage.count, storage.element);
        return Err(fault(expected, format!("{} bytes", bytes.len())));
    }
    let count = (place.shape.iter()).try_fold(1_usize, |count, axis| count.checked_mul(*axis));
    let axes = || place.shape.iter().zip(&place.stride);
    let last = axes().try_fold(place.offset, |last, (axis, stride)| {
        last.checked_add(axis.saturating_sub(1).checked_mul(*stride)?)
    });
    // A weight shows each element of its storage at most once, so its size is bounded by the file's.
    let (Some(count), Some(last)) = (count, last) else {
        return Err(fault("a size in bounds".into(), format!("{place:?}")));
    };
    if count > storage.count || (count > 0 && last >= storage.count) {
        let expected = format!("a view within {} elements", storage.count);
        return Err(fault(expected, format!("{count} up to element {last}")));
    }
    let all = numbers(bytes, storage.element);
    let at = |index: usize| {
        let mut rest = index;
        let steps = axes().rev().map(|(axis, stride)| {
            let here = rest % axis;
            rest /= axis;
            here * stride
        });
        place.offset + steps.sum::<usize>()
    };
    Ok(Tensor {
        shape: place.shape.clone(),
        data: (0..count).map(|index| all[at(index)]).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exchange::pickle::Storage;

    #[test]
    fn every_element_becomes_f32() {
        assert_eq!(numbers(&1.5_f64.to_le_bytes(), Element::F64), [1.5]);
        assert_eq!(numbers(&[0xC0, 0x3F], Element::Bf16), [1.5]);
        // 1.5, -2, the smallest, the largest, infinity.
        let halves = [0x3E00_u16, 0xC000, 0x0001, 0x7BFF, 0x7C00];
        let bytes: Vec<u8> = halves.iter().flat_map(|h| h.to_le_bytes()).collect();
        let expected = [1.5, -2.0, 5.960_464_5e-8, 65504.0, f32::INFINITY];
        assert_eq!(numbers(&bytes, Element::F16), expected);
        assert!(numbers(&[0x01, 0x7C], Element::F16)[0].is_nan());
    }

    #[test]
    fn strides_are_followed_and_bounded() {
        let bytes: Vec<u8> = (0..6).flat_map(|i| (i as f32).to_le_bytes()).collect();
        let mut place = TensorPlace {
            storage: Storage {
                key: "0".into(),
                element: Element::F32,
                count: 6,
            },
            offset: 0,
            shape: vec![3, 2],
            stride: vec![1, 3],
        };
        let found = tensor("t", &place, &bytes).expect("in bounds");
        assert_eq!(found.data, [0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
        place.offset = 1;
        assert!(tensor("t", &place, &bytes).is_err(), "beyond the storage");
        (place.offset, place.stride) = (0, vec![usize::MAX, 2]);
        assert!(tensor("t", &place, &bytes).is_err(), "overflow");
        (place.shape, place.stride) = (vec![1 << 40, 1 << 20], vec![0, 0]);
        assert!(
            tensor("t", &place, &bytes).is_err(),
            "one element shown for ever"
        );
        assert!(tensor("t", &place, &bytes[..20]).is_err(), "cut short");
    }
}
