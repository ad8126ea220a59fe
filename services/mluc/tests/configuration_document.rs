//! `docs/configuration.md` names exactly the keys and the environment variables that the code reads.

use mluc::{document::known_keys, settings::Settings};
use std::{collections::BTreeSet, path::Path, path::PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn document() -> String {
    std::fs::read_to_string(root().join("docs/configuration.md")).expect("the document")
}

/// For each row of a table that begins with a word in backticks: the heading above it, and the cells without backticks.
fn rows(document: &str) -> Vec<(&str, Vec<&str>)> {
    let mut heading = "";
    let mut rows = Vec::new();
    for line in document.lines() {
        if line.starts_with('#') {
            heading = line.trim_start_matches('#').trim();
        }
        if line.starts_with("| `") {
            let cells = line.split('|').skip(1).map(|cell| cell.trim().trim_matches('`'));
            rows.push((heading, cells.collect()));
        }
    }
    rows
}

const STAGES: &str = "`[stages.ingest]`, `[stages.backbone]`, `[stages.head]`, `[stages.refiner]`";

/// Keys of the settings by their heading in the document.
fn keys() -> BTreeSet<(String, String)> {
    let document = toml::Table::try_from(Settings::default()).expect("settings as a document");
    let tables = document.iter().filter(|(_, value)| value.is_table());
    let tables = tables.map(|(key, _)| key.as_str()).chain(["track"]);
    let tables = tables.filter(|key| *key != "stages");
    let named = tables.map(|table| (format!("`[{table}]`"), table.to_string()));
    let named = named.chain([("`[[lidar]]`".to_string(), "lidar".to_string())]);
    let stages = ["ingest", "backbone", "head", "refiner"];
    let stages = stages.map(|stage| (STAGES.to_string(), format!("stages.{stage}")));
    let top = [("Keys".to_string(), String::new())];
    let mut keys = BTreeSet::new();
    for (heading, table) in top.into_iter().chain(named).chain(stages) {
        let known = known_keys(&table);
        assert!(!known.is_empty(), "{table} has no keys");
        for key in known {
            // Keys that are tables have their own headings; `track` may be one.
            let inner = format!("{table}.{key}");
            let is_table = key == "bench" || !known_keys(inner.trim_start_matches('.')).is_empty();
            if key == "track" || !is_table {
                keys.insert((heading.clone(), key));
            }
        }
    }
    keys
}

/// Names in string literals of the programs' code that begin with MLUC_. Left out are the names that a build script sets for
/// the compiler, and the C header's constants: a user sets none of them.
fn variables() -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let folders = ["ipc-types", "services", "capi", "bench", "lab", "tests"];
    let mut folders: Vec<PathBuf> = folders.map(|name| root().join(name)).to_vec();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder").flatten() {
            let path = entry.path();
            let name = entry.file_name().to_string_lossy().into_owned();
            let is_code = name.ends_with(".rs") && name != "contract_document.rs";
            if path.is_dir() && name != "target" {
                folders.push(path);
            } else if is_code {
                let code = std::fs::read_to_string(&path).expect("readable");
                let code = code.replace(" env!(\"", " env!(").replace("(env!(\"", "(env!(");
                let literals = code.split("\"MLUC_").skip(1);
                let names =
                    literals.filter_map(|literal| literal.split_once('"').map(|(name, _)| name));
                let is_variable = |name: &&str| {
                    let plain = |c: char| c.is_ascii_uppercase() || c == '_' || c.is_ascii_digit();
                    !name.is_empty() && name.chars().all(plain)
                };
                found.extend(names.filter(is_variable).map(|name| format!("MLUC_{name}")));
            }
        }
    }
    found
}

#[test]
fn the_document_has_every_key_and_no_other() {
    let document = document();
    let rows = rows(&document).into_iter();
    let written = rows.filter(|(heading, _)| *heading != "Environment");
    let written = written.map(|(heading, cells)| (heading.to_string(), cells[0].to_string()));
    let (written, known): (BTreeSet<_>, _) = (written.collect(), keys());
    let missing: Vec<_> = known.difference(&written).collect();
    let unknown: Vec<_> = written.difference(&known).collect();
    assert!(
        missing.is_empty() && unknown.is_empty(),
        "missing: {missing:?}; no such key: {unknown:?}"
    );
}

#[test]
fn the_document_has_every_environment_variable_and_no_other() {
    let document = document();
    let rows = rows(&document).into_iter();
    let rows = rows.filter(|(heading, _)| *heading == "Environment");
    let written: BTreeSet<String> = rows.map(|(_, cells)| cells[0].to_string()).collect();
    assert_eq!(written, variables());
}

/// Each row gives the default of the code, if it is a plain value.
#[test]
fn the_document_has_the_defaults_of_the_code() {
    let document = document();
    let tables = toml::Table::try_from(Settings::default()).expect("settings as a document");
    let mut compared = 0;
    for (heading, cells) in rows(&document) {
        let [key, _, _, written, ..] = cells[..] else {
            continue;
        };
        let table = match heading {
            "Keys" => Some(&tables),
            _ => tables.get(heading.trim_matches(['`', '[', ']'])).and_then(|t| t.as_table()),
        };
        let Some(value) = table.and_then(|table| table.get(key)) else {
            continue;
        };
        let is_same = match value {
            toml::Value::String(text) => text == written,
            toml::Value::Float(number) => written.parse() == Ok(*number),
            other => other.to_string() == written,
        };
        assert!(is_same, "{heading} {key}: the document says {written}, the code {value}");
        compared += 1;
    }
    assert!(compared > 12, "{compared}");
}
