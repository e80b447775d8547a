//! `--set section.key=value`: one key, or the same key of every sensor, on the command line.

use std::ops::Range;
use std::sync::Arc;

use toml::de::DeValue;

use super::names::{section_name, unknown_key_help};
use super::origin::{Origin, SourceText};
use super::problem::Problem;
use super::shape::Shape;
use super::tree::{Entry, Node, Step, Value};

/// One `--set` argument, taken apart.
pub struct Setting {
    source: Arc<SourceText>,
    /// The words of the key with their byte ranges in the argument.
    words: Vec<(String, Range<usize>)>,
    /// Byte range of the value in the argument.
    value: Range<usize>,
}

impl Setting {
    /// Takes `section.key=value` apart.
    ///
    /// # Errors
    /// When there is no `=`, or a word of the key is empty.
    pub fn parse(argument: &str) -> Result<Self, Box<Problem>> {
        let source = SourceText::set(argument);
        let whole = Origin::new(&source, 0..argument.len());
        let refused = |message: String| {
            let example = "write section.key=value, e.g. --set lidar.vertical_offsets=off";
            Box::new(Problem::error(&whole, None, message).with_help(example))
        };
        let Some((key, value)) = argument.split_once('=') else {
            return Err(refused(format!("`{argument}` sets nothing: there is no `=`")));
        };
        let mut words = Vec::new();
        let mut start = 0;
        for word in key.split('.') {
            let name = word.trim();
            if name.is_empty() {
                return Err(refused(format!("`{argument}` names no key: a word of `{key}` is empty")));
            }
            words.push((name.to_owned(), start..start + word.len()));
            start += word.len() + 1;
        }
        // Blanks around the value belong to the shell's quoting, not to the value.
        let value_start = key.len() + 1 + (value.len() - value.trim_start().len());
        let value = value_start..value_start + value.trim().len();
        Ok(Self { source, words, value })
    }

    /// Whether it decides which calibration applies: the calibration file's name, or a sensor's id.
    pub fn precedes_calibration(&self) -> bool {
        let mut words = self.words.iter().map(|(word, _)| word.as_str());
        words.clone().eq(["rig", "calibration"]) || words.next_back() == Some("id")
    }

    /// Writes the value into the tree: everywhere the key leads to, nowhere else.
    pub fn apply(&self, root: &mut Node, shape: &Shape, problems: &mut Vec<Problem>) {
        self.descend(&self.words, root, shape, &mut Vec::new(), problems);
    }

    fn descend(
        &self,
        words: &[(String, Range<usize>)],
        node: &mut Node,
        shape: &Shape,
        path: &mut Vec<Step>,
        problems: &mut Vec<Problem>,
    ) {
        let Some(((word, span), rest)) = words.split_first() else {
            let value = self.read_value(shape, problems);
            node.lay_over(value);
            return;
        };
        let origin = Origin::new(&self.source, span.clone());
        match shape {
            Shape::Table(keys) => {
                let Some(key) = shape.key(word) else {
                    let section = section_name(path);
                    let message = format!("`{word}` is not a key of {section}");
                    let help = unknown_key_help(word, keys, &section);
                    problems.push(Problem::error(&origin, None, message).with_help(help));
                    return;
                };
                // A value of the wrong type stays as it is: the check of names and types reports it.
                let Value::Table(entries) = &mut node.value else { return };
                path.push(Step::Key(word.clone()));
                let entry = entry_or_new(entries, word, &origin);
                self.descend(rest, &mut entry.node, &key.shape, path, problems);
                path.pop();
            }
            Shape::List { item, .. } if !item.keys().is_empty() => {
                let Value::List(elements) = &mut node.value else { return };
                self.set_in_elements(words, elements, item, &origin, path, problems);
            }
            _ => {
                let message = format!("{} is a value: it has no key `{word}`", section_name(path));
                let help = format!("it is {}", shape.describe());
                problems.push(Problem::error(&origin, None, message).with_help(help));
            }
        }
    }

    /// `lidar.KEY`: every element. `lidar.ID.KEY`: the one of that id. An id is never the name of a key (a rule of
    /// the config), so the two cannot be confused.
    fn set_in_elements(
        &self,
        words: &[(String, Range<usize>)],
        elements: &mut [Node],
        item: &Shape,
        origin: &Origin,
        path: &mut Vec<Step>,
        problems: &mut Vec<Problem>,
    ) {
        let Some(((word, _), rest)) = words.split_first() else { return };
        let list = path.iter().rev().find_map(|step| if let Step::Key(name) = step { Some(name) } else { None });
        let list = list.cloned().unwrap_or_default();
        if elements.is_empty() {
            let message = format!("there is no [[{list}]] to set `{word}` in");
            let help = format!("add a [[{list}]] to the config file");
            problems.push(Problem::error(origin, None, message).with_help(help));
            return;
        }
        if item.key(word).is_some() {
            for (index, element) in elements.iter_mut().enumerate() {
                path.push(Step::Index(index));
                let mut found = Vec::new();
                self.descend(words, element, item, path, &mut found);
                path.pop();
                // The same argument makes the same mistake in every element: say it once.
                if !found.is_empty() {
                    problems.append(&mut found);
                    return;
                }
            }
            return;
        }
        let naming = item.naming_key().unwrap_or("id");
        let name_of = |node: &Node| node.text_at(&[Step::Key(naming.to_owned())]).map(str::to_owned);
        let names: Vec<String> = elements.iter().filter_map(name_of).collect();
        let chosen = elements.iter_mut().enumerate().find(|(_, element)| name_of(element).as_deref() == Some(word));
        match chosen {
            Some((index, element)) => {
                path.push(Step::Index(index));
                self.descend(rest, element, item, path, problems);
                path.pop();
            }
            None => {
                let message = format!("`{word}` is neither a key of [[{list}]] nor the {naming} of one");
                let known = names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
                let near = super::suggest::nearest(
                    word,
                    item.keys().iter().map(|k| k.name.as_str()).chain(names.iter().map(String::as_str)),
                );
                let help = match near {
                    Some(name) => format!("did you mean `{name}`? The {naming}s are {known}"),
                    None => format!("the {naming}s are {known}"),
                };
                problems.push(Problem::error(origin, None, message).with_help(help));
            }
        }
    }

    /// The value: TOML if it is, else the bare word as a text. Where the key wants a text, anything unquoted is one:
    /// `--set kinect.serial=0123` needs no quotes around the number.
    fn read_value(&self, shape: &Shape, problems: &mut Vec<Problem>) -> Node {
        let text = self.source.text.get(self.value.clone()).unwrap_or_default();
        let origin = Origin::new(&self.source, self.value.clone());
        let quoted = text.starts_with(['"', '\'']);
        let structured = text.starts_with(['[', '{']);
        let wants_text = matches!(shape, Shape::Text | Shape::Word(_));
        if text.is_empty() || (wants_text && !quoted && !structured) {
            return Node { origin, value: Value::Text(text.to_owned()) };
        }
        match DeValue::parse(text) {
            Ok(value) => Value::read(value, &self.source, self.value.start, problems),
            Err(error) if quoted || structured => {
                let span = error.span().unwrap_or(0..text.len());
                let place = Origin::new(&self.source, span.start + self.value.start..span.end + self.value.start);
                let message = format!("this value is not TOML: {}", error.message());
                problems.push(Problem::error(&place, None, message).with_help("quote texts inside lists and tables"));
                Node { origin, value: Value::Text(text.to_owned()) }
            }
            Err(_) => Node { origin, value: Value::Text(text.to_owned()) },
        }
    }
}

/// The entry of a table; a new empty table where there was none, so that `--set turntable.port=…` adds a turntable.
fn entry_or_new<'a>(entries: &'a mut Vec<Entry>, name: &str, origin: &Origin) -> &'a mut Entry {
    let position = entries.iter().position(|entry| entry.name == name).unwrap_or_else(|| {
        let node = Node { origin: origin.clone(), value: Value::Table(Vec::new()) };
        entries.push(Entry { name: name.to_owned(), origin: origin.clone(), node });
        entries.len() - 1
    });
    &mut entries[position]
}
