//! Field by field: the layouts of Rust's compiler, and the layouts that follow from the descriptions in C and Python.

use bytemuck::Zeroable;
use mluc_ipc_types::{Detection, FrameHeader, Health, Object, Point, RunDescription, Status};
use std::mem::offset_of;

/// Name, offset and bytes of each field.
pub(crate) type Fields = Vec<(String, usize, usize)>;

pub(crate) struct Layout {
    pub(crate) name: &'static str,
    pub(crate) size: usize,
    pub(crate) align: usize,
    pub(crate) fields: Fields,
}

macro_rules! layout {
    ($struct:ident: $($($field:ident).+)*) => {{
        let value = $struct::zeroed();
        Layout {
            name: stringify!($struct),
            size: size_of::<$struct>(),
            align: align_of::<$struct>(),
            fields: vec![$((
                stringify!($($field).+).replace('.', "_"),
                offset_of!($struct, $($field).+),
                size_of_val(&value.$($field).+),
            )),*],
        }
    }};
}

/// All structures that cross the refiner's interface.
pub(crate) fn layouts() -> Vec<Layout> {
    vec![
        layout!(FrameHeader:
            wire_version flags run_id sequence sensor_stamp_ns sensor_id attempt points_in
            points_dropped points_out_of_range feature_rows feature_channels limit_dropped
            model_fingerprint ego.position_m ego.yaw_rad ego.is_known ego.reserved stages name),
        layout!(RunDescription:
            wire_version classes_count run_id started_ns model_fingerprint other_model_fingerprint
            base_from_sensor sensor_height_m objectness_min gate gate_threshold model_name sensor_name class_names
            known_score unknown_score),
        layout!(Status:
            wire_version state run_id judged_ns sequence age_ns frames_in frames_out frames_dropped
            frames_late stages_out stages_late blind_sectors not_finite_share is_ground_lost reason),
        layout!(Point:
            x_m y_m z_m intensity),
        layout!(Detection:
            center_m size_m yaw_rad class_id kind cell objectness score probabilities embedding
            eds eds_normalised eds_perpendicular delta softmax_max logit_max energy
            unknown_probability gate threshold),
        layout!(Object:
            kind disposition suppressed_by class_id score center_m size_m yaw_rad eds
            eds_normalised unknown_probability gate threshold points_first points_count flags
            track_id overlap footprint_count footprint_m),
        layout!(Health:
            wire_version stage state pid run_id frames_in frames_out frames_dropped
            messages_refused run_p50_us run_p99_us run_max_us bytes_written bytes_read
            mappings_verified candidates reason),
    ]
}

/// Adds the next field at the offset where C places it.
fn push(fields: &mut Fields, name: &str, element_bytes: usize, count: usize) {
    let end = fields.last().map_or(0, |(_, offset, bytes)| offset + bytes);
    let offset = end.next_multiple_of(element_bytes);
    fields.push((name.to_string(), offset, element_bytes * count));
}

/// `typedef struct mluc_NAME { type field[2][3], other; ... }` of a C header.
pub(crate) fn c_struct(header: &str, name: &str) -> Fields {
    let name = name.trim_start_matches("Frame").trim_end_matches("Description");
    let start = format!("typedef struct mluc_{} {{", name.to_lowercase());
    let (_, body) = header.split_once(&start).expect("the struct's name");
    let mut fields = Fields::new();
    let lines = body.lines().skip(1);
    for line in lines.take_while(|line| !line.starts_with('}')) {
        let (line, _) = line.split_once(';').expect("a field a line");
        let (kind, names) = line.trim().split_once(' ').expect("type and name");
        let (bytes, times) = match kind {
            "uint32_t" | "float" => (4, 1),
            "uint64_t" | "double" => (8, 1),
            "char" => (1, 1),
            "mluc_stamps" => (8, 3),
            other => panic!("{other}"),
        };
        for name in names.split(", ") {
            let mut parts = name.split('[');
            let field = parts.next().unwrap();
            let dimensions = parts.map(|part| part.trim_end_matches(']').parse::<usize>().unwrap());
            let count = times * dimensions.product::<usize>();
            push(&mut fields, field, bytes, count);
        }
    }
    fields
}

/// `NAME = struct("NAME", "field:3f ...")` of the Python module.
pub(crate) fn python_struct(module: &str, name: &str) -> Fields {
    let start = format!("struct(\"{name}\", ");
    let (_, body) = module.split_once(&start).expect("the struct's name");
    let (text, _) = body.split_once(')').expect("its end");
    let mut fields = Fields::new();
    for word in text.trim_matches('"').split_whitespace() {
        let (field, kind) = word.split_once(':').unwrap();
        let (count, letter) = kind.split_at(kind.len() - 1);
        let bytes = match letter {
            "u" | "f" => 4,
            "U" | "d" => 8,
            "b" => 1,
            other => panic!("{other}"),
        };
        push(&mut fields, field, bytes, count.parse().unwrap_or(1));
    }
    fields
}
