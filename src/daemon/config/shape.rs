//! What a config may look like, read from the JSON Schema of its raw types.
//!
//! serde stops at the first mistake; a person wants to see all of them. So names and types are checked by walking the
//! file beside this shape, and serde only ever sees what has passed.

use serde_json::Value;

/// What may stand in one place.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Anything.
    Any,
    /// `true` or `false`.
    Bool,
    /// A whole number.
    Integer(Bounds),
    /// A finite number.
    Number(Bounds),
    /// Any text.
    Text,
    /// One of a few words.
    Word(Vec<String>),
    /// A list.
    List {
        /// What its elements look like.
        item: Box<Shape>,
        /// How many there must be; `None`: any number.
        length: Option<u64>,
    },
    /// A table with known keys.
    Table(Vec<Key>),
    /// A table whose keys are names the user chose, e.g. sensor ids.
    Names(Box<Shape>),
}

/// Limits of a number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bounds {
    /// Smallest value allowed.
    pub at_least: Option<f64>,
    /// The value must be larger than this.
    pub above: Option<f64>,
    /// Largest value allowed.
    pub at_most: Option<f64>,
}

impl Bounds {
    /// Whether a value lies within the limits.
    pub fn contain(&self, value: f64) -> bool {
        self.at_least.is_none_or(|limit| value >= limit)
            && self.above.is_none_or(|limit| value > limit)
            && self.at_most.is_none_or(|limit| value <= limit)
    }

    /// ` from 0 to 65535`, ` above 0`, or nothing.
    fn describe(&self) -> String {
        match (self.at_least, self.above, self.at_most) {
            (Some(low), _, Some(high)) => format!(" from {low} to {high}"),
            (Some(low), _, None) => format!(" of at least {low}"),
            (None, Some(low), Some(high)) => format!(" above {low} and up to {high}"),
            (None, Some(low), None) => format!(" above {low}"),
            (None, None, Some(high)) => format!(" up to {high}"),
            (None, None, None) => String::new(),
        }
    }
}

/// One key of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// Its name.
    pub name: String,
    /// What it is, from the field's doc comment.
    pub doc: String,
    /// What may stand there.
    pub shape: Shape,
    /// What stands there when nothing was written; `None`: nothing.
    pub default: Option<Value>,
    /// Whether leaving it out is an error.
    pub required: bool,
}

impl Shape {
    /// The shape a type's JSON Schema describes. A construct unknown here becomes [`Shape::Any`], which leaves the
    /// check to serde.
    pub fn of(schema: &schemars::Schema) -> Self {
        let root = schema.as_value();
        Self::read(root, root.get("$defs").unwrap_or(&Value::Null))
    }

    fn read(schema: &Value, definitions: &Value) -> Self {
        if let Some(reference) = schema.get("$ref").and_then(Value::as_str) {
            let name = reference.trim_start_matches("#/$defs/");
            return definitions.get(name).map_or(Self::Any, |definition| Self::read(definition, definitions));
        }
        // Option<Table> is `anyOf [table, null]`: TOML has no null, so what remains is the table.
        if let Some(choices) = schema.get("anyOf").and_then(Value::as_array) {
            let mut real = choices.iter().filter(|choice| choice.get("type").and_then(Value::as_str) != Some("null"));
            return match (real.next(), real.next()) {
                (Some(only), None) => Self::read(only, definitions),
                _ => Self::Any,
            };
        }
        if let Some(words) = words(schema) {
            return Self::Word(words);
        }
        match type_name(schema) {
            Some("boolean") => Self::Bool,
            Some("integer") => Self::Integer(bounds(schema)),
            Some("number") => Self::Number(bounds(schema)),
            Some("string") => Self::Text,
            Some("array") => Self::List {
                item: Box::new(schema.get("items").map_or(Self::Any, |items| Self::read(items, definitions))),
                length: schema
                    .get("minItems")
                    .filter(|min| schema.get("maxItems") == Some(*min))
                    .and_then(Value::as_u64),
            },
            Some("object") => Self::read_table(schema, definitions),
            _ => Self::Any,
        }
    }

    fn read_table(schema: &Value, definitions: &Value) -> Self {
        match schema.get("additionalProperties") {
            Some(Value::Bool(false)) => {}
            Some(others @ Value::Object(_)) => return Self::Names(Box::new(Self::read(others, definitions))),
            _ => return Self::Any,
        }
        let required = schema.get("required").and_then(Value::as_array);
        let properties = schema.get("properties").and_then(Value::as_object);
        let keys = properties.into_iter().flatten().map(|(name, property)| Key {
            name: name.clone(),
            doc: property.get("description").and_then(Value::as_str).unwrap_or_default().to_owned(),
            shape: Self::read(property, definitions),
            default: property.get("default").filter(|default| !default.is_null()).cloned(),
            required: required.is_some_and(|names| names.iter().any(|n| n == name)),
        });
        Self::Table(keys.collect())
    }

    /// The keys of a table, none for anything else.
    pub fn keys(&self) -> &[Key] {
        match self {
            Self::Table(keys) => keys,
            _ => &[],
        }
    }

    /// The key of a table by its name.
    pub fn key(&self, name: &str) -> Option<&Key> {
        self.keys().iter().find(|key| key.name == name)
    }

    /// The key by which people name the elements of a list of tables: `id` or `name`.
    pub fn naming_key(&self) -> Option<&str> {
        ["id", "name"].into_iter().find(|name| self.key(name).is_some())
    }

    /// What is expected, for a message: `a whole number from 0 to 65535`.
    pub fn describe(&self) -> String {
        match self {
            Self::Any => "a value".to_owned(),
            Self::Bool => "true or false".to_owned(),
            Self::Integer(bounds) => format!("a whole number{}", bounds.describe()),
            Self::Number(bounds) => format!("a finite number{}", bounds.describe()),
            Self::Text => "a text in quotes".to_owned(),
            Self::Word(words) => format!("one of {}", quoted_list(words)),
            Self::List { item, length: Some(n) } => match **item {
                Self::Number(_) => format!("a list of {n} numbers"),
                _ => format!("a list of {n} values"),
            },
            Self::List { item, length: None } => match **item {
                Self::Table(_) => "a list of tables".to_owned(),
                _ => "a list".to_owned(),
            },
            Self::Table(_) | Self::Names(_) => "a table".to_owned(),
        }
    }
}

/// `"auto", "on", "off"`.
pub(super) fn quoted_list(words: &[String]) -> String {
    words.iter().map(|word| format!("\"{word}\"")).collect::<Vec<_>>().join(", ")
}

/// The first type a schema names besides null.
fn type_name(schema: &Value) -> Option<&str> {
    match schema.get("type")? {
        Value::String(name) => Some(name),
        Value::Array(names) => names.iter().filter_map(Value::as_str).find(|name| *name != "null"),
        _ => None,
    }
}

/// The words of an enum: `enum [..]`, or `oneOf` of constants when each has a description.
fn words(schema: &Value) -> Option<Vec<String>> {
    if let Some(list) = schema.get("enum").and_then(Value::as_array) {
        return list.iter().map(|word| word.as_str().map(str::to_owned)).collect();
    }
    let choices = schema.get("oneOf")?.as_array()?;
    let words = choices.iter().map(|choice| match choice.get("const") {
        Some(Value::String(word)) => Some(vec![word.clone()]),
        _ => words(choice),
    });
    Some(words.collect::<Option<Vec<_>>>()?.concat())
}

fn bounds(schema: &Value) -> Bounds {
    let number = |name: &str| schema.get(name).and_then(Value::as_f64);
    Bounds { at_least: number("minimum"), above: number("exclusiveMinimum"), at_most: number("maximum") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::calibration::RawCalibration;
    use crate::config::raw::RawConfig;

    /// The places of a shape that nothing checks but serde, as dotted keys.
    fn unchecked(shape: &Shape, path: &str, found: &mut Vec<String>) {
        match shape {
            Shape::Any => found.push(path.to_owned()),
            Shape::List { item, .. } | Shape::Names(item) => unchecked(item, path, found),
            Shape::Table(keys) => keys.iter().for_each(|k| unchecked(&k.shape, &format!("{path}.{}", k.name), found)),
            _ => {}
        }
    }

    #[test]
    fn every_construct_of_the_schemas_is_understood() {
        let mut found = Vec::new();
        unchecked(&Shape::of(&schemars::schema_for!(RawConfig)), "rig", &mut found);
        unchecked(&Shape::of(&schemars::schema_for!(RawCalibration)), "calibration", &mut found);
        assert_eq!(found, ["calibration.provenance"], "only the provenance is free");
    }

    #[test]
    fn shapes_follow_the_raw_types() {
        let shape = Shape::of(&schemars::schema_for!(RawConfig));
        let Some(Shape::List { item: lidar, length: None }) = shape.key("lidar").map(|key| key.shape.clone()) else {
            panic!("lidar is a list")
        };
        let port = lidar.key("port").expect("lidar.port");
        assert_eq!(port.shape.describe(), "a whole number from 0 to 65535");
        assert_eq!(port.default, Some(2368.into()));
        assert_eq!(lidar.key("source").expect("lidar.source").shape, Shape::Text);
        assert_eq!(lidar.key("source").expect("lidar.source").default, None);
        let offsets = lidar.key("vertical_offsets").expect("lidar.vertical_offsets");
        assert_eq!(offsets.shape.describe(), r#"one of "auto", "on", "off""#);
        let turntable = shape.key("turntable").expect("turntable");
        assert!(turntable.shape.key("port").expect("turntable.port").required);
        assert!(!turntable.required);
    }

    #[test]
    fn bounds_are_closed_unless_they_say_above() {
        let port = Bounds { at_least: Some(0.0), above: None, at_most: Some(65535.0) };
        assert!(port.contain(0.0) && port.contain(65535.0) && !port.contain(65536.0) && !port.contain(-1.0));
        let focal = Bounds { above: Some(0.0), ..Bounds::default() };
        assert!(!focal.contain(0.0) && focal.contain(1e-9));
    }
}
