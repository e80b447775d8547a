//! The effective config: every key, its value, and the layer that set it.

use std::fmt::Write;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Layer;
use super::origin::Origin;
use super::raw::RawConfig;
use super::shape::{Key, Shape};
use super::tree::{Node, Step, Value, display_path};

/// The effective config, for machines.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled config show --json")]
pub struct ShowReport {
    /// Every key in the order of `config/rig.toml`.
    pub keys: Vec<KeyReport>,
}

/// One key of the effective config.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KeyReport {
    /// The key as `--set` names it, e.g. `lidar.front.port`.
    pub key: String,
    /// Its value; null: not set.
    pub value: serde_json::Value,
    /// The layer that set it.
    pub layer: Layer,
    /// The file, or the `--set` argument; null for a built-in default.
    pub source: Option<String>,
    /// Line in the file, from 1; null unless a file set it.
    pub line: Option<usize>,
}

/// The effective config key by key.
pub fn report(tree: &Node) -> ShowReport {
    let keys = lines(tree).into_iter().filter_map(|line| match line {
        Line::Header(_) => None,
        Line::Key { path, node, .. } => Some(key_report(tree, &path, node)),
    });
    ShowReport { keys: keys.collect() }
}

fn key_report(tree: &Node, path: &[Step], node: Option<&Node>) -> KeyReport {
    let (layer, source, line) = match node.map(|node| &node.origin) {
        None | Some(Origin::Default) => (Layer::Default, None, None),
        Some(Origin::Text { source, .. }) if source.layer == Layer::Set => {
            (Layer::Set, Some(source.text.clone()), None)
        }
        Some(Origin::Text { source, span }) => {
            (source.layer, Some(source.name.clone()), Some(source.line_column(span.start).0))
        }
    };
    let value = node.map_or(serde_json::Value::Null, Node::to_json);
    KeyReport { key: display_path(tree, path), value, layer, source, line }
}

/// The effective config as TOML that can be loaded again; with `origins`, each line says who set it.
pub fn text(tree: &Node, origins: bool) -> String {
    let lines: Vec<(String, Option<String>)> = lines(tree).iter().map(Line::render).collect();
    let width = lines.iter().filter(|(_, origin)| origin.is_some()).map(|(text, _)| text.chars().count()).max();
    let width = width.unwrap_or(0);
    let mut out = String::new();
    for (text, origin) in lines {
        if text.starts_with('[') {
            out.push('\n');
        }
        let written = match origin.filter(|_| origins) {
            Some(origin) => writeln!(out, "{text:width$}  # {origin}"),
            None => writeln!(out, "{text}"),
        };
        // Writing to a String does not fail.
        written.unwrap_or_default();
    }
    out
}

/// A line of the shown config.
enum Line<'a> {
    /// `[rig]` or `[[lidar]]`.
    Header(String),
    /// A key; `node` is `None` where it is not set.
    Key { path: Vec<Step>, name: String, node: Option<&'a Node> },
}

impl Line<'_> {
    fn render(&self) -> (String, Option<String>) {
        match self {
            Self::Header(header) => (header.clone(), None),
            Self::Key { name, node: Some(node), .. } => {
                (format!("{name} = {}", node.value), Some(node.origin.to_string()))
            }
            Self::Key { name, node: None, .. } => (format!("# {name} is not set"), Some("default".to_owned())),
        }
    }
}

fn lines(tree: &Node) -> Vec<Line<'_>> {
    let shape = Shape::of(&schemars::schema_for!(RawConfig));
    let mut top = Vec::new();
    let mut sections = Vec::new();
    for key in shape.keys() {
        let path = vec![Step::Key(key.name.clone())];
        let node = tree.at(&path);
        match (node.map(|node| &node.value), &key.shape) {
            (Some(Value::List(elements)), Shape::List { item, .. }) if !elements.is_empty() => {
                for (index, element) in elements.iter().enumerate() {
                    sections.push(Line::Header(format!("[[{}]]", key.name)));
                    let mut path = path.clone();
                    path.push(Step::Index(index));
                    table(element, item.keys(), &path, "", &mut sections);
                }
            }
            (Some(Value::Table(_)), Shape::Table(keys)) => {
                if let Some(node) = node.filter(|_| !keys.is_empty()) {
                    sections.push(Line::Header(format!("[{}]", key.name)));
                    table(node, keys, &path, "", &mut sections);
                }
            }
            // TOML wants what is not a section before the first one: here empty lists, and sections not set.
            _ => top.push(Line::Key { path, name: key.name.clone(), node }),
        }
    }
    top.append(&mut sections);
    top
}

/// The keys of a table; tables inside it as dotted keys, so that each leaf has its own origin.
fn table<'a>(node: &'a Node, keys: &[Key], path: &[Step], prefix: &str, lines: &mut Vec<Line<'a>>) {
    for key in keys {
        let mut path = path.to_vec();
        path.push(Step::Key(key.name.clone()));
        let name = format!("{prefix}{}", key.name);
        match node.entry(&key.name).map(|entry| &entry.node) {
            Some(inner) if !key.shape.keys().is_empty() => {
                table(inner, key.shape.keys(), &path, &format!("{name}."), lines);
            }
            node => lines.push(Line::Key { path, name, node }),
        }
    }
}
