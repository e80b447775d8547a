//! A config as a tree whose every value remembers where it was written.

use std::fmt;
use std::sync::Arc;

use serde_json::{Number, Value as Json};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::origin::{Origin, SourceText};
use super::problem::Problem;
use super::shape::{Key, Shape};

/// A value and where it was written.
#[derive(Clone, Debug)]
pub struct Node {
    /// Where.
    pub origin: Origin,
    /// What.
    pub value: Value,
}

/// A value as TOML knows it.
#[derive(Clone, Debug)]
pub enum Value {
    /// `true` or `false`.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number, possibly not finite.
    Float(f64),
    /// A text.
    Text(String),
    /// A date or time as written: no key takes one.
    Date(String),
    /// A list.
    List(Vec<Node>),
    /// A table in the order it was written.
    Table(Vec<Entry>),
}

/// A key of a table and its value.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The key's name.
    pub name: String,
    /// Where the key was written (its value's place is the node's).
    pub origin: Origin,
    /// The value.
    pub node: Node,
}

/// One step from a table or list to a value inside it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Into a table.
    Key(String),
    /// Into a list.
    Index(usize),
}

/// The way from the root to a value.
pub type Path = [Step];

impl Node {
    /// An empty table that nobody wrote.
    pub fn empty() -> Self {
        Self { origin: Origin::Default, value: Value::Table(Vec::new()) }
    }

    /// Reads a whole TOML file. Problems: every syntax error the parser finds, and numbers beyond 64 bits.
    pub fn parse(source: &Arc<SourceText>, problems: &mut Vec<Problem>) -> Self {
        let (table, errors) = DeTable::parse_recoverable(&source.text);
        for error in errors {
            let origin = Origin::new(source, error.span().unwrap_or(0..0));
            problems.push(Problem::error(&origin, None, format!("this is not TOML: {}", error.message())));
        }
        let span = table.span();
        let value = Value::from_table(table.into_inner(), source, 0, problems);
        Self { origin: Origin::new(source, span), value }
    }

    /// A built-in default.
    pub fn from_default(json: &Json) -> Self {
        let value = match json {
            Json::Null => Value::Table(Vec::new()),
            Json::Bool(flag) => Value::Bool(*flag),
            Json::Number(number) => {
                number.as_i64().map_or_else(|| Value::Float(number.as_f64().unwrap_or(f64::NAN)), Value::Integer)
            }
            Json::String(text) => Value::Text(text.clone()),
            Json::Array(items) => Value::List(items.iter().map(Self::from_default).collect()),
            // null stands for "not set": there is no such thing in TOML, the key is left out.
            Json::Object(map) => {
                Value::Table(map.iter().filter(|(_, v)| !v.is_null()).map(Entry::default_of).collect())
            }
        };
        Self { origin: Origin::Default, value }
    }

    /// The entry of a table by its name; `None` if there is none, or this is no table.
    pub fn entry(&self, name: &str) -> Option<&Entry> {
        let Value::Table(entries) = &self.value else { return None };
        entries.iter().find(|entry| entry.name == name)
    }

    /// The value at a path; `None` where the path leaves the tree.
    pub fn at(&self, path: &Path) -> Option<&Node> {
        let Some((first, rest)) = path.split_first() else { return Some(self) };
        match (first, &self.value) {
            (Step::Key(name), _) => self.entry(name)?.node.at(rest),
            (Step::Index(index), Value::List(items)) => items.get(*index)?.at(rest),
            _ => None,
        }
    }

    /// The text at a path, if there is one.
    pub fn text_at(&self, path: &Path) -> Option<&str> {
        match &self.at(path)?.value {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Where the value at a path was written. A value nobody wrote is blamed on what it is part of.
    pub fn origin_at(&self, path: &Path) -> &Origin {
        let found = (0..=path.len()).rev().filter_map(|n| self.at(path.get(..n)?)).map(|node| &node.origin);
        found.into_iter().find(|origin| !matches!(origin, Origin::Default)).unwrap_or(&self.origin)
    }

    /// Takes a value out of the tree: the innermost table entry on the path, since a list with a hole is another list.
    pub fn remove(&mut self, path: &Path) {
        let Some(last_key) = path.iter().rposition(|step| matches!(step, Step::Key(_))) else {
            self.value = Value::Table(Vec::new());
            return;
        };
        let (Some(outer), Some(Step::Key(name))) = (path.get(..last_key), path.get(last_key)) else { return };
        if let Some(Value::Table(entries)) = self.at_mut(outer).map(|node| &mut node.value) {
            entries.retain(|entry| entry.name != *name);
        }
    }

    fn at_mut(&mut self, path: &Path) -> Option<&mut Node> {
        let Some((first, rest)) = path.split_first() else { return Some(self) };
        match (first, &mut self.value) {
            (Step::Key(name), Value::Table(entries)) => {
                entries.iter_mut().find(|entry| entry.name == *name)?.node.at_mut(rest)
            }
            (Step::Index(index), Value::List(items)) => items.get_mut(*index)?.at_mut(rest),
            _ => None,
        }
    }

    /// Lays a higher layer over this one: tables are merged key by key, everything else is replaced.
    pub fn lay_over(&mut self, upper: Node) {
        match (&mut self.value, upper.value) {
            (Value::Table(entries), Value::Table(uppers)) => {
                for entry in uppers {
                    match entries.iter_mut().find(|existing| existing.name == entry.name) {
                        Some(existing) => {
                            existing.origin = entry.origin;
                            existing.node.lay_over(entry.node);
                        }
                        None => entries.push(entry),
                    }
                }
                if matches!(self.origin, Origin::Default) {
                    self.origin = upper.origin;
                }
            }
            (_, value) => *self = Node { origin: upper.origin, value },
        }
    }

    /// Adds the defaults of every key that nobody wrote. What has the wrong type is left as it is.
    pub fn fill_defaults(&mut self, shape: &Shape) {
        match (&mut self.value, shape) {
            (Value::Table(entries), Shape::Table(keys)) => {
                for Key { name, default, .. } in keys {
                    let Some(default) = default else { continue };
                    if !entries.iter().any(|entry| entry.name == *name) {
                        entries.push(Entry::default_of((name, default)));
                    }
                }
                for entry in entries {
                    if let Some(key) = shape.key(&entry.name) {
                        entry.node.fill_defaults(&key.shape);
                    }
                }
            }
            (Value::List(items), Shape::List { item, .. }) => items.iter_mut().for_each(|n| n.fill_defaults(item)),
            _ => {}
        }
    }

    /// The value without its origins. Numbers that JSON cannot hold become null; no checked tree has one.
    pub fn to_json(&self) -> Json {
        match &self.value {
            Value::Bool(flag) => Json::Bool(*flag),
            Value::Integer(number) => Json::from(*number),
            Value::Float(number) => Number::from_f64(*number).map_or(Json::Null, Json::Number),
            Value::Text(text) | Value::Date(text) => Json::from(text.as_str()),
            Value::List(items) => items.iter().map(Self::to_json).collect(),
            Value::Table(entries) => {
                Json::Object(entries.iter().map(|entry| (entry.name.clone(), entry.node.to_json())).collect())
            }
        }
    }
}

impl Entry {
    fn default_of((name, value): (&String, &Json)) -> Self {
        Self { name: name.clone(), origin: Origin::Default, node: Node::from_default(value) }
    }
}

impl Value {
    /// What kind of value it is, for a message.
    pub fn describe(&self) -> &'static str {
        match self {
            Self::Bool(_) => "true or false",
            Self::Integer(_) => "a whole number",
            Self::Float(_) => "a number",
            Self::Text(_) => "a text",
            Self::Date(_) => "a date",
            Self::List(_) => "a list",
            Self::Table(_) => "a table",
        }
    }

    /// Reads a value. `shift` is where its text starts in the source (0 for files, behind `=` for `--set`).
    pub(super) fn read(
        value: Spanned<DeValue<'_>>,
        source: &Arc<SourceText>,
        shift: usize,
        problems: &mut Vec<Problem>,
    ) -> Node {
        let span = value.span();
        let origin = Origin::new(source, span.start + shift..span.end + shift);
        let value = match value.into_inner() {
            DeValue::Boolean(flag) => Self::Bool(flag),
            DeValue::String(text) => Self::Text(text.into_owned()),
            DeValue::Datetime(date) => Self::Date(date.to_string()),
            DeValue::Float(number) => Self::Float(number.as_str().parse().unwrap_or(f64::NAN)),
            DeValue::Integer(number) => match i64::from_str_radix(number.as_str(), number.radix()) {
                Ok(number) => Self::Integer(number),
                Err(_) => {
                    let message = format!("{number} does not fit in 64 bits");
                    problems.push(Problem::error(&origin, None, message));
                    Self::Integer(0)
                }
            },
            DeValue::Array(items) => {
                Self::List(items.into_iter().map(|item| Self::read(item, source, shift, problems)).collect())
            }
            DeValue::Table(table) => Self::from_table(table, source, shift, problems),
        };
        Node { origin, value }
    }

    fn from_table(table: DeTable<'_>, source: &Arc<SourceText>, shift: usize, problems: &mut Vec<Problem>) -> Self {
        let entries = table.into_iter().map(|(key, value)| {
            let span = key.span();
            Entry {
                name: key.into_inner().into_owned(),
                origin: Origin::new(source, span.start + shift..span.end + shift),
                node: Self::read(value, source, shift, problems),
            }
        });
        Self::Table(entries.collect())
    }
}

/// As TOML on one line.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(flag) => write!(f, "{flag}"),
            Self::Integer(number) => write!(f, "{number}"),
            Self::Float(number) => write!(f, "{number:?}"),
            Self::Text(text) => write!(f, "{}", toml::Value::from(text.as_str())),
            Self::Date(text) => f.write_str(text),
            Self::List(items) => {
                f.write_str("[")?;
                for (index, item) in items.iter().enumerate() {
                    let comma = if index == 0 { "" } else { ", " };
                    write!(f, "{comma}{}", item.value)?;
                }
                f.write_str("]")
            }
            Self::Table(entries) => {
                f.write_str("{")?;
                for (index, entry) in entries.iter().enumerate() {
                    let comma = if index == 0 { " " } else { ", " };
                    write!(f, "{comma}{} = {}", entry.name, entry.node.value)?;
                }
                f.write_str(" }")
            }
        }
    }
}

/// A path as `--set` would name it: elements of a list of tables by their `id` or `name`, others by their number.
pub fn display_path(root: &Node, path: &Path) -> String {
    let mut words: Vec<String> = Vec::new();
    for (depth, step) in path.iter().enumerate() {
        match step {
            Step::Key(name) => words.push(name.clone()),
            Step::Index(index) => {
                let element = path.get(..=depth).and_then(|upto| root.at(upto));
                let name = ["id", "name"].into_iter().find_map(|key| element?.text_at(&[Step::Key(key.to_owned())]));
                match name.filter(|name| !name.is_empty()) {
                    Some(name) => words.push(name.to_owned()),
                    None => words.push(format!("[{index}]")),
                }
            }
        }
    }
    words.join(".")
}

/// `[Step::Key("lidar"), Step::Index(1), Step::Key("port")]` from `("lidar", 1, "port")`.
pub fn element_path(list: &str, index: usize, keys: &[&str]) -> Vec<Step> {
    let mut path = vec![Step::Key(list.to_owned()), Step::Index(index)];
    path.extend(keys.iter().map(|key| Step::Key((*key).to_owned())));
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Layer;

    fn parse(text: &str) -> (Node, Vec<Problem>) {
        let mut problems = Vec::new();
        let source = SourceText::file(Layer::File, "rig.toml".as_ref(), text.to_owned());
        (Node::parse(&source, &mut problems), problems)
    }

    #[test]
    fn values_remember_their_lines() {
        let (tree, problems) = parse("[rig]\nname = 'a'\n[[lidar]]\nport = 0x10\n[[lidar]]\nport = 2_000\n");
        assert!(problems.is_empty());
        let second = element_path("lidar", 1, &["port"]);
        assert_eq!(tree.origin_at(&second).to_string(), "rig.toml:6");
        assert_eq!(tree.at(&second).expect("there").value.to_string(), "2000");
        assert_eq!(tree.at(&element_path("lidar", 0, &["port"])).expect("there").value.to_string(), "16");
        // Nobody wrote lidar[1].source: its table is at fault.
        assert_eq!(tree.origin_at(&element_path("lidar", 1, &["source"])).to_string(), "rig.toml:5");
    }

    #[test]
    fn every_syntax_error_is_a_problem() {
        let (_, problems) = parse("a = \nb = 1\nc = 'x\n");
        let lines: Vec<_> = problems.iter().map(|problem| problem.origin.to_string()).collect();
        assert_eq!(lines, ["rig.toml:1", "rig.toml:3"], "{problems:?}");
        let (_, problems) = parse("a = 99999999999999999999\n");
        assert_eq!(problems[0].message, "99999999999999999999 does not fit in 64 bits");
    }

    #[test]
    fn a_layer_overrides_only_the_keys_it_names() {
        let (mut lower, _) = parse("[t]\nx = 1\ny = 2\nl = [1, 2]\n");
        let (upper, _) = parse("t = { y = 3, l = [9] }\n");
        lower.lay_over(upper);
        assert_eq!(lower.value.to_string(), "{ t = { l = [9], x = 1, y = 3 } }");
    }

    #[test]
    fn a_bad_element_takes_its_whole_list_out() {
        let (mut tree, _) = parse("p = [1, 'x', 3]\nq = 1\n");
        tree.remove(&[Step::Key("p".to_owned()), Step::Index(1)]);
        assert_eq!(tree.value.to_string(), "{ q = 1 }");
    }
}
