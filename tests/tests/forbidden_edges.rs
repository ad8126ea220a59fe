//! Which crate may know which: read from `cargo metadata`, transitive edges too.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

use cargo_metadata::{DependencyKind, Metadata, MetadataCommand};

const STAGES: [&str; 5] = [
    "mluc-ingest",
    "mluc-backbone",
    "mluc-head",
    "mluc-refiner",
    "mluc-gateway",
];
/// Crates of the laboratory, the benchmark and the tests, and libraries that nobody else needs.
const ONLY_LAB_AND_TESTS: [&str; 15] = [
    "mluc-lab",
    "mluc-dataset",
    "mluc-simulate",
    "mluc-train",
    "mluc-evaluate",
    "mluc-reproduce",
    "mluc-bench",
    "mluc-tests",
    "mluc-contract",
    "parry3d",
    "rand_chacha",
    "indicatif",
    "criterion",
    "proptest",
    "cargo_metadata",
];
const CONTRACT: &str = "mluc-ipc-types";
const SHARED_MEMORY: &str = "iceoryx2";

/// Of this machine's platform: packages of others need not have been fetched.
fn metadata() -> &'static Metadata {
    static METADATA: OnceLock<Metadata> = OnceLock::new();
    METADATA.get_or_init(|| {
        let platform = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
        let mut command = MetadataCommand::new();
        command.other_options(["--filter-platform".to_string(), platform]);
        command.exec().expect("cargo metadata")
    })
}

type Edges = BTreeMap<String, BTreeSet<String>>;

/// Normal and build dependencies of every package, by name. The contract's optional edge to iceoryx2 is left out: it
/// holds marker traits alone, and `the_contract_needs_iceoryx2_only_for_the_runtime` guards it.
fn edges() -> Edges {
    let packages = metadata().packages.iter();
    let names: BTreeMap<_, _> = packages.map(|p| (&p.id, p.name.to_string())).collect();
    let resolve = metadata().resolve.as_ref().expect("a resolved graph");
    let mut edges = Edges::new();
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

fn reached(edges: &Edges, from: &str) -> BTreeSet<String> {
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

fn assert_apart<'a>(from: &str, forbidden: impl IntoIterator<Item = &'a str>) {
    let reached = reached(&edges(), from);
    for name in forbidden {
        assert!(!reached.contains(name), "{from} must not reach {name}");
    }
}

#[test]
fn stage_libraries_know_no_process_and_no_other_stage() {
    for stage in STAGES {
        assert_apart(stage, STAGES.into_iter().filter(|other| *other != stage));
        assert_apart(
            stage,
            ["mluc-runtime", "mluc", "mluc-lab", SHARED_MEMORY, "tracing"],
        );
    }
}

#[test]
fn the_laboratory_knows_no_process_and_the_program_no_laboratory() {
    assert_apart("mluc-lab", ["mluc-runtime", "mluc", SHARED_MEMORY]);
    // What trains a network knows nothing of the tables that are made with it.
    assert_apart("mluc-train", ["mluc-reproduce", "mluc-lab"]);
    assert_apart("mluc-backbone", ["mluc-train"]);
    assert_apart("mluc", ONLY_LAB_AND_TESTS);
}

#[test]
fn the_foundations_know_nothing_of_ours() {
    let edges = edges();
    for (name, allowed) in [
        (CONTRACT, &[][..]),
        ("mluc-geometry", &[]),
        ("mluc-kernels", &[]),
        ("mluc-model", &["mluc-geometry"]),
        ("mluc-runtime", &[CONTRACT]),
    ] {
        let mut wrong = reached(&edges, name);
        wrong.retain(|other| other == "mluc" || other.starts_with("mluc-"));
        wrong.retain(|other| !allowed.contains(&other.as_str()));
        assert!(wrong.is_empty(), "{name} must not reach {wrong:?}");
    }
}

#[test]
fn the_contract_needs_iceoryx2_only_for_the_runtime() {
    for package in metadata().workspace_packages() {
        let name = package.name.as_str();
        for dependency in &package.dependencies {
            let is_iceoryx2 = dependency.name == SHARED_MEMORY;
            let is_marker = name == CONTRACT && is_iceoryx2;
            assert!(
                !is_marker || dependency.optional,
                "the contract's marker traits are a feature"
            );
            let mut features = dependency.features.iter();
            let asks = dependency.name == CONTRACT && features.any(|f| f == SHARED_MEMORY);
            assert!(!asks || name == "mluc-runtime", "{name} asks for iceoryx2");
            let is_direct = is_iceoryx2 && dependency.kind != DependencyKind::Development;
            // The benchmark of hand-over measures iceoryx2 alone beside our hop.
            let may = [CONTRACT, "mluc-runtime", "mluc-bench"].contains(&name);
            assert!(!is_direct || may, "{name} depends on iceoryx2");
        }
        let default = package
            .features
            .get("default")
            .is_some_and(|list| !list.is_empty());
        assert!(
            name != CONTRACT || !default,
            "the contract has no default features"
        );
    }
}

/// The search itself finds an edge where there is one: else the tests above could not fail.
#[test]
fn an_allowed_edge_is_found() {
    let edges = edges();
    for (from, to) in [
        ("mluc", SHARED_MEMORY),
        ("mluc", "mluc-kernels"),
        ("mluc-lab", "mluc-backbone"),
    ] {
        assert!(reached(&edges, from).contains(to), "{from} reaches {to}");
    }
}
