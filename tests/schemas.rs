//! The published JSON Schemas are those of the types.

use std::fs;

use tumbled::schema::{Published, config, outputs};

use crate::support::repository;

fn all() -> Vec<Published> {
    let mut all = outputs();
    all.push(config());
    all
}

#[test]
fn published_schemas_are_current() {
    for published in all() {
        let committed = fs::read_to_string(repository().join(published.file)).unwrap_or_default();
        assert!(
            committed == published.text(),
            "{} is not what its type says: cargo test --test main -- --ignored regenerate",
            published.file
        );
    }
}

#[test]
fn docs_schema_holds_no_schema_of_an_output_that_is_gone() {
    let known: Vec<_> = all().iter().map(|published| repository().join(published.file)).collect();
    for entry in fs::read_dir(repository().join("docs/schema")).expect("docs/schema") {
        let path = entry.expect("an entry").path();
        let stale = path.to_string_lossy().ends_with(".schema.json") && !known.contains(&path);
        assert!(!stale, "{} belongs to no output", path.display());
    }
}

#[test]
#[ignore = "writes the schemas anew"]
fn regenerate() {
    for published in all() {
        fs::write(repository().join(published.file), published.text()).expect("writes a schema");
    }
}
