//! Where a value was written: the layer, the text and the place in it.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The layers of a config, lowest first. A higher one overrides only the keys it names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Layer {
    /// Built in.
    Default,
    /// The config that is attached to the recording that is read.
    Recorded,
    /// The config file.
    File,
    /// The calibration file that `rig.calibration` names.
    Calibration,
    /// `--set` on the command line.
    Set,
}

/// A text values are read from: a whole file, or one `--set` argument.
#[derive(Debug)]
pub struct SourceText {
    /// Which layer it is.
    pub layer: Layer,
    /// Its name in messages: the path as given, or `--set`.
    pub name: String,
    /// The text, valid UTF-8.
    pub text: String,
    /// The directory its relative paths start from: the file's own; empty (the working directory) for `--set`.
    pub directory: PathBuf,
}

impl SourceText {
    /// A file's text.
    pub fn file(layer: Layer, path: &Path, text: String) -> Arc<Self> {
        let directory = path.parent().map(Path::to_path_buf).unwrap_or_default();
        Arc::new(Self { layer, name: path.display().to_string(), text, directory })
    }

    /// The config attached to a recording. Its paths are those of another machine: they start nowhere on this one.
    pub fn recorded(recording: &Path, text: String) -> Arc<Self> {
        let name = format!("{}: its config", recording.display());
        Arc::new(Self { layer: Layer::Recorded, name, text, directory: PathBuf::new() })
    }

    /// One `--set` argument.
    pub fn set(argument: &str) -> Arc<Self> {
        Arc::new(Self {
            layer: Layer::Set,
            name: "--set".to_owned(),
            text: argument.to_owned(),
            directory: PathBuf::new(),
        })
    }

    /// Line and column of a byte offset, both from 1; the column counts characters.
    pub fn line_column(&self, offset: usize) -> (usize, usize) {
        // A span may end beyond the text or inside a character when a file breaks off: go back to the last boundary.
        let mut end = offset.min(self.text.len());
        while !self.text.is_char_boundary(end) {
            end -= 1;
        }
        let before = self.text.get(..end).unwrap_or_default();
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let line = before.matches('\n').count() + 1;
        let column = before.get(line_start..).unwrap_or_default().chars().count() + 1;
        (line, column)
    }
}

/// Where a value was written.
#[derive(Clone, Debug)]
pub enum Origin {
    /// Nowhere: it is the built-in default.
    Default,
    /// In a text.
    Text {
        /// The text.
        source: Arc<SourceText>,
        /// Byte range in it.
        span: Range<usize>,
    },
}

impl Origin {
    /// A place in a text.
    pub fn new(source: &Arc<SourceText>, span: Range<usize>) -> Self {
        Self::Text { source: Arc::clone(source), span }
    }

    /// The layer the value came from.
    pub fn layer(&self) -> Layer {
        match self {
            Self::Default => Layer::Default,
            Self::Text { source, .. } => source.layer,
        }
    }

    /// The directory a relative path written here starts from; empty: the working directory.
    pub fn directory(&self) -> &Path {
        match self {
            Self::Default => Path::new(""),
            Self::Text { source, .. } => &source.directory,
        }
    }
}

/// For people: `default`, `rig.toml:12`, `--set lidar.port=2369`.
impl std::fmt::Display for Origin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::Text { source, .. } if source.layer == Layer::Set => write!(f, "--set {}", source.text),
            Self::Text { source, span } => write!(f, "{}:{}", source.name, source.line_column(span.start).0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_columns_count_from_one_and_columns_count_characters() {
        let source = SourceText::file(Layer::File, Path::new("a/rig.toml"), "x = 1\ny = \"é\" z".to_owned());
        assert_eq!(source.line_column(0), (1, 1));
        assert_eq!(source.line_column(6), (2, 1));
        // `y = "é" z`: é is two bytes, so z stands at byte 6 + 9 and is the ninth character.
        assert_eq!(source.line_column(15), (2, 9));
        // In the middle of é (bytes 11 and 12), and beyond the end.
        assert_eq!(source.line_column(12), (2, 6));
        assert_eq!(source.line_column(1_000), (2, 10));
        assert_eq!(source.directory, Path::new("a"));
    }
}
