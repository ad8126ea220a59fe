//! `docs/CONTRACT.md`, `mluc.h` and `mluc.py` agree with the code: layouts, limits, topics, codes.

mod contract_layouts;

use contract_layouts::{c_struct, layouts, python_struct};
use mluc_ipc_types::{
    CLASSES_MAX, DETECTIONS_MAX, Disposition, FOOTPRINT_MAX, Flags, GateKind, HealthState,
    OBJECT_POINTS_MAX, OBJECTS_MAX, Object, POINTS_MAX, StatusState, Topic, WIRE_VERSION,
};
use mluc_tests::root;

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// The cells of the tables between a heading and the next one.
fn rows(document: &str, heading: &str) -> Vec<Vec<String>> {
    let mut lines = document.lines();
    assert!(lines.any(|line| line == heading), "no heading '{heading}' in the document");
    let below = lines.take_while(|line| !line.starts_with('#'));
    let rows = below.filter(|line| line.starts_with('|') && !line.starts_with("|---"));
    let cell = |cell: &str| cell.trim().trim_matches('`').to_string();
    rows.map(|row| row.trim_matches('|').split('|').map(cell).collect()).collect()
}

/// Names and numbers of a table's rows.
fn codes(rows: &[Vec<String>]) -> Vec<(&str, u32)> {
    rows.iter().map(|row| (row[0].as_str(), row[1].parse().unwrap())).collect()
}

/// The numbers that define a topic's queue, in the order of both languages.
fn queue(topic: &Topic) -> [usize; 5] {
    let t = topic;
    [t.subscribers_max, t.buffer, t.borrowed, t.loans, t.history]
}

#[test]
fn the_document_has_every_field_at_its_offset() {
    let document = read("docs/CONTRACT.md");
    for layout in layouts() {
        let (name, size, align) = (layout.name, layout.size, layout.align);
        let heading = format!("### `mluc.{name}`: {size} bytes, alignment {align}");
        let rows = rows(&document, &heading);
        let said = rows[1..].iter().map(|row| {
            let [offset, bytes] = [0, 1].map(|column| row[column].parse().unwrap());
            (row[3].clone(), offset, bytes)
        });
        assert_eq!(said.collect::<Vec<_>>(), layout.fields, "{name}");
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
        ("points", Topic::POINTS, "mluc.Point"),
        ("detections", Topic::DETECTIONS, "mluc.Detection"),
        ("objects", Topic::OBJECTS, "mluc.Object"),
        ("object_points", Topic::OBJECT_POINTS, "u32"),
        ("health/refiner", Topic::HEALTH, "mluc.Health"),
        ("run", Topic::RUN, "mluc.RunDescription"),
        ("status", Topic::STATUS, "mluc.Status"),
    ];
    let expected = topics.map(|(name, topic, element)| {
        assert!(name.starts_with(topic.name));
        let numbers = [&[topic.elements_max][..], &queue(&topic)].concat();
        let words = [name, element].map(str::to_string).into_iter();
        let numbers = numbers.iter().map(usize::to_string);
        words.chain(numbers).collect::<Vec<_>>()
    });
    assert_eq!(said[1..], expected);
}

#[test]
fn the_document_has_the_codes() {
    let document = read("docs/CONTRACT.md");
    let tables = rows(&document, "### Codes");
    assert!(tables.iter().flatten().all(|cell| !cell.is_empty()));
    let table = |head: &str| tables.iter().position(|row| row[0] == head).unwrap();
    let (second, third) = (table("disposition"), table("gate"));
    let health = rows(&document, "## Health");
    let status = rows(&document, "## Status");
    let flags: Vec<_> = Flags(u32::MAX).names().collect();
    for (rows, names) in [
        (&tables[1..second], &flags[..]),
        (&tables[second + 1..third], &Disposition::NAMES),
        (&tables[third + 1..], &GateKind::NAMES),
        (&health[1..], &HealthState::NAMES),
        (&status[1..], &StatusState::NAMES),
    ] {
        let numbered: Vec<_> = names.iter().copied().zip(0..).collect();
        assert_eq!(codes(rows), numbered);
    }
    for (bit, name) in Object::FLAG_NAMES.iter().enumerate() {
        assert!(document.contains(&format!("{} {name}", 1 << bit)), "{name}");
    }
    assert!(document.contains(&format!("`wire={WIRE_VERSION} version=")));
}

#[test]
fn the_c_header_is_the_contract() {
    let header = read("capi/include/mluc.h");
    // The library itself reports health, so the header needs no `Health`.
    for layout in layouts().iter().filter(|layout| layout.name != "Health") {
        let said = c_struct(&header, layout.name);
        assert_eq!(said, layout.fields, "{}", layout.name);
    }
    let limits = [
        ("WIRE_VERSION", WIRE_VERSION as usize),
        ("POINTS_MAX", POINTS_MAX),
        ("DETECTIONS_MAX", DETECTIONS_MAX),
        ("OBJECTS_MAX", OBJECTS_MAX),
        ("OBJECT_POINTS_MAX", OBJECT_POINTS_MAX),
        ("CLASSES_MAX", CLASSES_MAX),
        ("FOOTPRINT_MAX", FOOTPRINT_MAX),
    ];
    let mut lines = vec![format!("#define MLUC_NONE {:#x}u\n", Object::NONE)];
    lines.extend(limits.map(|(key, value)| format!("#define MLUC_{key} {value}u\n")));
    let code = |name: &str, value: String| format!("MLUC_{} = {value}", name.to_uppercase());
    let dispositions = Disposition::NAMES.iter().enumerate();
    lines.extend(dispositions.map(|(number, name)| code(name, number.to_string())));
    let states = StatusState::NAMES.iter().enumerate();
    lines.extend(states.map(|(number, name)| code(&format!("state_{name}"), number.to_string())));
    let flags = Flags(u32::MAX).names().enumerate();
    lines.extend(flags.map(|(bit, name)| code(name, format!("1 << {bit}"))));
    for line in lines {
        assert!(header.contains(&line), "{line}");
    }
}

#[test]
fn the_python_module_is_the_contract() {
    let module = read("python/mluc.py");
    for layout in layouts() {
        let said = python_struct(&module, layout.name);
        assert_eq!(said, layout.fields, "{}", layout.name);
    }
    assert!(module.contains(&format!("NONE = {WIRE_VERSION}, 3, 2**32 - 1")));
    let states = StatusState::NAMES.map(|name| format!("{name:?}"));
    let states = format!("STATUS_AGE_MAX_NS = ({})", states.join(", "));
    assert!(module.contains(&states), "{states}");
    for topic in [Topic::POINTS, Topic::DETECTIONS, Topic::OBJECTS] {
        let start = format!("\"{}\": (", topic.name);
        let line = module.lines().find(|line| line.contains(&start)).unwrap();
        let queue = queue(&topic).map(|number| number.to_string()).join(", ");
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
