//! Which crate may depend on which, from `cargo metadata`; this includes transitive edges.

use cargo_metadata::{DependencyKind, Metadata, MetadataCommand};
use serde::Deserialize;
use std::{collections::BTreeMap, collections::BTreeSet, sync::LazyLock};

const CONTRACT: &str = "mluc-ipc-types";
const SHARED_MEMORY: &str = "iceoryx2";

type Names = BTreeMap<String, BTreeSet<String>>;

/// The rules of `forbidden_edges.toml`.
#[derive(Deserialize)]
struct Rules {
    stages: BTreeSet<String>,
    never_in_a_stage: BTreeSet<String>,
    never: Names,
    only: Names,
    found: Names,
}

/// Metadata for this machine's platform: packages of other platforms may not have been fetched.
static METADATA: LazyLock<Metadata> = LazyLock::new(|| {
    let platform = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let mut command = MetadataCommand::new();
    command.other_options(["--filter-platform".to_string(), platform]);
    command.exec().expect("cargo metadata")
});

/// Normal and build dependencies of every package, by name. The contract's optional edge to iceoryx2 is left out: it
/// contains marker traits alone, and `the_contract_needs_iceoryx2_only_for_the_runtime` guards it.
fn edges() -> Names {
    let packages = METADATA.packages.iter();
    let names: BTreeMap<_, _> = packages.map(|p| (&p.id, p.name.to_string())).collect();
    let resolve = METADATA.resolve.as_ref().expect("a resolved graph");
    let mut edges = Names::new();
    for node in &resolve.nodes {
        let from = edges.entry(names[&node.id].clone()).or_default();
        for dependency in &node.deps {
            let mut kinds = dependency.dep_kinds.iter();
            let is_used = kinds.any(|kind| kind.kind != DependencyKind::Development);
            let name = &names[&dependency.pkg];
            let is_marker = names[&node.id] == CONTRACT && name == SHARED_MEMORY;
            if is_used && !is_marker {
                from.insert(name.clone());
            }
        }
    }
    edges
}

fn reached(edges: &Names, from: &str) -> BTreeSet<String> {
    assert!(edges.contains_key(from), "no package {from}");
    let mut found = BTreeSet::new();
    let mut open = vec![from.to_string()];
    while let Some(name) = open.pop() {
        for next in edges.get(&name).into_iter().flatten() {
            if found.insert(next.clone()) {
                open.push(next.clone());
            }
        }
    }
    found
}

#[test]
fn every_package_keeps_the_rules() {
    let rules: Rules = toml::from_str(include_str!("forbidden_edges.toml")).expect("rules");
    let edges = edges();
    let none = |from: &str, forbidden: &BTreeSet<String>| {
        let reached = reached(&edges, from);
        let wrong: Vec<_> = reached.intersection(forbidden).collect();
        assert!(wrong.is_empty(), "{from} must not reach {wrong:?}");
    };
    for stage in &rules.stages {
        let mut others = &rules.stages | &rules.never_in_a_stage;
        others.remove(stage);
        none(stage, &others);
    }
    for (from, forbidden) in &rules.never {
        none(from, forbidden);
    }
    for (from, allowed) in &rules.only {
        let mut ours = reached(&edges, from);
        ours.retain(|name| name == "mluc" || name.starts_with("mluc-"));
        none(from, &(&ours - allowed));
    }
    // Otherwise the rules above could never fail.
    for (from, expected) in &rules.found {
        assert!(reached(&edges, from).is_superset(expected), "{from}");
    }
}

#[test]
fn the_contract_needs_iceoryx2_only_for_the_runtime() {
    for package in METADATA.workspace_packages() {
        let name = package.name.as_str();
        for dependency in &package.dependencies {
            let is_iceoryx2 = dependency.name == SHARED_MEMORY;
            let is_marker = name == CONTRACT && is_iceoryx2;
            assert!(!is_marker || dependency.optional, "marker traits are a feature");
            let mut features = dependency.features.iter();
            let asks = dependency.name == CONTRACT && features.any(|f| f == SHARED_MEMORY);
            assert!(!asks || name == "mluc-runtime", "{name} asks for iceoryx2");
            let is_direct = is_iceoryx2 && dependency.kind != DependencyKind::Development;
            let may = [CONTRACT, "mluc-runtime"].contains(&name);
            assert!(!is_direct || may, "{name} depends on iceoryx2");
        }
        let has_default = package.features.get("default").is_some_and(|list| !list.is_empty());
        assert!(name != CONTRACT || !has_default, "no default features");
    }
}
