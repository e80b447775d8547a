//! A line that many clients share.
//!
//! Every client gets its own `seq` and `dropped` with each line, yet a line is serialised once for all of them: what is
//! shared is the object without its closing brace, and each client's writer puts a tail behind it.
//!
//! ```text
//!   {"class":"HEALTH","level":"ok",…            the stem: shared, counted references
//!                                   ,"seq":7,"dropped":0}⏎    the tail: this client's, about 30 bytes
//! ```

use bytes::Bytes;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::class::Class;

/// A line as one client gets it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sent<T> {
    /// What all clients get.
    #[serde(flatten)]
    pub line: T,
    /// The line's number on this connection: 0 for HELLO, then one more each, without gaps.
    pub seq: u64,
    /// Data lines dropped since the line before because this client was behind. What `max_hz` leaves out is not among
    /// them.
    pub dropped: u64,
}

/// A text that is no line of the stream: a bug of whoever wrote it, not of a client.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("a line of class {} has to be one JSON object on one line whose first key is that class, found {found:?}", class.name())]
pub struct NotALine {
    /// What it was said to be.
    pub class: Class,
    /// How the text begins.
    pub found: String,
}

/// A line on its way to clients. Cheap to clone.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    pub(super) class: Class,
    stem: Bytes,
    /// Whether the stem ends within the object of a state's delivery.
    in_delivery: bool,
}

impl Frame {
    /// Of a serialised object, `{"class":"…",…}`, without newline.
    pub(super) fn new(class: Class, mut line: String) -> Result<Self, NotALine> {
        let after_class = line
            .strip_prefix("{\"class\":\"")
            .and_then(|rest| rest.strip_prefix(class.name()))
            .and_then(|rest| rest.strip_prefix('"'));
        let is_object = after_class.is_some_and(|rest| rest.ends_with('}') && !rest.contains('\n'));
        if !is_object {
            return Err(NotALine { class, found: line.chars().take(60).collect() });
        }
        // A state's delivery is its last key, and its latencies are the delivery's: three braces close.
        let in_delivery = class == Class::State && line.ends_with("}}}");
        line.truncate(line.len() - if in_delivery { 2 } else { 1 }); // the braces come with the tail
        Ok(Self { class, stem: line.into(), in_delivery })
    }

    /// What is shared.
    pub(super) fn stem(&self) -> &Bytes {
        &self.stem
    }

    /// What ends a client's line: the keys that [`Sent`] adds, and the one that they add to a delivery.
    pub(super) fn tail(&self, seq: u64, dropped: u64) -> String {
        let delivery = if self.in_delivery { format!(",\"dropped\":{dropped}}}") } else { String::new() };
        format!("{delivery},\"seq\":{seq},\"dropped\":{dropped}}}\n")
    }

    /// Bytes it takes in a queue.
    pub(super) fn size(&self) -> usize {
        self.stem.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stem_and_tail_make_one_line_of_json() {
        let frame = Frame::new(Class::Event, r#"{"class":"EVENT","message":"a } in it"}"#.to_owned()).expect("a line");
        let line = [frame.stem().as_ref(), frame.tail(7, 2).as_bytes()].concat();
        let line = String::from_utf8(line).expect("UTF-8");
        assert_eq!(line, "{\"class\":\"EVENT\",\"message\":\"a } in it\",\"seq\":7,\"dropped\":2}\n");
        let sent: Sent<serde_json::Value> = serde_json::from_str(&line).expect("JSON");
        assert_eq!((sent.seq, sent.dropped, &sent.line["message"]), (7, 2, &"a } in it".into()));
    }

    #[test]
    fn a_states_delivery_has_the_clients_count_too() {
        let state = r#"{"class":"STATE","delivery":{"age_ms":4.5,"latency_ms":{"total":4.5}}}"#;
        let frame = Frame::new(Class::State, state.to_owned()).expect("a line");
        let line = [frame.stem().as_ref(), frame.tail(7, 2).as_bytes()].concat();
        let line: serde_json::Value = serde_json::from_slice(&line).expect("JSON");
        assert_eq!((&line["delivery"]["dropped"], &line["dropped"], &line["seq"]), (&2.into(), &2.into(), &7.into()));
        assert_eq!(line["delivery"]["latency_ms"]["total"], 4.5);
    }

    #[test]
    fn what_is_no_line_of_its_class_is_refused() {
        for text in ["", "{}", r#"{"class":"STATE"}"#, r#"{"class":"EVENT""#, "{\"class\":\"EVENT\",\n\"a\":1}", "[1]"]
        {
            assert!(Frame::new(Class::Event, text.to_owned()).is_err(), "{text}");
        }
    }
}
