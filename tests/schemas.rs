//! The published JSON Schemas are those of the types.

use std::collections::BTreeSet;
use std::fs;

use tumbled::schema::{Published, config, files, outputs};

use crate::support::repository;

fn all() -> Vec<Published> {
    let mut all = outputs();
    all.push(config());
    all.extend(files());
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
fn docs_schema_holds_no_schema_of_anything_that_is_gone() {
    let known: Vec<_> = all().iter().map(|published| repository().join(published.file)).collect();
    for entry in fs::read_dir(repository().join("docs/schema")).expect("docs/schema") {
        let path = entry.expect("an entry").path();
        let stale = path.to_string_lossy().ends_with(".schema.json") && !known.contains(&path);
        assert!(!stale, "{} belongs to nothing", path.display());
    }
}

/// The names of all keys and of all alternatives in a schema.
fn keys(schema: &serde_json::Value, found: &mut BTreeSet<String>) {
    match schema {
        serde_json::Value::Object(entries) => {
            for (name, value) in entries {
                match (name.as_str(), value) {
                    ("properties", serde_json::Value::Object(properties)) => {
                        found.extend(properties.keys().cloned());
                        properties.values().for_each(|property| keys(property, found));
                    }
                    ("const", serde_json::Value::String(word)) => {
                        found.insert(word.clone());
                    }
                    ("default", _) => {}
                    _ => keys(value, found),
                }
            }
        }
        serde_json::Value::Array(values) => values.iter().for_each(|value| keys(value, found)),
        _ => {}
    }
}

#[test]
fn the_documentation_of_the_files_people_write_has_every_key() {
    // A scene's own faults are told of where fault files are.
    let documents: [&[&str]; 3] =
        [&["docs/scenes.md", "docs/faults.md"], &["docs/faults.md"], &["docs/experiments.md"]];
    for (published, documents) in files().iter().zip(documents) {
        let read = |document: &&str| fs::read_to_string(repository().join(document)).expect("a document");
        let text: String = documents.iter().map(read).collect();
        let mut found = BTreeSet::new();
        keys(published.schema.as_value(), &mut found);
        let words: BTreeSet<&str> =
            text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_' || c == '-')).collect();
        let missing: Vec<_> = found.iter().filter(|key| !words.contains(key.as_str())).collect();
        assert!(found.len() > 20 && missing.is_empty(), "{documents:?}: {missing:?}");
    }
}

#[test]
#[ignore = "writes the schemas and the telemetry's layout anew"]
fn regenerate() {
    for published in all() {
        fs::write(repository().join(published.file), published.text()).expect("writes a schema");
    }
    for (file, text) in crate::telemetry::generated() {
        fs::write(repository().join(file), text).expect("writes the telemetry's layout");
    }
}
