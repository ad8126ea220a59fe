//! Field by field: what Rust's compiler laid out, and what C's and Python's descriptions come to.

use std::mem::offset_of;

use bytemuck::Zeroable;
use mluc_ipc_types::{Detection, FrameHeader, Health, Object, Point};

/// Fields with offset and bytes.
pub(crate) struct Layout {
    pub(crate) name: &'static str,
    pub(crate) size: usize,
    pub(crate) align: usize,
    pub(crate) fields: Vec<(String, usize, usize)>,
}

/// Fields of a description in another language.
pub(crate) struct Described {
    pub(crate) name: String,
    pub(crate) fields: Vec<(String, usize, usize)>,
}

macro_rules! layout {
    ($struct:ident { $($field:ident),* $(,)? }) => {{
        let value = $struct::zeroed();
        Layout {
            name: stringify!($struct),
            size: size_of::<$struct>(),
            align: align_of::<$struct>(),
            fields: vec![$((
                stringify!($field).to_string(),
                offset_of!($struct, $field),
                size_of_val(&value.$field),
            )),*],
        }
    }};
}

/// Everything that crosses the refiner's border.
pub(crate) fn layouts() -> Vec<Layout> {
    vec![
        layout!(FrameHeader {
            wire_version,
            flags,
            sequence,
            sensor_stamp_ns,
            sensor_id,
            attempt,
            points_in,
            points_dropped,
            points_out_of_range,
            feature_rows,
            feature_channels,
            limit_dropped,
            model_fingerprint,
            ego,
            stages,
            name,
        }),
        layout!(Point {
            x_m,
            y_m,
            z_m,
            intensity
        }),
        layout!(Detection {
            center_m,
            size_m,
            yaw_rad,
            class_id,
            kind,
            cell,
            objectness,
            score,
            probabilities,
            embedding,
            eds,
            eds_normalised,
            eds_perpendicular,
            delta,
            softmax_max,
            logit_max,
            energy,
            threshold,
        }),
        layout!(Object {
            kind,
            fate,
            by,
            class_id,
            score,
            center_m,
            size_m,
            yaw_rad,
            eds,
            eds_normalised,
            threshold,
            points_first,
            points_count,
            flags,
            track_id,
            overlap,
            footprint_count,
            footprint_m,
        }),
        layout!(Health {
            wire_version,
            stage,
            state,
            pid,
            frames_in,
            frames_out,
            frames_dropped,
            messages_refused,
            run_p50_us,
            run_p99_us,
            run_max_us,
            bytes_written,
            bytes_read,
            mappings_verified,
            candidates,
            reason,
        }),
    ]
}

/// The parts of `ego` are fields of their own where structs are flat; here they are one again.
fn flat(fields: &[(String, usize, usize)]) -> Vec<(String, usize, usize)> {
    let mut merged: Vec<(String, usize, usize)> = Vec::new();
    for (name, offset, bytes) in fields {
        match merged.last_mut() {
            Some(last) if last.0 == "ego" && name.starts_with("ego_") => last.2 += bytes,
            _ if name.starts_with("ego_") => merged.push(("ego".to_string(), *offset, *bytes)),
            _ => merged.push((name.clone(), *offset, *bytes)),
        }
    }
    merged
}

impl Layout {
    pub(crate) fn flat(&self) -> Vec<(String, usize, usize)> {
        flat(&self.fields)
    }
}

impl Described {
    pub(crate) fn flat(&self) -> Vec<(String, usize, usize)> {
        flat(&self.fields)
    }

    /// The next field, where C puts it.
    fn push(&mut self, name: &str, element_bytes: usize, align: usize, count: usize) {
        let end = self
            .fields
            .last()
            .map_or(0, |(_, offset, bytes)| offset + bytes);
        let offset = end.next_multiple_of(align);
        self.fields
            .push((name.to_string(), offset, element_bytes * count));
    }
}

/// `mluc_frame_header`'s name in the code.
fn camel(name: &str) -> String {
    match name {
        "header" => "FrameHeader".to_string(),
        name => {
            let (first, rest) = name.split_at(1);
            first.to_uppercase() + rest
        }
    }
}

/// `typedef struct mluc_NAME { type field[2][3], other; ... }` of a C header.
pub(crate) fn c_structs(header: &str) -> Vec<Described> {
    let mut structs = Vec::new();
    for part in header.split("typedef struct mluc_").skip(1) {
        let Some((name, body)) = part.split_once(" {") else {
            continue;
        };
        let body = body.split('}').next().unwrap();
        let mut described = Described {
            name: camel(name),
            fields: Vec::new(),
        };
        for line in body.lines() {
            let Some((line, _)) = line.split_once(';') else {
                continue;
            };
            let Some((kind, names)) = line.trim().split_once(' ') else {
                continue;
            };
            let (bytes, align) = match kind {
                "uint32_t" | "float" => (4, 4),
                "uint64_t" | "double" => (8, 8),
                "char" => (1, 1),
                "mluc_stamps" => (24, 8),
                // Pointers: not in shared memory.
                _ => continue,
            };
            for name in names.split(',') {
                let mut parts = name.trim().split('[');
                let field = parts.next().unwrap();
                let dimensions =
                    parts.map(|part| part.trim_end_matches(']').parse::<usize>().unwrap());
                described.push(field, bytes, align, dimensions.product());
            }
        }
        structs.push(described);
    }
    structs
}

/// `NAME = struct("NAME", "field:3f ...")` of the Python module.
pub(crate) fn python_structs(module: &str) -> Vec<Described> {
    let mut structs = Vec::new();
    for part in module.split(" = struct(\"").skip(1) {
        let (name, rest) = part.split_once("\", ").unwrap();
        let text = rest.split(')').next().unwrap();
        let mut described = Described {
            name: name.to_string(),
            fields: Vec::new(),
        };
        for word in text.trim_matches('"').split_whitespace() {
            let (field, kind) = word.split_once(':').unwrap();
            let (count, letter) = kind.split_at(kind.len() - 1);
            let bytes = match letter {
                "u" | "f" => 4,
                "U" | "d" => 8,
                "b" => 1,
                other => panic!("{other}"),
            };
            let count = if count.is_empty() {
                1
            } else {
                count.parse().unwrap()
            };
            described.push(field, bytes, bytes, count);
        }
        structs.push(described);
    }
    structs
}
