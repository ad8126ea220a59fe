//! The lines are what `docs/objects.schema.json` says.

use std::path::Path;

use mluc_tests::Setting;
use serde_json::{Value, json};

/// The part of JSON Schema that our schema uses; anything else in it is an error.
fn check(schema: &Value, root: &Value, value: &Value, place: &str) -> Result<(), String> {
    let keywords = schema.as_object().ok_or("a schema is an object")?;
    for (keyword, wanted) in keywords {
        match keyword.as_str() {
            "$schema" | "title" | "description" | "$defs" => (),
            "$ref" => {
                let pointer = wanted.as_str().unwrap_or("").trim_start_matches('#');
                check(
                    root.pointer(pointer).ok_or("dead $ref")?,
                    root,
                    value,
                    place,
                )?;
            }
            "type" => check_type(wanted, value, place)?,
            "enum" if wanted.as_array().is_some_and(|list| list.contains(value)) => (),
            "required" => {
                for key in wanted
                    .as_array()
                    .into_iter()
                    .flatten()
                    .filter_map(Value::as_str)
                {
                    value.get(key).ok_or(format!("{place}: {key} is missing"))?;
                }
            }
            "properties" => {
                for (key, inner) in value.as_object().into_iter().flatten() {
                    let known = wanted
                        .get(key)
                        .ok_or(format!("{place}: {key} is not in the schema"))?;
                    check(known, root, inner, &format!("{place}.{key}"))?;
                }
            }
            "additionalProperties" if *wanted == json!(false) => (),
            "items" => {
                for (index, inner) in value.as_array().into_iter().flatten().enumerate() {
                    check(wanted, root, inner, &format!("{place}[{index}]"))?;
                }
            }
            _ => {
                return Err(format!(
                    "{place}: {keyword} {wanted} does not hold for {value}"
                ));
            }
        }
    }
    Ok(())
}

fn check_type(wanted: &Value, value: &Value, place: &str) -> Result<(), String> {
    let found = match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(number) if number.is_u64() || number.is_i64() => "integer",
        Value::Number(_) => "number",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    };
    let fits =
        |name: &Value| *name == json!(found) || (*name == json!("number") && found == "integer");
    let names = wanted
        .as_array()
        .map_or(std::slice::from_ref(wanted), Vec::as_slice);
    if names.iter().any(fits) {
        return Ok(());
    }
    Err(format!("{place}: {found} instead of {wanted}"))
}

fn schema() -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/objects.schema.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn every_line_fits_the_schema() {
    let run = Setting::new("schema", 3).run(&[]);
    assert_eq!(run.lines.len(), 3, "{}", run.log);
    let schema = schema();
    for line in &run.lines {
        check(&schema, &schema, line, "line").unwrap();
    }
    assert!(
        run.lines
            .iter()
            .any(|line| !line["objects"].as_array().unwrap().is_empty())
    );
    for (key, value) in [("latency_us", json!("soon")), ("more", json!(1))] {
        let mut wrong = run.lines[0].clone();
        wrong[key] = value;
        let found = check(&schema, &schema, &wrong, "line");
        assert!(found.is_err(), "the check can fail");
    }
}
