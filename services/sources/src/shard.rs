//! One part of many scans, for job arrays: every Nth scan from the Ith on.

/// Parses `I/N`: part I, from 0 to N-1, of N parts.
pub fn shard(text: &str) -> Result<[u32; 2], String> {
    let numbers = text.split_once('/').and_then(|(i, n)| Some([i.parse().ok()?, n.parse().ok()?]));
    let fits = numbers.filter(|[index, count]| index < count);
    fits.ok_or_else(|| format!("expected I/N with I from 0 to N-1, found {text}"))
}

/// Index among all scans of a part's scan number `sequence`; `None`: all scans are one part.
pub fn place(shard: Option<[u32; 2]>, sequence: u64) -> u64 {
    let [index, count] = shard.unwrap_or([0, 1]).map(u64::from);
    sequence * count + index
}

/// Number of scans in a part of `count` scans.
pub(crate) fn scans(shard: Option<[u32; 2]>, count: u64) -> u64 {
    let [index, parts] = shard.unwrap_or([0, 1]).map(u64::from);
    count.saturating_sub(index).div_ceil(parts)
}
