//! What a client asks for: one JSON object on a line.

use std::time::Duration;

use serde_json::Value;
use thiserror::Error;

use super::class::{Class, Classes};

/// The longest line a client may send, bytes: a subscription takes a hundred.
pub const REQUEST_BYTES: usize = 64 * 1024;

/// How deep the JSON of a request may nest.
pub const REQUEST_DEPTH: usize = 16;

/// The formats lines can be had in.
pub const FORMATS: [&str; 1] = ["json"];

/// The most lines of a class per second that `max_hz` may name; it is there to be a number at all.
const MAX_HZ: f64 = 1.0e6;

/// The fewest: one line in a thousand seconds.
const MIN_HZ: f64 = 0.001;

/// A request. A key that is left out changes nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Request {
    /// The classes to send, instead of those sent before.
    pub subscribe: Option<Classes>,
    /// The least time between two lines of a class that is thinned out; `Some(None)`: send every line.
    pub period: Option<Option<Duration>>,
}

/// Why a request was not carried out.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum RequestError {
    /// No JSON.
    #[error("this line is no JSON ({reason}): send one object per line, e.g. {EXAMPLE}")]
    Malformed {
        /// What the parser found, and where.
        reason: String,
    },
    /// JSON, but too deeply nested.
    #[error("this line nests deeper than {REQUEST_DEPTH} levels: send {EXAMPLE}")]
    TooDeep,
    /// The line is longer than [`REQUEST_BYTES`].
    #[error("this line is longer than {REQUEST_BYTES} bytes: send {EXAMPLE}")]
    TooLong,
    /// JSON, but no object.
    #[error("a request has to be an object, e.g. {EXAMPLE}")]
    NoObject,
    /// A key with a value it cannot have.
    #[error("\"{key}\" has to be {expected}")]
    BadValue {
        /// The key.
        key: &'static str,
        /// What it has to be.
        expected: &'static str,
    },
    /// A class that does not exist.
    #[error("there is no class {found:?}; there are {}", names())]
    UnknownClass {
        /// What was asked for, shortened.
        found: String,
    },
    /// A format that does not exist.
    #[error("there is no format {found:?}; there is {}", FORMATS.join(", "))]
    UnknownFormat {
        /// What was asked for, shortened.
        found: String,
    },
    /// More requests than [`super::limits::Limits::requests_per_s`].
    #[error("more than {limit} requests in a second: one is enough, it holds until the next")]
    TooMany {
        /// How many are allowed.
        limit: u32,
    },
}

const EXAMPLE: &str = r#"{"subscribe":["HEALTH"]}"#;

impl RequestError {
    /// The word for programs.
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Malformed { .. } => "malformed",
            Self::TooDeep => "too_deep",
            Self::TooLong => "too_long",
            Self::NoObject => "no_object",
            Self::BadValue { .. } => "bad_value",
            Self::UnknownClass { .. } => "unknown_class",
            Self::UnknownFormat { .. } => "unknown_format",
            Self::TooMany { .. } => "too_many_requests",
        }
    }

    /// Whether the connection ends: whoever sends this speaks another protocol, or floods.
    pub const fn closes(&self) -> bool {
        matches!(self, Self::Malformed { .. } | Self::TooDeep | Self::TooLong | Self::TooMany { .. })
    }

    /// What would have been understood in its place.
    pub fn supported(&self) -> Vec<&'static str> {
        match self {
            Self::UnknownClass { .. } => Class::ALL.iter().map(|class| class.name()).collect(),
            Self::UnknownFormat { .. } => FORMATS.to_vec(),
            _ => Vec::new(),
        }
    }
}

fn names() -> String {
    Class::ALL.map(Class::name).join(", ")
}

/// Reads a client's line, without its newline.
///
/// # Errors
/// [`RequestError`]; nothing of a request with an error is carried out.
pub fn parse(line: &[u8]) -> Result<Request, RequestError> {
    if line.len() > REQUEST_BYTES {
        return Err(RequestError::TooLong);
    }
    // The parser stops at 128 levels by itself.
    let value: Value =
        serde_json::from_slice(line).map_err(|error| RequestError::Malformed { reason: error.to_string() })?;
    if depth(&value) > REQUEST_DEPTH {
        return Err(RequestError::TooDeep);
    }
    let Value::Object(keys) = value else {
        return Err(RequestError::NoObject);
    };
    let mut request = Request::default();
    if let Some(value) = keys.get("subscribe") {
        request.subscribe = Some(classes(value)?);
    }
    if let Some(value) = keys.get("max_hz") {
        request.period = Some(period(value)?);
    }
    if let Some(value) = keys.get("format") {
        check_format(value)?;
    }
    Ok(request)
}

fn classes(value: &Value) -> Result<Classes, RequestError> {
    const EXPECTED: RequestError = RequestError::BadValue { key: "subscribe", expected: "a list of class names" };
    let list = value.as_array().ok_or(EXPECTED)?;
    list.iter()
        .map(|name| {
            let name = name.as_str().ok_or(EXPECTED)?;
            Class::of_name(name).ok_or_else(|| RequestError::UnknownClass { found: shortened(name) })
        })
        .collect()
}

fn period(value: &Value) -> Result<Option<Duration>, RequestError> {
    const EXPECTED: RequestError =
        RequestError::BadValue { key: "max_hz", expected: "a number from 0.001 to 1000000, or null for every line" };
    if value.is_null() {
        return Ok(None);
    }
    let hz = value.as_f64().filter(|hz| (MIN_HZ..=MAX_HZ).contains(hz)).ok_or(EXPECTED)?;
    Ok(Some(Duration::from_secs_f64(1.0 / hz)))
}

fn check_format(value: &Value) -> Result<(), RequestError> {
    let format = value.as_str().ok_or(RequestError::BadValue { key: "format", expected: "the name of a format" })?;
    if FORMATS.contains(&format) {
        return Ok(());
    }
    Err(RequestError::UnknownFormat { found: shortened(format) })
}

/// A name that a client made up, short enough to be said back to it.
fn shortened(name: &str) -> String {
    name.chars().take(40).collect()
}

/// Levels of arrays and objects: 0 for a number, 1 for `[]`.
fn depth(value: &Value) -> usize {
    match value {
        Value::Array(items) => 1 + items.iter().map(depth).max().unwrap_or(0),
        Value::Object(keys) => 1 + keys.values().map(depth).max().unwrap_or(0),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_contracts_example_is_understood() {
        let request = parse(br#"{"subscribe":["STATE","HEALTH"],"max_hz":50}"#).expect("a request");
        let classes: Classes = [Class::State, Class::Health].into_iter().collect();
        // 1 / 50 Hz.
        assert_eq!(request, Request { subscribe: Some(classes), period: Some(Some(Duration::from_millis(20))) });
    }

    #[test]
    fn unknown_keys_are_ignored_and_keys_left_out_change_nothing() {
        assert_eq!(parse(br#"{"colour":"red","depth":[[1]]}"#), Ok(Request::default()));
        let request = parse(br#"{"max_hz":null,"format":"json"}"#).expect("a request");
        assert_eq!(request, Request { subscribe: None, period: Some(None) });
    }

    #[test]
    fn an_unknown_name_is_answered_with_the_names_there_are() {
        let error = parse(br#"{"subscribe":["HEALTH","STAET"]}"#).expect_err("no such class");
        assert_eq!((error.code(), error.closes()), ("unknown_class", false));
        assert!(error.supported().contains(&"STATE") && error.to_string().contains("STAET"));
        let error = parse(br#"{"format":"binary"}"#).expect_err("no such format");
        assert_eq!((error.code(), error.closes(), error.supported()), ("unknown_format", false, vec!["json"]));
    }

    #[test]
    fn values_of_the_wrong_kind_are_named_and_the_client_stays() {
        for line in [r#"{"subscribe":"HEALTH"}"#, r#"{"subscribe":[1]}"#, r#"{"max_hz":0}"#, r#"{"max_hz":"fast"}"#] {
            let error = parse(line.as_bytes()).expect_err("a bad value");
            assert_eq!((error.code(), error.closes()), ("bad_value", false), "{line}");
        }
        for line in ["5", "[]", "null"] {
            let error = parse(line.as_bytes()).expect_err("no object");
            assert_eq!((error.code(), error.closes()), ("no_object", false), "{line}");
        }
    }

    #[test]
    fn sixteen_levels_are_read_and_seventeen_end_the_connection() {
        // {"a":[[…]]}: one level for the object and n for the arrays.
        let nested = |n: usize| format!("{{\"a\":{}{}}}", "[".repeat(n), "]".repeat(n));
        assert_eq!(parse(nested(15).as_bytes()), Ok(Request::default()));
        assert_eq!(parse(nested(16).as_bytes()), Err(RequestError::TooDeep));
        let error = parse(nested(30_000).as_bytes()).expect_err("far too deep");
        assert!(error.closes(), "{error}");
    }

    #[test]
    fn no_json_and_too_long_a_line_end_the_connection() {
        for line in [&b"GET / HTTP/1.1"[..], b"{", b"\xff\xfe", b""] {
            let error = parse(line).expect_err("no JSON");
            assert_eq!((error.code(), error.closes()), ("malformed", true));
        }
        let mut line = br#"{"a":""#.to_vec();
        line.resize(REQUEST_BYTES - 2, b' ');
        line.extend(b"\"}");
        assert_eq!(parse(&line), Ok(Request::default()));
        line.push(b' ');
        assert_eq!(parse(&line), Err(RequestError::TooLong));
    }

    proptest! {
        #[test]
        fn no_line_is_answered_with_more_than_it_may_say(line in proptest::collection::vec(any::<u8>(), 0..300)) {
            // What a client sent is said back shortened, whatever it was.
            if let Err(error) = parse(&line) {
                prop_assert!(error.to_string().len() < 1_000);
            }
        }

        #[test]
        fn any_known_classes_can_be_subscribed(picked in proptest::collection::vec(0..Class::ALL.len(), 0..20)) {
            let picked: Vec<Class> = picked.into_iter().map(|index| Class::ALL[index]).collect();
            let line = serde_json::json!({ "subscribe": picked }).to_string();
            let expected: Classes = picked.into_iter().collect();
            prop_assert_eq!(parse(line.as_bytes()), Ok(Request { subscribe: Some(expected), period: None }));
        }
    }
}
