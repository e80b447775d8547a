//! What the README shows is what the program does.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::support::{Workbench, repository};

/// The README's blocks of a language.
fn blocks(language: &str) -> Vec<String> {
    let text = std::fs::read_to_string(repository().join("README.md")).expect("a README");
    let mut parts = text.split("\n```");
    // Before the first block; then, in turn, a block and what follows it.
    parts.next();
    let fence = format!("{language}\n");
    let blocks = parts.step_by(2).filter_map(|block| block.strip_prefix(&fence).map(str::to_owned));
    blocks.collect()
}

/// Whether a text is the pattern, in which `…` stands for anything within a line, and alone for any lines.
fn fits(pattern: &[&str], lines: &[&str]) -> bool {
    match pattern {
        [] => lines.is_empty(),
        ["…", rest @ ..] => (0..=lines.len()).any(|skipped| fits(rest, &lines[skipped..])),
        [first, rest @ ..] => {
            let Some((line, others)) = lines.split_first() else { return false };
            let mut at = 0;
            let parts: Vec<&str> = first.split('…').collect();
            let is_there = parts.iter().enumerate().all(|(n, part)| {
                let found = if n == 0 { line.starts_with(part).then_some(0) } else { line[at..].find(part) };
                found.map(|offset| at += offset + part.len()).is_some()
            });
            is_there && (first.ends_with('…') || at == line.len()) && fits(rest, others)
        }
    }
}

#[test]
fn its_console_blocks_give_what_they_show() {
    let bench = Workbench::new();
    let blocks = blocks("console");
    assert!(!blocks.is_empty());
    for block in blocks {
        for shown in block.split("$ ").skip(1) {
            let mut lines = shown.lines();
            let command = lines.next().expect("a command");
            let arguments: Vec<&str> = command.split_whitespace().collect();
            let (program, arguments) = arguments.split_first().expect("a program");
            assert_eq!(*program, "tumbled", "{command}");
            let done = bench.run(arguments);
            assert_eq!(done.code, 0, "{command}: {}", done.stderr);
            let (pattern, said): (Vec<&str>, Vec<&str>) = (lines.collect(), done.stdout.lines().collect());
            assert!(fits(&pattern, &said), "{command} says\n{}and not\n{}", done.stdout, pattern.join("\n"));
        }
    }
}

#[test]
fn its_state_has_the_keys_of_the_streams() {
    let [block] = &blocks("jsonc")[..] else { panic!("one block") };
    let text: String = block.lines().map(|line| line.split(" //").next().unwrap_or_default()).collect();
    let shown: Value = serde_json::from_str(&text).expect("JSON but for its comments");
    let schema = std::fs::read_to_string(repository().join("docs/schema/stream-state.schema.json")).expect("a schema");
    let schema: Value = serde_json::from_str(&schema).expect("JSON");
    let keys = |value: &Value| value.as_object().expect("an object").keys().cloned().collect::<BTreeSet<String>>();
    // The last two are the connection's own.
    let mut published = keys(&schema["properties"]);
    published.extend(["seq".to_owned(), "dropped".to_owned()]);
    assert_eq!(keys(&shown), published);
    for (key, definition) in [("spin", "SpinLine"), ("inputs", "InputsLine"), ("delivery", "Delivery")] {
        let known = keys(&schema["$defs"][definition]["properties"]);
        assert!(keys(&shown[key]).is_subset(&known), "{key}: {known:?}");
    }
}

#[test]
fn its_links_lead_somewhere() {
    let text = std::fs::read_to_string(repository().join("README.md")).expect("a README");
    for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
        let path = link.split('#').next().unwrap_or_default();
        assert!(link.starts_with("http") || repository().join(path).exists(), "{link}");
    }
}
