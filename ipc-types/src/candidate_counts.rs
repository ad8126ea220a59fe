//! What became of the candidates since a refiner began.

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

use crate::{Disposition, Object, ObjectKind};

/// Unknown objects that a refiner published or suppressed, since its process began. Other stages have zeros, and so has
/// a refiner that does not count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend))]
#[cfg_attr(feature = "iceoryx2", type_name("mluc.CandidateCounts"))]
#[repr(C)]
pub struct CandidateCounts {
    /// By [`Disposition`].
    pub by_disposition: [u64; Disposition::NAMES.len()],
    /// With [`Object::UNREFINED`].
    pub unrefined: u64,
    /// With [`Object::SPLIT`].
    pub split: u64,
    /// With [`Object::THINNED`].
    pub thinned: u64,
}

impl CandidateCounts {
    /// Adds the unknown objects of a frame.
    pub fn add(&mut self, objects: &[Object]) {
        let is_unknown = |object: &&Object| object.kind == ObjectKind::Unknown as u32;
        for object in objects.iter().filter(is_unknown) {
            if let Some(count) = self.by_disposition.get_mut(object.disposition as usize) {
                *count += 1;
            }
            let has = |flag: u32| u64::from(object.flags & flag != 0);
            self.unrefined += has(Object::UNREFINED);
            self.split += has(Object::SPLIT);
            self.thinned += has(Object::THINNED);
        }
    }

    /// All candidates.
    pub fn total(&self) -> u64 {
        self.by_disposition.iter().sum()
    }

    /// Each count with its word, in the order of the fields.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let flags = [self.unrefined, self.split, self.thinned];
        let by_flag = Object::FLAG_NAMES.into_iter().zip(flags);
        let names = Disposition::NAMES.into_iter();
        names.zip(self.by_disposition).chain(by_flag)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_objects_are_counted_by_disposition_and_flag() {
        let object = |kind, disposition, flags| Object {
            kind,
            disposition,
            flags,
            ..Object::zeroed()
        };
        let objects = [
            object(1, 0, Object::SPLIT | Object::THINNED),
            object(1, 0, Object::UNREFINED),
            object(1, Disposition::TooFewPoints as u32, 0),
            // A known one.
            object(0, 0, Object::SPLIT),
            // Of another program: no such disposition.
            object(1, 77, Object::SPLIT),
        ];
        let mut counts = CandidateCounts::default();
        counts.add(&objects);
        counts.add(&objects[..1]);
        let named: Vec<_> = counts.named().filter(|(_, count)| *count > 0).collect();
        let by_disposition = [("published", 3), ("too_few_points", 1)];
        let by_flag = [("unrefined", 1), ("split", 3), ("thinned", 2)];
        assert_eq!(named, [&by_disposition[..], &by_flag].concat());
        assert_eq!(counts.total(), 4);
        assert_eq!(counts.named().count(), Disposition::NAMES.len() + 3);
    }
}
