//! NumPy's array format, versions 1 to 3 (numpy.lib.format): a magic string, a header that is a Python dictionary, then the numbers.

use super::Layout;
use super::table::{Column, Field, Kind, Table};
use crate::{SourceError, refused};

const MAGIC: &[u8] = b"\x93NUMPY";
/// Maximum count of numbers in one field; a guess far above any real field.
const FIELD_NUMBERS_MAX: usize = 1 << 20;

pub(super) fn table(file: &[u8], layout: &Layout) -> Result<Table, SourceError> {
    let fault = |found: &str| SourceError::field("header", "that of a NumPy array", found);
    let rest = file.strip_prefix(MAGIC).ok_or_else(|| fault("another file"))?;
    let (header, data) = header(rest).ok_or_else(|| fault("its end"))?;
    let (descr, shape) = (value(header, "descr"), value(header, "shape"));
    let (Some(descr), Some(shape)) = (descr, shape) else {
        return Err(fault("no descr or no shape"));
    };
    let is_fortran = value(header, "fortran_order").is_some_and(|word| word.starts_with("True"));
    let shape: Vec<usize> = numbers(shape);
    let mut table = if descr.starts_with('[') {
        let [rows] = shape[..] else {
            let found = format!("{shape:?}");
            return refused("shape", "one dimension of named fields", found);
        };
        Table::of_rows(data.to_vec(), &named_fields(descr)?, rows)
    } else {
        let [rows, count @ 3..=64] = shape[..] else {
            let found = format!("{shape:?}");
            return refused("shape", "N rows and 3 to 64 columns", found);
        };
        let named = layout.columns.len();
        if named > count {
            return refused("columns", format!("{named}, as named"), count);
        }
        let kind = kind(descr.trim_matches(['\'', '"']))?;
        let names = layout.names(count).into_iter();
        let fields: Vec<Field> = names.map(|name| (name, kind, 1)).collect();
        let mut table = Table::of_rows(data.to_vec(), &fields, rows);
        let bytes = kind.bytes();
        let place = |(i, column): (usize, &mut Column)| {
            let (by_column, by_row) = ((i.saturating_mul(rows), 1), (i, count));
            let (start, stride) = if is_fortran { by_column } else { by_row };
            (column.start, column.stride) = (start.saturating_mul(bytes), stride * bytes);
        };
        table.columns.iter_mut().enumerate().for_each(place);
        table
    };
    table.is_big_endian = descr.contains('>');
    if table.is_big_endian && descr.contains('<') {
        return refused("descr", "one order of bytes", descr);
    }
    Ok(table)
}

/// The dictionary and the bytes after it.
fn header(rest: &[u8]) -> Option<(&str, &[u8])> {
    let (version, rest) = rest.split_at_checked(2)?;
    let wide = if version[0] == 1 { 2 } else { 4 };
    let (length, rest) = rest.split_at_checked(wide)?;
    let append = |all, byte: &u8| all << 8 | usize::from(*byte);
    let length = length.iter().rev().fold(0, append);
    let (header, data) = rest.split_at_checked(length)?;
    Some((std::str::from_utf8(header).ok()?, data))
}

/// The value of a key in the dictionary.
fn value<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let (_, after) = header.split_once(&format!("'{key}':"))?;
    let after = after.trim_start();
    let end = match after.chars().next()? {
        '[' => after.find(']')? + 1,
        '(' => after.find(')')? + 1,
        _ => after.find([',', '}'])?,
    };
    Some(&after[..end])
}

fn numbers(text: &str) -> Vec<usize> {
    text.split(|c: char| !c.is_ascii_digit()).filter_map(|word| word.parse().ok()).collect()
}

/// Parses a type such as `<f4`.
fn kind(text: &str) -> Result<Kind, SourceError> {
    let text = text.trim_start_matches(['<', '>', '|', '=']);
    let (letter, bytes) = text.split_at_checked(1).unwrap_or(("", ""));
    let bytes = bytes.parse().unwrap_or(0);
    let kind = matches!(letter, "f" | "i" | "u" | "b")
        .then(|| Kind::new(letter == "f", letter == "i", bytes));
    kind.flatten().ok_or_else(|| SourceError::field("descr", "f4, f8, or an integer", text))
}

/// Parses fields such as `[('x', '<f4'), ('normal', '<f4', (3,)), ('', '|V4')]`; the last field here is padding.
fn named_fields(descr: &str) -> Result<Vec<Field>, SourceError> {
    let parts: Vec<&str> = descr.split('\'').skip(1).collect();
    let (fields, rest) = parts.as_chunks();
    if !rest.is_empty() {
        return refused("descr", "a name and a kind for each field", descr);
    }
    let field = |[name, _, text, size]: &[&str; 4]| {
        let (kind, count) = match text.strip_prefix("|V").map(str::parse::<usize>) {
            Some(Ok(bytes)) => (kind("u1")?, bytes),
            _ => (kind(text)?, 1),
        };
        let count = numbers(size).into_iter().fold(count, usize::saturating_mul);
        Ok((name.to_string(), kind, count.min(FIELD_NUMBERS_MAX)))
    };
    fields.iter().map(field).collect()
}
