//! What is wrong with a config: a sentence, the place, and what to do about it.

use std::fmt;

use miette::{Diagnostic, LabeledSpan, NamedSource, Severity, SourceCode};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::origin::Origin;

/// How bad a problem is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Gravity {
    /// The config cannot be used.
    Error,
    /// It can, but something in it will not do what its author may expect.
    Warning,
}

/// One problem of a config.
#[derive(Debug)]
pub struct Problem {
    /// How bad it is.
    pub gravity: Gravity,
    /// What was found and what was expected.
    pub message: String,
    /// The key it is about as `--set` would name it, e.g. `lidar.front.port`; `None`: the file as a whole.
    pub key: Option<String>,
    /// Where it was written.
    pub origin: Origin,
    /// What to do.
    pub help: Option<String>,
    /// The text for rendering; kept here because miette borrows it.
    source: Option<NamedSource<String>>,
}

impl Problem {
    /// An error at a place.
    pub fn error(origin: &Origin, key: Option<String>, message: String) -> Self {
        let source = match origin {
            Origin::Default => None,
            Origin::Text { source, .. } => Some(NamedSource::new(&source.name, source.text.clone())),
        };
        Self { gravity: Gravity::Error, message, key, origin: origin.clone(), help: None, source }
    }

    /// A warning at a place.
    pub fn warning(origin: &Origin, key: Option<String>, message: String) -> Self {
        Self { gravity: Gravity::Warning, ..Self::error(origin, key, message) }
    }

    /// The same with a remedy.
    #[must_use]
    pub fn with_help(self, help: impl Into<String>) -> Self {
        Self { help: Some(help.into()), ..self }
    }

    /// The order people read problems in: file, calibration, `--set`; in each file from the top down.
    pub(super) fn reading_order(&self) -> (super::Layer, usize) {
        match &self.origin {
            Origin::Default => (super::Layer::Default, 0),
            Origin::Text { source, .. } if source.layer == super::Layer::Set => (super::Layer::Set, 0),
            Origin::Text { source, span } => (source.layer, span.start),
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Problem {}

impl Diagnostic for Problem {
    fn severity(&self) -> Option<Severity> {
        Some(match self.gravity {
            Gravity::Error => Severity::Error,
            Gravity::Warning => Severity::Warning,
        })
    }

    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.source.as_ref().map(|source| source as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let Origin::Text { source, span } = &self.origin else { return None };
        // miette refuses spans beyond the text; a file that breaks off has its error at the very end.
        let start = span.start.min(source.text.len());
        let end = span.end.clamp(start, source.text.len());
        let label = LabeledSpan::new_with_span(None, start..end);
        Some(Box::new(std::iter::once(label)))
    }
}

/// One problem, for machines.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProblemReport {
    /// How bad it is.
    pub gravity: Gravity,
    /// What was found and what was expected.
    pub message: String,
    /// What to do.
    pub help: Option<String>,
    /// The key as `--set` names it, e.g. `lidar.front.port`; null: the file as a whole.
    pub key: Option<String>,
    /// The layer it was written in.
    pub layer: super::Layer,
    /// The file, or `--set`; null for a built-in default.
    pub file: Option<String>,
    /// Line, from 1.
    pub line: Option<usize>,
    /// Column in characters, from 1.
    pub column: Option<usize>,
    /// Byte offset of the place in the text, from 0.
    pub offset: Option<usize>,
    /// Length of the place in bytes.
    pub length: Option<usize>,
}

impl From<&Problem> for ProblemReport {
    fn from(problem: &Problem) -> Self {
        let (file, line, column, offset, length) = match &problem.origin {
            Origin::Default => (None, None, None, None, None),
            Origin::Text { source, span } => {
                let (line, column) = source.line_column(span.start);
                (Some(source.name.clone()), Some(line), Some(column), Some(span.start), Some(span.len()))
            }
        };
        Self {
            gravity: problem.gravity,
            message: problem.message.clone(),
            help: problem.help.clone(),
            key: problem.key.clone(),
            layer: problem.origin.layer(),
            file,
            line,
            column,
            offset,
            length,
        }
    }
}
