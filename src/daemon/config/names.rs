//! Names and types: a tree walked beside the shape it should have.

use super::problem::Problem;
use super::shape::{Key, Shape, quoted_list};
use super::suggest::nearest;
use super::tree::{Entry, Node, Step, Value, display_path};

/// What a walk found: problems, and where, so that the rest can be checked further without them.
#[derive(Default)]
pub struct Findings {
    /// The problems.
    pub problems: Vec<Problem>,
    /// The path of each: what stands there is not to be used.
    pub faulty: Vec<Vec<Step>>,
}

/// Checks every name and type of a tree; goes on after a problem.
pub fn check_names(root: &Node, shape: &Shape) -> Findings {
    let mut walk = Walk { root, findings: Findings::default() };
    walk.node(root, shape, "", &mut Vec::new());
    walk.findings
}

struct Walk<'a> {
    root: &'a Node,
    findings: Findings,
}

impl Walk<'_> {
    fn report(&mut self, path: &[Step], problem: Problem) {
        self.findings.problems.push(problem);
        self.findings.faulty.push(path.to_vec());
    }

    fn key_name(&self, path: &[Step]) -> Option<String> {
        (!path.is_empty()).then(|| display_path(self.root, path))
    }

    /// `doc` is the description of the key whose value this is; it becomes the help of a wrong type.
    fn node(&mut self, node: &Node, shape: &Shape, doc: &str, path: &mut Vec<Step>) {
        match (&node.value, shape) {
            (_, Shape::Any) | (Value::Bool(_), Shape::Bool) | (Value::Text(_), Shape::Text) => {}
            (Value::Integer(number), Shape::Integer(bounds)) if bounds.contain(*number as f64) => {}
            (Value::Integer(number), Shape::Number(bounds)) if bounds.contain(*number as f64) => {}
            (Value::Float(number), Shape::Number(bounds)) if number.is_finite() && bounds.contain(*number) => {}
            (Value::Text(text), Shape::Word(words)) => self.word(node, text, words, path),
            (Value::List(items), Shape::List { item, length }) if length.is_none_or(|n| items.len() as u64 == n) => {
                for (index, element) in items.iter().enumerate() {
                    path.push(Step::Index(index));
                    self.node(element, item, doc, path);
                    path.pop();
                }
            }
            (Value::Table(entries), Shape::Table(keys)) => self.table(node, entries, keys, path),
            (Value::Table(entries), Shape::Names(each)) => {
                for entry in entries {
                    path.push(Step::Key(entry.name.clone()));
                    self.node(&entry.node, each, doc, path);
                    path.pop();
                }
            }
            _ => self.wrong_type(node, shape, doc, path),
        }
    }

    fn word(&mut self, node: &Node, text: &str, words: &[String], path: &[Step]) {
        if words.iter().any(|word| word == text) {
            return;
        }
        let key = self.key_name(path);
        let message = format!("\"{text}\" is not a value of `{}`", last_key(path));
        let help = match nearest(text, words.iter().map(String::as_str)) {
            Some(word) => format!("did you mean \"{word}\"? It is one of {}", quoted_list(words)),
            None => format!("it is one of {}", quoted_list(words)),
        };
        self.report(path, Problem::error(&node.origin, key, message).with_help(help));
    }

    fn wrong_type(&mut self, node: &Node, shape: &Shape, doc: &str, path: &[Step]) {
        let found = match &node.value {
            Value::Integer(_) | Value::Float(_) | Value::Bool(_) => node.value.to_string(),
            Value::Text(text) => format!("the text \"{text}\""),
            Value::List(items) => format!("a list of {}", items.len()),
            other => other.describe().to_owned(),
        };
        let message = format!("`{}` is {found}, expected {}", last_key(path), shape.describe());
        let problem = Problem::error(&node.origin, self.key_name(path), message);
        let problem = if doc.is_empty() { problem } else { problem.with_help(doc) };
        self.report(path, problem);
    }

    fn table(&mut self, node: &Node, entries: &[Entry], keys: &[Key], path: &mut Vec<Step>) {
        for entry in entries {
            path.push(Step::Key(entry.name.clone()));
            match keys.iter().find(|key| key.name == entry.name) {
                Some(key) => self.node(&entry.node, &key.shape, &key.doc, path),
                None => self.unknown_key(entry, keys, path),
            }
            path.pop();
        }
        let missing = keys.iter().filter(|key| key.required && !entries.iter().any(|entry| entry.name == key.name));
        for key in missing {
            let message = format!("{} lacks `{}`", section_name(path), key.name);
            let expected = format!("add `{}`, {}: {}", key.name, key.shape.describe(), key.doc);
            self.report(path, Problem::error(&node.origin, self.key_name(path), message).with_help(expected));
        }
    }

    fn unknown_key(&mut self, entry: &Entry, keys: &[Key], path: &[Step]) {
        let section = section_name(path.split_last().map_or(&[][..], |(_, outer)| outer));
        let message = format!("`{}` is not a key of {section}", entry.name);
        let help = unknown_key_help(&entry.name, keys, &section);
        self.report(path, Problem::error(&entry.origin, self.key_name(path), message).with_help(help));
    }
}

/// The remedy for an unknown key: the nearest known one, or all of them.
pub(super) fn unknown_key_help(written: &str, keys: &[Key], section: &str) -> String {
    let names = || keys.iter().map(|key| key.name.as_str());
    match nearest(written, names()) {
        Some(name) => format!("did you mean `{name}`?"),
        None if keys.is_empty() => format!("{section} has no keys in this version: leave it empty"),
        None => format!("its keys are {}", names().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")),
    }
}

/// What a table is called: `the config`, `[rig]`, `[[lidar]]`, or `intrinsics` for a table inside one.
pub(super) fn section_name(path: &[Step]) -> String {
    match path {
        [] => "the config".to_owned(),
        [Step::Key(section)] => format!("[{section}]"),
        [Step::Key(list), Step::Index(_)] => format!("[[{list}]]"),
        _ => format!("`{}`", last_key(path)),
    }
}

/// The innermost key of a path.
fn last_key(path: &[Step]) -> &str {
    let key = path.iter().rev().find_map(|step| match step {
        Step::Key(name) => Some(name.as_str()),
        Step::Index(_) => None,
    });
    key.unwrap_or("the config")
}
