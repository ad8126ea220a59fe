//! The contents of a frame's messages. They contain only published objects.

use super::cdr::{RosTopic, put_number};
use crate::{lines::object_line, picture::label_color};
use mluc_ipc_types::{Object, Point};
use serde_json::{Value, json};

/// Frame of the robot, as REP 105 names it.
const BASE_FRAME: &str = "base_link";
/// Height of a marker's letters, m.
const TEXT_M: f32 = 0.6;
const POINT_BYTES: usize = 20;

/// std_msgs/Header.
pub fn header(stamp_ns: u64, frame_id: &str) -> Value {
    let (sec, nanosec) = (stamp_ns / 1_000_000_000, stamp_ns % 1_000_000_000);
    json!({"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame_id})
}

/// sensor_msgs/PointCloud2 in CDR; `topic` is the first of [`super::topics`]. A point's field `object` is its object's index among the published
/// objects; -1: no object, or `object_points` does not name the point. `object_points` is the frame's message, or empty if that is gone.
pub fn point_cloud(
    topic: &RosTopic,
    header: &Value,
    points: &[Point],
    objects: &[Object],
    object_points: &[u32],
) -> Vec<u8> {
    let mut places = vec![-1i32; points.len()];
    for (place, object) in (0..).zip(published(objects)) {
        let own = object_points.iter().skip(object.points_first as usize);
        for index in own.take(object.points_count as usize) {
            if let Some(own) = places.get_mut(*index as usize) {
                *own = place;
            }
        }
    }
    // 7: FLOAT32, 5: INT32.
    let field = |(place, name): (u32, &str)| {
        let datatype = if name == "object" { 5 } else { 7 };
        json!({"name": name, "offset": place * 4, "datatype": datatype, "count": 1})
    };
    let names = ["x", "y", "z", "intensity", "object"];
    let bytes = points.len() * POINT_BYTES;
    let mut out = topic.encode(&json!({
        "header": header, "height": 1, "width": points.len(), "point_step": POINT_BYTES, "row_step": bytes,
        "fields": (0..).zip(names).map(field).collect::<Vec<_>>(),
    }));
    // Removes the length of the empty data (4 bytes) and `is_dense` (1 byte); both follow below.
    out.truncate(out.len() - 5);
    out.reserve(bytes + 8);
    put_number(&mut out, (bytes as u32).to_le_bytes());
    for (point, place) in points.iter().zip(places) {
        let numbers = [point.x_m, point.y_m, point.z_m, point.intensity];
        out.extend_from_slice(numbers.map(f32::to_le_bytes).as_flattened());
        out.extend_from_slice(&place.to_le_bytes());
    }
    out.push(points.iter().all(Point::is_finite).into());
    out
}

/// vision_msgs/Detection3DArray, in the order of the line's `objects`; an id is a track's number.
pub fn detections(header: &Value, objects: &[Object], classes: &[String]) -> Value {
    let detection = |o: &Object| {
        let pose = pose(o.center_m, o.yaw_rad);
        let hypothesis = json!({"class_id": object_line(o, classes).label, "score": o.score});
        let track = (o.track_id != Object::NONE).then(|| o.track_id.to_string());
        json!({
            "header": header,
            "results": [{"hypothesis": hypothesis, "pose": {"pose": pose}}],
            "bbox": {"center": pose, "size": vector(o.size_m)},
            "id": track,
        })
    };
    let detections: Vec<_> = published(objects).map(detection).collect();
    json!({"header": header, "detections": detections})
}

/// visualization_msgs/MarkerArray: removes the previous markers, then adds boxes and labels in the colours of our pictures.
pub fn markers(header: &Value, objects: &[Object], classes: &[String]) -> Value {
    let [cube, letters, delete_all] = [1u32, 9, 3];
    let mut markers = vec![json!({"header": header, "action": delete_all})];
    for (id, object) in (0..).zip(published(objects)) {
        let (label, [x, y, z]) = (object_line(object, classes).label, object.center_m);
        let mut add = |kind, z_m, size_m, alpha, text| {
            let [r, g, b] = label_color(label).map(|value| f32::from(value) / 255.0);
            markers.push(json!({
                "header": header, "ns": label, "id": 2 * id + u32::from(kind == letters), "type": kind,
                "pose": pose([x, y, z_m], object.yaw_rad), "scale": vector(size_m),
                "color": {"r": r, "g": g, "b": b, "a": alpha}, "text": text,
            }));
        };
        add(cube, z, object.size_m, 0.4, String::new());
        let top_m = z + object.size_m[2] / 2.0 + TEXT_M;
        let words = format!("{label} {:.2}", object.score);
        add(letters, top_m, [TEXT_M; 3], 1.0, words);
    }
    json!({"markers": markers})
}

/// diagnostic_msgs/DiagnosticArray: one status per name and JSON object. `state` sets its level; `state` and `reason` are its message.
pub fn diagnostics(header: &Value, instance: &str, parts: &[(&str, Value)]) -> Value {
    let text = |value: &Value| value.as_str().map_or(value.to_string(), str::to_string);
    let status = |(name, part): &(&str, Value)| {
        let [state, reason] = ["state", "reason"].map(|key| part[key].as_str().unwrap_or(""));
        let level = match state {
            "running" | "waiting_input" => 0,
            "failed" | "stopped" | "blind" | "late" | "?" => 2,
            "silent" => 3,
            _ => 1,
        };
        let values = part.as_object().into_iter().flatten();
        let values = values.map(|(key, value)| json!({"key": key, "value": text(value)}));
        json!({
            "level": level, "name": format!("mluc {instance}: {name}"), "message": format!("{state} {reason}"), "hardware_id": instance,
            "values": values.collect::<Vec<_>>(),
        })
    };
    json!({"header": header, "status": parts.iter().map(status).collect::<Vec<_>>()})
}

/// tf2_msgs/TFMessage: from the robot's frame to the frame of `header`. `base_from_sensor` is as in the run's description.
pub fn transform(header: &Value, base_from_sensor: [f64; 6]) -> Value {
    let [x, y, z, roll, pitch, yaw] = base_from_sensor;
    let place =
        json!({"translation": {"x": x, "y": y, "z": z}, "rotation": quaternion(roll, pitch, yaw)});
    let base = json!({"stamp": header["stamp"], "frame_id": BASE_FRAME});
    json!({"transforms": [{"header": base, "child_frame_id": header["frame_id"], "transform": place}]})
}

fn published(objects: &[Object]) -> impl Iterator<Item = &Object> {
    objects.iter().filter(|object| object.is_published())
}

fn vector([x, y, z]: [f32; 3]) -> Value {
    json!({"x": x, "y": y, "z": z})
}

fn pose(center_m: [f32; 3], yaw_rad: f32) -> Value {
    json!({"position": vector(center_m), "orientation": quaternion(0.0, 0.0, yaw_rad.into())})
}

/// Quaternion of the rotation Rz(yaw) Ry(pitch) Rx(roll); angles in rad.
fn quaternion(roll: f64, pitch: f64, yaw: f64) -> Value {
    let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(|rad| (rad / 2.0).sin_cos());
    json!({
        "x": sr * cp * cy - cr * sp * sy,
        "y": cr * sp * cy + sr * cp * sy,
        "z": cr * cp * sy - sr * sp * cy,
        "w": cr * cp * cy + sr * sp * sy,
    })
}
