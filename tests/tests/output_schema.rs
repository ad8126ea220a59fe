//! The output lines match `docs/objects.schema.json`.

use mluc_tests::{Setting, read_json, root};
use serde_json::{Value, json};
use std::sync::LazyLock;

static SCHEMA: LazyLock<Value> =
    LazyLock::new(|| read_json(&root().join("docs/objects.schema.json")));

/// Checks a value against a part of the schema. It knows only the JSON Schema features that our schema uses; anything else is an error.
fn check(schema: &Value, value: &Value, place: &str) -> Result<(), String> {
    for (keyword, wanted) in schema.as_object().ok_or("a schema is an object")? {
        match keyword.as_str() {
            "$schema" | "title" | "description" | "$defs" => (),
            "$ref" => {
                let pointer = wanted.as_str().unwrap_or("").trim_start_matches('#');
                check(SCHEMA.pointer(pointer).ok_or("dead $ref")?, value, place)?;
            }
            "type" if is_of_type(wanted, value) => (),
            "enum" if wanted.as_array().is_some_and(|list| list.contains(value)) => (),
            "required" => {
                let keys = wanted.as_array().into_iter().flatten();
                for key in keys.filter_map(Value::as_str) {
                    value.get(key).ok_or(format!("{place}: {key} is missing"))?;
                }
            }
            "properties" => {
                for (key, inner) in value.as_object().into_iter().flatten() {
                    let known = wanted.get(key);
                    let known = known.ok_or(format!("{place}: {key} is not in the schema"))?;
                    check(known, inner, &format!("{place}.{key}"))?;
                }
            }
            "additionalProperties" if *wanted == json!(false) => (),
            "items" => {
                for (index, inner) in value.as_array().into_iter().flatten().enumerate() {
                    check(wanted, inner, &format!("{place}[{index}]"))?;
                }
            }
            _ => return Err(format!("{place}: {value} is not {keyword} {wanted}")),
        }
    }
    Ok(())
}

fn is_of_type(wanted: &Value, value: &Value) -> bool {
    let names = wanted.as_array().map_or(std::slice::from_ref(wanted), Vec::as_slice);
    names.iter().any(|name| match name.as_str() {
        Some("null") => value.is_null(),
        Some("boolean") => value.is_boolean(),
        Some("integer") => value.is_u64() || value.is_i64(),
        Some("number") => value.is_number(),
        Some("string") => value.is_string(),
        Some("array") => value.is_array(),
        Some("object") => value.is_object(),
        _ => false,
    })
}

#[test]
fn every_line_fits_the_schema() {
    let run = Setting::new("schema", 3).run("");
    run.assert_ended(0, 3);
    for line in &run.lines {
        check(&SCHEMA, line, "line").unwrap();
    }
    let has_objects = |line: &Value| !line["objects"].as_array().unwrap().is_empty();
    assert!(run.lines.iter().any(has_objects));
    for (key, value) in [("latency_us", json!("soon")), ("more", json!(1))] {
        let mut wrong = run.lines[0].clone();
        wrong[key] = value;
        let checked = check(&SCHEMA, &wrong, "line");
        assert!(checked.is_err(), "the check can fail");
    }
}
