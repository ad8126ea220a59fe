//! Messages with one scan each: `sensor_msgs/PointCloud2` as ROS 2 (CDR) and ROS 1 write it, and `foxglove.PointCloud` in protobuf. The pose of a
//! `foxglove.PointCloud` in another frame is ignored. Only the first number of a field with several numbers is used.

use super::Layout;
use super::table::{Column, Kind, Table};
use crate::{Scan, SourceError};
use prost::Message;

/// Encoding of a message with points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cloud {
    Ros2,
    Ros1,
    Foxglove,
}

/// The supported messages, for errors.
pub(crate) const CLOUDS: &str =
    "sensor_msgs/PointCloud2 (cdr, ros1) or foxglove.PointCloud (protobuf)";

/// The parts of a PointCloud2 that are needed.
#[derive(Default)]
struct PointCloud2<'a> {
    stamp_ns: u64,
    frame: String,
    height: usize,
    width: usize,
    /// Name, offset in a point (bytes), datatype.
    fields: Vec<(String, usize, usize)>,
    is_big_endian: bool,
    point_step: usize,
    row_step: usize,
    data: &'a [u8],
}

impl Cloud {
    /// Finds the kind by a recording's schema name and message encoding.
    pub(crate) fn of(schema: &str, encoding: &str) -> Option<Cloud> {
        match (schema, encoding) {
            ("sensor_msgs/msg/PointCloud2", "cdr") => Some(Cloud::Ros2),
            ("sensor_msgs/PointCloud2", "ros1") => Some(Cloud::Ros1),
            ("foxglove.PointCloud", "protobuf") => Some(Cloud::Foxglove),
            _ => None,
        }
    }

    /// Appends a message's points to the scan, as [`Layout::write`] does. Returns the sensor's time (ns since 1970; 0: unknown), whether the message
    /// has fewer or more points than it announces, and the coordinate frame of the points.
    pub(crate) fn convert(
        self,
        layout: &Layout,
        message: &[u8],
        scan: &mut Scan,
    ) -> Result<(u64, bool, String), SourceError> {
        let foxglove: Foxglove;
        let mut cloud = if self == Cloud::Foxglove {
            let decoded = Foxglove::decode(message);
            foxglove =
                decoded.map_err(|e| SourceError::field("message", "foxglove.PointCloud", e))?;
            foxglove.cloud()
        } else {
            let is_zstd = message.starts_with(&[0x28, 0xB5, 0x2F, 0xFD]);
            let found = match is_zstd {
                true => "zstd: record or convert the bag without compression of messages",
                false => "its end",
            };
            let cloud = Reader::of(self, message).and_then(Reader::cloud).filter(|_| !is_zstd);
            cloud.ok_or_else(|| SourceError::field("message", "PointCloud2", found))?
        };
        let (stamp_ns, frame) = (cloud.stamp_ns, std::mem::take(&mut cloud.frame));
        let rest = cloud.data.get(cloud.step().saturating_mul(cloud.height)..);
        let is_long = rest.is_some_and(|rest| {
            rest.len() >= cloud.point_step && rest.iter().any(|byte| *byte != 0)
        });
        let is_short = layout.write(&cloud.table()?, scan)?;
        Ok((stamp_ns, is_short || is_long, frame))
    }
}

impl PointCloud2<'_> {
    /// Bytes of a row. Some drivers leave row_step at 0.
    fn step(&self) -> usize {
        let row = self.width.saturating_mul(self.point_step);
        self.row_step.max(row).max(1)
    }

    fn table(self) -> Result<Table, SourceError> {
        let row = self.width.saturating_mul(self.point_step);
        let mut table = Table {
            is_big_endian: self.is_big_endian,
            rows: self.width.saturating_mul(self.height),
            ..Table::default()
        };
        // Bytes after the points of a row are skipped.
        for all in self.data.chunks(self.step()).take(self.height) {
            table.data.extend_from_slice(&all[..row.min(all.len())]);
        }
        let stride = self.point_step;
        for (name, start, datatype) in self.fields {
            let fault = |what, expected: &str, found| {
                SourceError::field(format!("{what} of field {name}"), expected, found)
            };
            // INT8, UINT8, INT16, UINT16, INT32, UINT32, FLOAT32, FLOAT64, INT64, UINT64, BOOLEAN are 1 to 11.
            let bytes = [0, 1, 1, 2, 2, 4, 4, 4, 8, 8, 8, 1].get(datatype).unwrap_or(&0);
            let kind = Kind::new([7, 8].contains(&datatype), datatype % 2 == 1, *bytes);
            let kind = kind.ok_or_else(|| fault("datatype", "1 to 11", datatype))?;
            if start.saturating_add(*bytes) > stride {
                let expected = format!("{bytes} bytes within {stride}");
                return Err(fault("offset", &expected, start));
            }
            table.columns.push(Column { name, kind, start, stride });
        }
        Ok(table)
    }
}

/// Reads a ROS message. Its methods return `None` if the message ends too early.
pub(crate) struct Reader<'a> {
    all: &'a [u8],
    at: usize,
    /// Alignment of a 4-byte number, bytes; an 8-byte number has twice this alignment.
    align: usize,
    is_big_endian: bool,
}

impl<'a> Reader<'a> {
    pub(crate) fn of(kind: Cloud, message: &'a [u8]) -> Option<Reader<'a>> {
        // CDR begins with four bytes; the second one gives the byte order. ROS 1 begins with a sequence number.
        let (head, all) = message.split_at_checked(4)?;
        let is_cdr = kind == Cloud::Ros2;
        let is_big_endian = is_cdr && head[1] & 1 == 0;
        let align = if is_cdr { 4 } else { 1 };
        Some(Reader { all, at: 0, align, is_big_endian })
    }

    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let bytes = self.all.get(self.at..)?.get(..count)?;
        self.at += count;
        Some(bytes)
    }

    /// The next number's bytes in little-endian order.
    fn raw<const BYTES: usize>(&mut self) -> Option<[u8; BYTES]> {
        self.at = self.at.next_multiple_of(BYTES / 4 * self.align);
        let mut raw: [u8; BYTES] = self.bytes(BYTES)?.try_into().ok()?;
        if self.is_big_endian {
            raw.reverse();
        }
        Some(raw)
    }

    pub(crate) fn number(&mut self) -> Option<usize> {
        self.raw().map(|raw| u32::from_le_bytes(raw) as usize)
    }

    pub(crate) fn float(&mut self) -> Option<f64> {
        self.raw().map(f64::from_le_bytes)
    }

    /// Time (ns since 1970) and frame of reference.
    pub(crate) fn header(&mut self) -> Option<(u64, String)> {
        let (seconds, ns) = (self.number()? as u64, self.number()? as u64);
        Some((seconds * 1_000_000_000 + ns, self.text()?))
    }

    pub(crate) fn text(&mut self) -> Option<String> {
        let count = self.number()?;
        let text = String::from_utf8_lossy(self.bytes(count)?);
        Some(text.trim_end_matches('\0').to_string())
    }

    fn cloud(mut self) -> Option<PointCloud2<'a>> {
        let (stamp_ns, frame) = self.header()?;
        let mut cloud = PointCloud2 { stamp_ns, frame, ..PointCloud2::default() };
        (cloud.height, cloud.width) = (self.number()?, self.number()?);
        for _ in 0..self.number()? {
            let field = (self.text()?, self.number()?, self.bytes(1)?[0].into());
            cloud.fields.push(field);
            // The count of numbers in the field is not used.
            self.number()?;
        }
        cloud.is_big_endian = self.bytes(1)?[0] != 0;
        (cloud.point_step, cloud.row_step) = (self.number()?, self.number()?);
        let bytes = self.number()?;
        let rest = &self.all[self.at..];
        cloud.data = &rest[..bytes.min(rest.len())];
        Some(cloud)
    }
}

/// foxglove.PointCloud.
#[derive(Message)]
struct Foxglove {
    #[prost(message, tag = "1")]
    timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    frame_id: String,
    #[prost(fixed32, tag = "4")]
    point_stride: u32,
    #[prost(message, repeated, tag = "5")]
    fields: Vec<PackedElementField>,
    #[prost(bytes = "vec", tag = "6")]
    data: Vec<u8>,
}

#[derive(Clone, Copy, Message)]
struct Timestamp {
    #[prost(int64, tag = "1")]
    seconds: i64,
    #[prost(int32, tag = "2")]
    nanos: i32,
}

#[derive(Message)]
struct PackedElementField {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(fixed32, tag = "2")]
    offset: u32,
    #[prost(uint32, tag = "3")]
    kind: u32,
}

impl Foxglove {
    fn cloud(&self) -> PointCloud2<'_> {
        let stamp = self.timestamp.unwrap_or_default();
        let ns = i128::from(stamp.seconds) * 1_000_000_000 + i128::from(stamp.nanos);
        let mut fields = vec![];
        for field in &self.fields {
            // For each integer size, Foxglove numbers the unsigned type before the signed type.
            let datatype = match field.kind {
                kind @ 1..=6 => kind - 1 + 2 * (kind % 2),
                kind => kind,
            };
            fields.push((field.name.clone(), field.offset as usize, datatype as usize));
        }
        PointCloud2 {
            stamp_ns: u64::try_from(ns).unwrap_or(0),
            frame: self.frame_id.clone(),
            height: 1,
            width: self.data.len().div_ceil(self.point_stride.max(1) as usize),
            fields,
            point_step: self.point_stride as usize,
            data: &self.data,
            ..PointCloud2::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_of_every_type_are_read() {
        let minus_two = (-2_i64).to_le_bytes();
        for (datatype, data, expected) in [
            (1, &minus_two[..1], -2.0),
            (2, &minus_two[..1], 254.0),
            (3, &minus_two[..2], -2.0),
            (5, &minus_two[..4], -2.0),
            (9, &minus_two, -2.0),
            (10, &2_u64.to_le_bytes(), 2.0),
            (11, &[1], 1.0),
        ] {
            let cloud = PointCloud2 {
                height: 1,
                width: 1,
                fields: vec![("x".to_string(), 0, datatype)],
                point_step: data.len(),
                data,
                ..PointCloud2::default()
            };
            let table = cloud.table().unwrap();
            assert_eq!(table.value(&table.columns[0], 0), Some(expected), "{datatype}");
        }
    }
}
