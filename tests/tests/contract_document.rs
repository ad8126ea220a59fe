//! `docs/CONTRACT.md`, `mluc.h` and `mluc.py` say what the code says: layouts, limits, topics, codes.

mod contract_layouts;

use std::path::Path;

use contract_layouts::{Layout, c_struct, layouts, python_struct};
use mluc_ipc_types::{
    CLASSES_MAX, DETECTIONS_MAX, Disposition, FOOTPRINT_MAX, Flags, GateKind, HealthState,
    OBJECT_POINTS_MAX, OBJECTS_MAX, Object, POINTS_MAX, Topic, WIRE_VERSION,
};

fn read(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The cells of the tables below a heading, up to the next heading.
fn rows(document: &str, heading: &str) -> Vec<Vec<String>> {
    let mut lines = document.lines();
    assert!(
        lines.any(|line| line == heading),
        "no heading '{heading}' in the document"
    );
    lines
        .take_while(|line| !line.starts_with('#'))
        .filter(|line| line.starts_with('|') && !line.starts_with("|---"))
        .map(|line| {
            let cells = line.trim_matches('|').split('|');
            cells
                .map(|cell| cell.trim().trim_matches('`').to_string())
                .collect()
        })
        .collect()
}

#[test]
fn the_document_has_every_field_at_its_offset() {
    let document = read("docs/CONTRACT.md");
    for Layout {
        name,
        size,
        align,
        fields,
    } in layouts()
    {
        let heading = format!("### `mluc.{name}`: {size} bytes, alignment {align}");
        let rows = rows(&document, &heading);
        let said: Vec<(String, usize, usize)> = rows[1..]
            .iter()
            .map(|row| {
                (
                    row[3].clone(),
                    row[0].parse().unwrap(),
                    row[1].parse().unwrap(),
                )
            })
            .collect();
        assert_eq!(said, fields, "{name}");
        let empty = rows.iter().find(|row| row.iter().any(String::is_empty));
        assert_eq!(empty, None, "{name}: every field has a meaning");
    }
}

#[test]
fn a_layout_of_the_test_is_whole() {
    for layout in layouts() {
        let mut end = 0;
        for (field, offset, bytes) in &layout.fields {
            assert_eq!(*offset, end, "{}.{field}", layout.name);
            end += bytes;
        }
        assert_eq!(end, layout.size, "{}", layout.name);
    }
}

#[test]
fn the_document_has_the_topics_settings() {
    let document = read("docs/CONTRACT.md");
    let said = rows(&document, "## Services");
    let topics = [
        (Topic::POINTS, "mluc.Point"),
        (Topic::DETECTIONS, "mluc.Detection"),
        (Topic::OBJECTS, "mluc.Object"),
        (Topic::OBJECT_POINTS, "u32"),
        (Topic::HEALTH, "mluc.Health"),
        (Topic::RUN, "mluc.RunDescription"),
    ];
    let expected: Vec<Vec<String>> = topics
        .iter()
        .map(|(topic, element)| {
            let name = match topic.name {
                "health" => "health/refiner",
                name => name,
            };
            let numbers = [
                topic.elements_max,
                topic.subscribers_max,
                topic.buffer,
                topic.borrowed,
                topic.loans,
                topic.history,
            ];
            [name.to_string(), element.to_string()]
                .into_iter()
                .chain(numbers.map(|number| number.to_string()))
                .collect()
        })
        .collect();
    assert_eq!(said[1..], expected);
}

#[test]
fn the_document_has_the_codes() {
    let document = read("docs/CONTRACT.md");
    let codes = rows(&document, "### Codes");
    assert!(codes.iter().flatten().all(|cell| !cell.is_empty()));
    let table = |head: &str| codes.iter().position(|row| row[0] == head).unwrap();
    let (second, third) = (table("disposition"), table("gate"));
    let pairs = |rows: &[Vec<String>]| -> Vec<(String, u32)> {
        rows.iter()
            .map(|row| (row[0].clone(), row[1].parse().unwrap()))
            .collect()
    };
    let flags: Vec<(String, u32)> = Flags(u32::MAX)
        .names()
        .zip(0..)
        .map(|(name, bit)| (name.to_string(), bit))
        .collect();
    assert_eq!(pairs(&codes[1..second]), flags);
    let dispositions =
        Disposition::ALL.map(|disposition| (disposition.name().to_string(), disposition as u32));
    assert_eq!(pairs(&codes[second + 1..third]), dispositions);
    let gates = GateKind::ALL.map(|gate| (gate.name().to_string(), gate as u32));
    assert_eq!(pairs(&codes[third + 1..]), gates);
    let states = HealthState::ALL.map(|state| (state.name().to_string(), state as u32));
    assert_eq!(pairs(&rows(&document, "## Health")[1..]), states);
    for (bit, name) in Object::FLAG_NAMES.iter().enumerate() {
        assert!(document.contains(&format!("{} {name}", 1 << bit)), "{name}");
    }
    assert!(document.contains(&format!("`wire={WIRE_VERSION} version=")));
}

#[test]
fn the_c_header_is_the_contract() {
    let header = read("capi/include/mluc.h");
    // The library tells health by itself.
    for layout in layouts().iter().filter(|layout| layout.name != "Health") {
        assert_eq!(
            c_struct(&header, layout.name),
            layout.fields,
            "{}",
            layout.name
        );
    }
    let defined = |key: &str| -> u64 {
        let line = header
            .lines()
            .find(|line| line.starts_with(&format!("#define {key} ")))
            .unwrap_or_else(|| panic!("no {key}"));
        let word = line
            .split_whitespace()
            .nth(2)
            .unwrap()
            .trim_end_matches('u');
        match word.strip_prefix("0x") {
            Some(hex) => u64::from_str_radix(hex, 16).unwrap(),
            None => word.parse().unwrap(),
        }
    };
    for (key, value) in [
        ("MLUC_WIRE_VERSION", WIRE_VERSION as usize),
        ("MLUC_POINTS_MAX", POINTS_MAX),
        ("MLUC_DETECTIONS_MAX", DETECTIONS_MAX),
        ("MLUC_OBJECTS_MAX", OBJECTS_MAX),
        ("MLUC_OBJECT_POINTS_MAX", OBJECT_POINTS_MAX),
        ("MLUC_CLASSES_MAX", CLASSES_MAX),
        ("MLUC_FOOTPRINT_MAX", FOOTPRINT_MAX),
        ("MLUC_NONE", Object::NONE as usize),
    ] {
        assert_eq!(defined(key), value as u64, "{key}");
    }
    for disposition in Disposition::ALL {
        let line = format!(
            "MLUC_{} = {}",
            disposition.name().to_uppercase(),
            disposition as u32
        );
        assert!(header.contains(&line), "{line}");
    }
    for (bit, name) in Flags(u32::MAX).names().enumerate() {
        let line = format!("MLUC_{} = 1 << {bit}", name.to_uppercase());
        assert!(header.contains(&line), "{line}");
    }
}

#[test]
fn the_python_module_is_the_contract() {
    let module = read("examples/refiner-python/mluc.py");
    for layout in layouts() {
        assert_eq!(
            python_struct(&module, layout.name),
            layout.fields,
            "{}",
            layout.name
        );
    }
    assert!(module.contains(&format!("NONE = {WIRE_VERSION}, 3, 2**32 - 1")));
    for topic in [Topic::POINTS, Topic::DETECTIONS, Topic::OBJECTS] {
        let start = format!("\"{}\": (", topic.name);
        let line = module.lines().find(|line| line.contains(&start)).unwrap();
        let queue = [
            topic.subscribers_max,
            topic.buffer,
            topic.borrowed,
            topic.loans,
            topic.history,
        ];
        let queue = queue.map(|number| number.to_string()).join(", ");
        assert!(line.ends_with(&format!("{queue}),")), "{line}: {queue}");
    }
}

#[test]
fn the_python_example_is_as_short_as_the_document_says() {
    let lines = read("examples/refiner-python/refiner.py").lines().count();
    assert!(lines < 80, "{lines}");
    let said = format!("`refiner.py`: {lines} lines");
    assert!(read("docs/CONTRACT.md").contains(&said), "{said}");
}
