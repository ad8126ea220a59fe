//! A part of many scans, for job arrays: every Nth from the Ith on.

/// `I/N`: part I, from 0 to N-1, of N.
pub fn shard(text: &str) -> Result<[u32; 2], String> {
    let parts = text.split_once('/');
    let numbers = parts.and_then(|(i, n)| Some([i.parse().ok()?, n.parse().ok()?]));
    let fits = numbers.filter(|[index, count]| index < count);
    fits.ok_or_else(|| format!("expected I/N with I from 0 to N-1, found {text}"))
}

/// Which of all scans a part's scan is; `None`: all are one part.
pub fn place(shard: Option<[u32; 2]>, sequence: u64) -> u64 {
    let [index, count] = shard.unwrap_or([0, 1]).map(u64::from);
    sequence * count + index
}

/// How many of so many scans a part has.
pub(crate) fn scans(shard: Option<[u32; 2]>, count: u64) -> u64 {
    let [index, parts] = shard.unwrap_or([0, 1]).map(u64::from);
    count.saturating_sub(index).div_ceil(parts)
}
