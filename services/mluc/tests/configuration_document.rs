//! `docs/configuration.md` names every key and every environment variable that the code reads, and nothing else.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use mluc::document::known_keys;
use mluc::settings::Settings;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The word in backticks that begins a table's row, with the headings above it.
fn rows(document: &str) -> Vec<(String, String)> {
    let mut heading = String::new();
    let mut rows = Vec::new();
    for line in document.lines() {
        if line.starts_with('#') {
            heading = line.trim_start_matches('#').trim().to_string();
        }
        if let Some(word) = line
            .strip_prefix("| `")
            .and_then(|rest| rest.split('`').next())
        {
            rows.push((heading.clone(), word.to_string()));
        }
    }
    rows
}

/// Keys of the settings by their heading in the document.
fn keys() -> BTreeSet<(String, String)> {
    let tables = toml::Table::try_from(Settings::default()).expect("settings as a document");
    let mut keys = BTreeSet::new();
    let mut add = |heading: &str, table: &str| {
        let known = known_keys(table);
        assert!(!known.is_empty(), "{table} has no keys");
        // Keys that are tables have headings of their own.
        let is_table = |key: &String| {
            let inner = if table.is_empty() {
                key.clone()
            } else {
                format!("{table}.{key}")
            };
            key != "track" && (key == "bench" || !known_keys(&inner).is_empty())
        };
        keys.extend(
            known
                .into_iter()
                .filter(|key| !is_table(key))
                .map(|key| (heading.to_string(), key)),
        );
    };
    let mut inner: Vec<String> = tables
        .iter()
        .filter(|(_, value)| value.is_table())
        .map(|(key, _)| key.clone())
        .collect();
    inner.push("track".to_string());
    add("Keys", "");
    for table in inner.iter().filter(|table| *table != "stages") {
        add(&format!("`[{table}]`"), table);
    }
    let stages = "`[stages.ingest]`, `[stages.backbone]`, `[stages.head]`, `[stages.refiner]`";
    for stage in ["ingest", "backbone", "head", "refiner"] {
        add(stages, &format!("stages.{stage}"));
    }
    keys
}

/// Names in string literals of the programs' code that begin with MLUC_; those that a build script sets for the compiler,
/// and the C header's constants, are none that a user sets.
fn variables() -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut folders: Vec<PathBuf> = ["ipc-types", "services", "capi", "bench", "lab", "tests"]
        .map(|name| root().join(name))
        .to_vec();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder").flatten() {
            let path = entry.path();
            let name = entry.file_name().to_string_lossy().into_owned();
            if path.is_dir() && name != "target" {
                folders.push(path);
            } else if name.ends_with(".rs") && name != "contract_document.rs" && name != "build.rs"
            {
                let code = std::fs::read_to_string(&path).expect("readable");
                let mut parts = code.split("\"MLUC_");
                let mut before = parts.next().unwrap_or("");
                for part in parts {
                    let name: String = part
                        .chars()
                        .take_while(|c| c.is_ascii_uppercase() || *c == '_' || c.is_ascii_digit())
                        .collect();
                    let is_set_by_build = before.ends_with(" env!(") || before.ends_with("(env!(");
                    if part[name.len()..].starts_with('"') && !name.is_empty() && !is_set_by_build {
                        found.insert(format!("MLUC_{name}"));
                    }
                    before = part;
                }
            }
        }
    }
    found
}

#[test]
fn the_document_has_every_key_and_no_other() {
    let document =
        std::fs::read_to_string(root().join("docs/configuration.md")).expect("the document");
    let written = rows(&document)
        .into_iter()
        .filter(|(heading, _)| heading != "Environment");
    let written: BTreeSet<(String, String)> = written.collect();
    let known = keys();
    let missing: Vec<_> = known.difference(&written).collect();
    let unknown: Vec<_> = written.difference(&known).collect();
    assert!(
        missing.is_empty() && unknown.is_empty(),
        "missing: {missing:?}; no such key: {unknown:?}"
    );
}

#[test]
fn the_document_has_every_environment_variable_and_no_other() {
    let document =
        std::fs::read_to_string(root().join("docs/configuration.md")).expect("the document");
    let rows = rows(&document)
        .into_iter()
        .filter(|(heading, _)| heading == "Environment");
    let written: BTreeSet<String> = rows.map(|(_, name)| name).collect();
    assert_eq!(written, variables());
}

/// A row says the default that the code has, where it is a plain value.
#[test]
fn the_document_has_the_defaults_of_the_code() {
    let document =
        std::fs::read_to_string(root().join("docs/configuration.md")).expect("the document");
    let tables = toml::Table::try_from(Settings::default()).expect("settings as a document");
    let mut section = String::new();
    let mut compared = 0;
    for line in document.lines() {
        if line.starts_with('#') {
            section = line
                .trim_start_matches('#')
                .trim()
                .trim_matches(['`', '[', ']'])
                .to_string();
        }
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let [_, key, _, _, default, ..] = cells[..] else {
            continue;
        };
        let key = key.trim_matches('`');
        let table = if section == "Keys" {
            Some(&tables)
        } else {
            tables.get(&section).and_then(|t| t.as_table())
        };
        let Some(value) = table.and_then(|table| table.get(key)) else {
            continue;
        };
        let written = default.trim_matches('`');
        let same = match value {
            toml::Value::String(text) => text == written,
            toml::Value::Float(number) => written.parse() == Ok(*number),
            other => other.to_string() == written,
        };
        assert!(
            same,
            "{section} {key}: the document says {written}, the code {value}"
        );
        compared += 1;
    }
    assert!(compared > 12, "{compared}");
}
