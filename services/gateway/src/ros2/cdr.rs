//! CDR as ROS 2 writes it (OMG DDS-XTypes 1.3, section 7.4.1, version 1), little-endian. A number starts at a multiple of its
//! size. A sequence begins with its length.

use mluc_ipc_types::Stage;
use serde_json::Value;
use std::collections::BTreeMap;

/// CDR header at the start of each message: the encoding.
const HEAD: [u8; 4] = [0, 1, 0, 0];
/// Name and type of a topic in the first line, then the type's definition.
const FILES: [&str; 5] = [
    include_str!("definitions/cloud.topic"),
    include_str!("definitions/detections.topic"),
    include_str!("definitions/markers.topic"),
    include_str!("definitions/diagnostics.topic"),
    include_str!("definitions/transform.topic"),
];

/// A topic and the type of its messages.
pub struct RosTopic {
    /// Its name.
    pub name: &'static str,
    /// Name of the type.
    pub schema: &'static str,
    /// Definition of the type and of the types in it, in the ROS message language (ROS 2 Humble and later).
    pub definition: &'static str,
    /// The fields of each type: type, name and default of a field. The key is the type's name, empty for the outermost type.
    types: BTreeMap<&'static str, Vec<[&'static str; 3]>>,
}

/// The topics of points, objects, boxes to draw, states and the sensor's place, in this order.
pub fn topics() -> [RosTopic; 5] {
    FILES.map(topic)
}

/// The topic of a frame's line as text. Recordings contain it so that `mluc replay` can compare.
pub fn line_topic() -> RosTopic {
    topic(include_str!("definitions/line.topic"))
}

/// The topic for a stage before the refiner: its output as bytes. Recordings may contain it so that `mluc replay` can begin behind
/// that stage. [`encode_bytes`] makes its messages: a header and elements as they lie in shared memory.
pub fn stage_topic(stage: Stage) -> RosTopic {
    let name = match stage {
        Stage::Backbone => "/mluc/stage/features",
        _ => "/mluc/stage/detections",
    };
    RosTopic { name, ..topic(include_str!("definitions/stage.topic")) }
}

/// Offset of the bytes in a message of [`encode_bytes`]: after the CDR header, a layout without dimensions and the number of bytes.
pub const BYTES_AT: usize = 16;

/// A `std_msgs/UInt8MultiArray` in CDR; its data are the two parts, one after the other.
pub fn encode_bytes(parts: [&[u8]; 2]) -> Vec<u8> {
    let count = parts.map(<[u8]>::len).iter().sum::<usize>() as u32;
    let numbers = [0, 0, count].map(u32::to_le_bytes);
    [&HEAD, numbers.as_flattened(), parts[0], parts[1]].concat()
}

fn topic(file: &'static str) -> RosTopic {
    let (head, definition) = file.split_once('\n').unwrap_or_default();
    let (name, schema) = head.split_once(' ').unwrap_or_default();
    let (mut of, mut types) = ("", BTreeMap::<_, Vec<_>>::new());
    for line in definition.lines().filter(|line| !line.contains('=')) {
        let mut words = line.split(' ');
        match [(); 3].map(|()| words.next().unwrap_or("")) {
            ["MSG:", name, _] => of = name,
            field => types.entry(of).or_default().push(field),
        }
    }
    RosTopic { name, schema, definition, types }
}

impl RosTopic {
    /// Encodes a message in CDR. A field that `message` lacks, or has with another type, gets its default, else 0 or an empty value.
    pub fn encode(&self, message: &Value) -> Vec<u8> {
        let mut out = HEAD.to_vec();
        self.put(&mut out, "", "", message);
        out
    }

    fn put(&self, out: &mut Vec<u8>, kind: &str, default: &str, value: &Value) {
        if let Some((kind, count)) = kind.strip_suffix(']').and_then(|kind| kind.split_once('[')) {
            let items = value.as_array().map_or(&[][..], Vec::as_slice);
            let count = count.parse().unwrap_or_else(|_| {
                put_number(out, (items.len() as u32).to_le_bytes());
                items.len()
            });
            return (0..count).for_each(|place| self.put(out, kind, "", &value[place]));
        }
        let float = value.as_f64().or(default.parse().ok()).unwrap_or(0.0);
        let whole = value.as_u64().unwrap_or(0) as u32;
        match kind {
            "bool" | "byte" | "uint8" => out.push(whole as u8),
            "int32" | "uint32" => put_number(out, whole.to_le_bytes()),
            "float32" => put_number(out, (float as f32).to_le_bytes()),
            "float64" => put_number(out, float.to_le_bytes()),
            "string" => {
                let text = value.as_str().unwrap_or("").as_bytes();
                put_number(out, (text.len() as u32 + 1).to_le_bytes());
                out.extend(text.iter().chain(&[0]));
            }
            _ => {
                for [kind, name, default] in self.types.get(kind).into_iter().flatten() {
                    self.put(out, kind, default, &value[name]);
                }
            }
        }
    }
}

/// Appends a number at the next multiple of its size; zeros fill the gap.
pub(super) fn put_number<const N: usize>(out: &mut Vec<u8>, number: [u8; N]) {
    let at = (out.len() - HEAD.len()).next_multiple_of(N);
    out.resize(at + HEAD.len(), 0);
    out.extend(number);
}
