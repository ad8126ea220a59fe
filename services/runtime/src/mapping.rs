//! The shared segments that this process maps: touching their pages before the first frame, and proving that a payload lies inside one.
//!
//! At the first write to a fresh page of shared memory the kernel must provide the page. Measured: the first 36 MB message takes
//! 18 times as long as later ones. iceoryx2 has no option that touches pages in advance.

use crate::{Instance, error::Result, instance::SHARED_MEMORY};
use std::{collections::HashSet, ops::Range};

/// A part of this process's address space that maps a data segment of an instance.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Mapping {
    pub(crate) addresses: Range<usize>,
    pub(crate) is_writable: bool,
    pub(crate) inode: u64,
}

/// The data segments of `instance` that this process maps.
pub(crate) fn mappings(instance: &Instance) -> Vec<Mapping> {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let start = format!("{SHARED_MEMORY}/{}", instance.prefix());
    maps.lines().filter_map(|line| parse(line, &start)).collect()
}

/// `7f00-7f10 rw-s 00000000 00:1a 42 /dev/shm/mluc-0-a.1.data`
fn parse(line: &str, start: &str) -> Option<Mapping> {
    let mut words = line.split_whitespace();
    let (from, to) = words.next()?.split_once('-')?;
    let rights = words.next()?;
    let inode = words.nth(2)?.parse().ok()?;
    let path = words.next()?;
    if !(path.starts_with(start) && path.ends_with(".data")) {
        return None;
    }
    let address = |text| usize::from_str_radix(text, 16).ok();
    Some(Mapping {
        addresses: address(from)?..address(to)?,
        is_writable: rights.contains('w'),
        inode,
    })
}

/// Which segment `slice` lies in.
pub(crate) fn segment_of<T>(instance: &Instance, slice: &[T]) -> Option<Mapping> {
    let at = slice.as_ptr_range();
    let (start, end) = (at.start as usize, at.end as usize);
    let holds = |m: &Mapping| m.addresses.start <= start && end <= m.addresses.end;
    mappings(instance).into_iter().find(holds)
}

/// Bytes that are touched at a time: on busy cores, a whole segment may take longer than a stage may be silent.
const PIECE_BYTES: usize = 8 << 20;

/// Remembers which segments were touched.
#[derive(Debug, Default)]
pub(crate) struct Prefault {
    touched: HashSet<(usize, u64)>,
    has_failed: bool,
}

impl Prefault {
    /// Touches every page of the segments that are new since the last call, for writing if this process may write. Calls `beat`
    /// between two pieces. Skips a segment that cannot be touched (old kernel, memory full), and logs the first such segment.
    pub(crate) fn touch(
        &mut self,
        instance: &Instance,
        mut beat: impl FnMut() -> Result<()>,
    ) -> Result<()> {
        for mapping in mappings(instance) {
            if !self.touched.insert((mapping.addresses.start, mapping.inode)) {
                continue;
            }
            for start in mapping.addresses.clone().step_by(PIECE_BYTES) {
                let bytes = PIECE_BYTES.min(mapping.addresses.end - start);
                if let Err(error) = populate(start, bytes, mapping.is_writable) {
                    if !std::mem::replace(&mut self.has_failed, true) {
                        tracing::warn!(
                            %error,
                            bytes = mapping.addresses.len(),
                            "cannot touch shared memory ahead of time: first frames will be slow, and a full /dev/shm ends a stage"
                        );
                    }
                    break;
                }
                beat()?;
            }
        }
        Ok(())
    }
}

#[allow(unsafe_code)]
fn populate(start: usize, bytes: usize, is_writable: bool) -> std::io::Result<()> {
    use rustix::mm::{Advice, madvise};
    let [read, write] = [Advice::LinuxPopulateRead, Advice::LinuxPopulateWrite];
    let advice = if is_writable { write } else { read };
    let start = start as *mut std::ffi::c_void;
    // SAFETY: MADV_POPULATE_* only faults pages in; it changes no content and fails with an error, not a signal, when
    // the range is no longer mapped. The range comes from /proc/self/maps, whole pages.
    unsafe { madvise(start, bytes, advice) }.map_err(std::io::Error::from)
}
