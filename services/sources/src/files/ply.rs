//! PLY 1.0: a header of lines, then the elements one after another; the points are the element `vertex`.

use super::table::{Field, Kind, Table};
use crate::{SourceError, refused};

pub(super) fn table(file: &[u8]) -> Result<Table, SourceError> {
    let end = b"end_header";
    let at = file.windows(end.len()).position(|window| window == end);
    let Some(at) = at.filter(|_| file.starts_with(b"ply")) else {
        return refused("header", "`ply` to `end_header`", "another file");
    };
    let header = String::from_utf8_lossy(&file[..at]).into_owned();
    let body = &file[at + end.len()..];
    let line = body.iter().position(|byte| *byte == b'\n');
    let body = &body[line.map_or(0, |place| place + 1)..];
    let (mut format, mut rows, mut fields) = (String::new(), None, Vec::<Field>::new());
    for line in header.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["format", name, ..] => format = name.to_string(),
            ["element", "vertex", count] => rows = count.parse::<usize>().ok(),
            ["element", other, _] if rows.is_none() => {
                return refused("elements", "vertex first", other);
            }
            // Elements after the vertices are not used.
            ["element", ..] => break,
            ["property", "list", ..] => {
                return refused("properties of vertex", "no list", line);
            }
            ["property", kind, name] => fields.push((name.to_string(), self::kind(kind)?, 1)),
            _ => {}
        }
    }
    let rows = rows.ok_or_else(|| SourceError::field("elements", "a count of vertex", "none"))?;
    match format.as_str() {
        "ascii" => Table::of_text(body, &fields, rows),
        "binary_little_endian" | "binary_big_endian" => {
            let mut table = Table::of_rows(body.to_vec(), &fields, rows);
            table.is_big_endian = format == "binary_big_endian";
            Ok(table)
        }
        _ => {
            let expected = "ascii, binary_little_endian or binary_big_endian";
            refused("format", expected, format)
        }
    }
}

fn kind(name: &str) -> Result<Kind, SourceError> {
    let integer = |bytes, is_signed| Ok(Kind::Integer { bytes, is_signed });
    match name {
        "float" | "float32" => Ok(Kind::F32),
        "double" | "float64" => Ok(Kind::F64),
        "char" | "int8" => integer(1, true),
        "uchar" | "uint8" => integer(1, false),
        "short" | "int16" => integer(2, true),
        "ushort" | "uint16" => integer(2, false),
        "int" | "int32" => integer(4, true),
        "uint" | "uint32" => integer(4, false),
        _ => refused("property", "a number", name),
    }
}
