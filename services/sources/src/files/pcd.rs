//! PCD 0.7 of the Point Cloud Library: a header of lines, then points as text, rows, or columns compressed with LZF.

use super::table::{Field, Kind, Table};
use crate::{SourceError, refused};

/// Maximum size of a compressed scan after unpacking, bytes.
const UNPACKED_MAX: usize = 256 << 20;

pub(super) fn table(file: &[u8]) -> Result<Table, SourceError> {
    let mut header = Header::default();
    let mut rest = file;
    let data = loop {
        let end = rest.iter().position(|byte| *byte == b'\n');
        let end = end.ok_or_else(|| SourceError::field("header", "a line DATA", "none"))?;
        let line = String::from_utf8_lossy(&rest[..end]).into_owned();
        rest = &rest[end + 1..];
        let mut words = line.split_whitespace().map(str::to_string);
        let Some(key) = words.next().filter(|key| !key.starts_with('#')) else {
            continue;
        };
        let words: Vec<String> = words.collect();
        if key == "DATA" {
            break words.join(" ");
        }
        header.take(&key, words)?;
    };
    let (fields, points) = (header.fields()?, header.points);
    let points = points.ok_or_else(|| SourceError::field("header", "a line POINTS", "none"))?;
    match data.as_str() {
        "ascii" => Table::of_text(rest, &fields, points),
        "binary" => Ok(Table::of_rows(rest.to_vec(), &fields, points)),
        "binary_compressed" => columns(rest, &fields, points),
        _ => refused("DATA", "ascii, binary or binary_compressed", data),
    }
}

#[derive(Default)]
struct Header {
    names: Vec<String>,
    sizes: Vec<String>,
    kinds: Vec<String>,
    counts: Vec<String>,
    points: Option<usize>,
}

impl Header {
    fn take(&mut self, key: &str, words: Vec<String>) -> Result<(), SourceError> {
        match key {
            "FIELDS" | "COLUMNS" => self.names = words,
            "SIZE" => self.sizes = words,
            "TYPE" => self.kinds = words,
            "COUNT" => self.counts = words,
            "POINTS" => {
                let found = words.join(" ");
                let fault = || SourceError::field("POINTS", "a whole number", &found);
                self.points = Some(found.parse().map_err(|_| fault())?);
            }
            _ => {}
        }
        Ok(())
    }

    fn fields(&self) -> Result<Vec<Field>, SourceError> {
        let field = |(i, name): (usize, &String)| {
            let [letter, size, count] = [&self.kinds, &self.sizes, &self.counts]
                .map(|words| words.get(i).map_or("", String::as_str));
            let kind = Kind::new(letter == "F", letter == "I", size.parse().unwrap_or(0));
            let is_told = ["F", "I", "U"].contains(&letter) || (letter, size) == ("B", "1");
            let kind = kind.filter(|_| is_told);
            let kind = kind.ok_or_else(|| {
                let place = format!("TYPE and SIZE of {name}");
                let expected = "F 4, F 8, B 1, or I or U 1, 2, 4 or 8";
                SourceError::field(place, expected, format!("`{letter} {size}`"))
            })?;
            let count = count.parse::<usize>().unwrap_or(1).clamp(1, 4096);
            Ok((name.clone(), kind, count))
        };
        self.names.iter().enumerate().map(field).collect()
    }
}

/// Unpacks columns: all values of one field, then all values of the next. `packed`: the compressed size, the unpacked size, the compressed bytes.
fn columns(packed: &[u8], fields: &[Field], points: usize) -> Result<Table, SourceError> {
    let Some((sizes, rest)) = packed.split_first_chunk::<8>() else {
        return refused("data", "two sizes of 4 bytes", "its end");
    };
    let (sizes, _) = sizes.as_chunks();
    let [short, long] = [0, 1].map(|i| u32::from_le_bytes(sizes[i]) as usize);
    let Some(packed) = rest.get(..short) else {
        return refused("data", format!("{short} bytes"), rest.len());
    };
    if long > UNPACKED_MAX {
        return refused("size unpacked", format!("at most {UNPACKED_MAX}"), long);
    }
    let data = unpack_lzf(packed, long)
        .ok_or_else(|| SourceError::field("data", "LZF", "damaged bytes"))?;
    let mut table = Table::of_rows(data, fields, points);
    let mut start = 0;
    for (column, (_, kind, count)) in table.columns.iter_mut().zip(fields) {
        let bytes = kind.bytes() * count;
        (column.start, column.stride) = (start, bytes);
        start += bytes.saturating_mul(points);
    }
    Ok(table)
}

/// Unpacks Marc Lehmann's LZF: runs of literals, and references to earlier output. `None` if the output does not have `length` bytes.
fn unpack_lzf(packed: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(length);
    let mut rest = packed;
    while let Some((control, after)) = rest.split_first() {
        let high = usize::from(*control);
        if high < 32 {
            let (run, after) = after.split_at_checked(high + 1)?;
            out.extend_from_slice(run);
            rest = after;
            continue;
        }
        let (extra, after) = after.split_at_checked(usize::from(high >> 5 == 7))?;
        let (low, after) = after.split_first()?;
        let count = (high >> 5) + extra.first().map_or(0, |more| usize::from(*more)) + 2;
        let back = ((high & 31) << 8 | usize::from(*low)) + 1;
        let from = out.len().checked_sub(back)?;
        if out.len() + count > length {
            return None;
        }
        // A reference may overlap its own output.
        (from..from + count).for_each(|i| out.push(out[i]));
        rest = after;
    }
    (out.len() == length).then_some(out)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    #[test]
    fn references_repeat_what_was_written_and_damage_is_found() {
        // Two literals, then nine bytes that are copied from two bytes back.
        let packed = [1, b'a', b'b', 7 << 5, 0, 1];
        let found = unpack_lzf(&packed, 11);
        assert_eq!(found.as_deref(), Some(&b"abababababa"[..]));
        for (packed, length) in
            [(&packed[..], 12), (&packed[..5], 11), (&[31, 0][..], 32), (&[32, 5][..], 3)]
        {
            assert_eq!(unpack_lzf(packed, length), None);
        }
    }
}
