//! A file's numbers as columns: the common form of all formats.

use crate::{SourceError, refused};

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Signed or unsigned integer of `bytes` bytes.
    Integer { bytes: usize, is_signed: bool },
    /// f32 or f64.
    Float { bytes: usize },
    /// An integer that was text; stored as f64.
    Whole,
}

impl Kind {
    pub(super) const F32: Kind = Kind::Float { bytes: 4 };
    pub(super) const F64: Kind = Kind::Float { bytes: 8 };

    pub(super) fn new(is_float: bool, is_signed: bool, bytes: usize) -> Option<Kind> {
        match (is_float, bytes) {
            (true, 4 | 8) => Some(Kind::Float { bytes }),
            (false, 1 | 2 | 4 | 8) => Some(Kind::Integer { bytes, is_signed }),
            _ => None,
        }
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Kind::Integer { bytes, .. } | Kind::Float { bytes } => bytes,
            Kind::Whole => 8,
        }
    }

    /// The number in `from`, which must have exactly as many bytes as the number.
    fn read(self, from: &[u8], is_big_endian: bool) -> f64 {
        let mut raw = [0; 8];
        let used = &mut raw[..self.bytes()];
        used.copy_from_slice(from);
        if is_big_endian {
            used.reverse();
        }
        let bits = u64::from_le_bytes(raw);
        match self {
            Kind::Float { bytes: 4 } => f64::from(f32::from_bits(bits as u32)),
            Kind::Float { .. } | Kind::Whole => f64::from_bits(bits),
            Kind::Integer { bytes, is_signed } if is_signed => {
                let unused = 64 - 8 * bytes as u32;
                ((bits << unused) as i64 >> unused) as f64
            }
            Kind::Integer { .. } => bits as f64,
        }
    }
}

/// Location of a named column: the value of row i begins at byte `start + i * stride`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) start: usize,
    pub(super) stride: usize,
}

/// Rows of named columns.
#[derive(Clone, Debug, Default)]
pub(super) struct Table {
    pub(super) data: Vec<u8>,
    pub(super) is_big_endian: bool,
    /// Number of rows that the file announces.
    pub(super) rows: usize,
    pub(super) columns: Vec<Column>,
}

/// A column's name, its kind, and its count of numbers; only the first number is used.
pub(super) type Field = (String, Kind, usize);

impl Table {
    /// A table of consecutive rows, each with consecutive fields. `rows`: the number of rows that the file announces.
    pub(super) fn of_rows(data: Vec<u8>, fields: &[Field], rows: usize) -> Table {
        let bytes = |(_, kind, count): &Field| kind.bytes() * count;
        let stride = fields.iter().map(bytes).sum();
        let mut start = 0;
        let columns = fields.iter().map(|(name, kind, count)| {
            let column = Column { name: name.clone(), kind: *kind, start, stride };
            start += kind.bytes() * count;
            column
        });
        Table { columns: columns.collect(), data, rows, is_big_endian: false }
    }

    /// A table of numbers that are text, one row with all `fields` per line. Empty lines and an incomplete last line are skipped.
    pub(super) fn of_text(
        text: &[u8],
        fields: &[Field],
        rows: usize,
    ) -> Result<Table, SourceError> {
        let text = String::from_utf8_lossy(text);
        let count: usize = fields.iter().map(|(_, _, count)| count).sum();
        let mut data = Vec::with_capacity(text.len());
        let lines = text.split_inclusive('\n').filter(|line| !line.trim().is_empty());
        for (number, line) in lines.take(rows).enumerate() {
            let words = line.split_whitespace();
            let values: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
            if values.len() < count && !line.ends_with('\n') {
                break;
            }
            if values.len() != count {
                let found = format!("`{}`", line.trim().chars().take(80).collect::<String>());
                return refused(format!("row {number}"), format!("{count} numbers"), found);
            }
            data.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        }
        let as_f64 = |(name, kind, count): &Field| {
            let is_float = matches!(kind, Kind::Float { .. });
            let kind = if is_float { Kind::F64 } else { Kind::Whole };
            (name.clone(), kind, *count)
        };
        let fields: Vec<Field> = fields.iter().map(as_f64).collect();
        Ok(Table::of_rows(data, &fields, rows))
    }

    /// The column with the first of these names that the table has; letter case is ignored.
    pub(super) fn column(&self, names: &[&str]) -> Option<&Column> {
        let is_named = |column: &&Column, name: &str| column.name.eq_ignore_ascii_case(name);
        let find = |name: &&str| self.columns.iter().find(|column| is_named(column, name));
        names.iter().find_map(find)
    }

    /// The value in a row; `None` beyond the end of the data.
    pub(super) fn value(&self, column: &Column, row: usize) -> Option<f64> {
        let start = column.start.checked_add(row.checked_mul(column.stride)?)?;
        let end = start.checked_add(column.kind.bytes())?;
        let from = self.data.get(start..end)?;
        Some(column.kind.read(from, self.is_big_endian))
    }
}
