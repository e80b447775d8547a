//! From texts to a [`Config`]: the layers in their order, then the checks.
//!
//! ```text
//!   built-in defaults → file → calibration file → --set ──▶ names and types ──▶ rules ──▶ Config
//! ```
//! In the file's place may stand the config a recording was made with. No environment variable and no second file takes
//! part.

use std::path::Path;
use std::sync::Arc;

use miette::Diagnostic;

use super::calibration::apply_calibration;
use super::check::check_rules;
use super::files::{FileShelf, Recorded};
use super::names::check_names;
use super::origin::{Layer, Origin, SourceText};
use super::problem::{Gravity, Problem};
use super::raw::RawConfig;
use super::set::Setting;
use super::shape::Shape;
use super::tree::{Node, Step};
use super::{Config, ConfigSource, Loaded};

/// A config that cannot be used: every problem found, in reading order, warnings among them.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("{count} in {name}{remedy}", count = count_errors(.problems), remedy = said(*.remedy))]
pub struct ConfigError {
    /// The config's file, or what stands in for one.
    pub name: String,
    /// The problems; at least one is an error.
    #[related]
    pub problems: Vec<Problem>,
    /// What to do about all of them at once, if there is such a thing.
    pub remedy: Option<&'static str>,
}

/// A remedy behind a sentence.
fn said(remedy: Option<&str>) -> String {
    remedy.map_or_else(String::new, |remedy| format!(": {remedy}"))
}

/// `1 error`, `3 errors`.
fn count_errors(problems: &[Problem]) -> String {
    match problems.iter().filter(|problem| problem.gravity == Gravity::Error).count() {
        1 => "1 error".to_owned(),
        n => format!("{n} errors"),
    }
}

/// Loads a config: the file if there is one, what `rig.calibration` names, and the `--set` arguments in their order.
///
/// # Errors
/// Every problem of every layer. A file that is not TOML is not looked at further.
pub fn load(file: Option<&Path>, settings: &[String]) -> Result<Loaded, ConfigError> {
    let name = file.map_or_else(|| "the built-in config".to_owned(), |path| path.display().to_string());
    let source = file.map_or(ConfigSource::Default, |path| ConfigSource::File(path.to_owned()));
    let mut problems = Vec::new();
    let root = read_file(file, &mut problems);
    finish(Base { name, source, root, problems, shelf: FileShelf::default() }, settings)
}

/// Loads the config a recording was made with, and the `--set` arguments on top. Files it names are taken from the
/// recording; its paths are not looked for on this machine. A recording without a config: the built-in one.
///
/// # Errors
/// As [`load`], and when the recording's copy of its config is damaged.
pub fn load_recorded(recorded: Recorded, settings: &[String]) -> Result<Loaded, ConfigError> {
    let (path, header) = (&recorded.path, &recorded.header);
    if header.config.is_empty() && !header.config_damaged {
        return load(None, settings);
    }
    let name = format!("the config recorded in {}", path.display());
    let source = ConfigSource::Recorded(path.clone());
    let mut problems = Vec::new();
    let root = if header.config_damaged {
        let message = format!("{name} is damaged");
        problems.push(Problem::error(&Origin::Default, None, message).with_help(OTHER_CONFIG));
        Node::empty()
    } else {
        Node::parse(&SourceText::recorded(path, header.config.clone()), &mut problems)
    };
    let shelf = FileShelf { recorded: Some(recorded), ..FileShelf::default() };
    finish(Base { name, source, root, problems, shelf }, settings)
}

/// What to do about a recorded config that cannot be used.
const OTHER_CONFIG: &str = "give --config FILE with a config for this recording";

/// The layer all others go on, as it was read.
struct Base {
    name: String,
    source: ConfigSource,
    root: Node,
    problems: Vec<Problem>,
    shelf: FileShelf,
}

fn finish(base: Base, settings: &[String]) -> Result<Loaded, ConfigError> {
    let Base { name, source, root, mut problems, mut shelf } = base;
    let loaded = if problems.is_empty() { layer_and_check(root, settings, &mut shelf, &mut problems) } else { None };
    problems.sort_by_key(Problem::reading_order);
    match loaded {
        Some((config, tree)) if problems.iter().all(|problem| problem.gravity == Gravity::Warning) => {
            Ok(Loaded { config, tree, warnings: problems, source, paths: shelf.paths })
        }
        _ => {
            let of_the_recording = |problem: &Problem| problem.origin.layer() == Layer::Recorded;
            let remedy = problems.iter().any(of_the_recording).then_some(OTHER_CONFIG);
            let name = if settings.is_empty() { name } else { format!("{name} with --set") };
            Err(ConfigError { name, problems, remedy })
        }
    }
}

fn read_file(file: Option<&Path>, problems: &mut Vec<Problem>) -> Node {
    let Some(path) = file else { return Node::empty() };
    match read_source(Layer::File, path) {
        Ok(source) => Node::parse(&source, problems),
        Err(reason) => {
            let message = format!("the config file cannot be read: {reason}");
            let help = format!("`tumbled config init {}` writes a commented default", path.display());
            problems.push(Problem::error(&Origin::Default, None, message).with_help(help));
            Node::empty()
        }
    }
}

/// The upper layers and the checks. `None` only with at least one error in `problems`.
fn layer_and_check(
    mut root: Node,
    settings: &[String],
    shelf: &mut FileShelf,
    problems: &mut Vec<Problem>,
) -> Option<(Config, Node)> {
    let shape = Shape::of(&schemars::schema_for!(RawConfig));
    root.fill_defaults(&shape);

    let mut parsed = Vec::new();
    for argument in settings {
        match Setting::parse(argument) {
            Ok(setting) => parsed.push(setting),
            Err(problem) => problems.push(*problem),
        }
    }
    // The calibration file's name and the ids it refers to may themselves be set: these go before it.
    let (early, late): (Vec<Setting>, Vec<Setting>) = parsed.into_iter().partition(Setting::precedes_calibration);
    early.iter().for_each(|setting| apply_setting(setting, &mut root, &shape, problems));
    let calibration = apply_calibration(&mut root, shelf, problems);
    late.iter().for_each(|setting| apply_setting(setting, &mut root, &shape, problems));
    root.fill_defaults(&shape);

    let findings = check_names(&root, &shape);
    problems.extend(findings.problems);
    let faulty = take_out_faulty(&mut root, &shape, findings.faulty);
    match serde_path_to_error::deserialize::<_, RawConfig>(root.to_json()) {
        Ok(raw) => {
            let config = check_rules(raw, &root, &faulty, shelf, problems)?;
            Some((Config { calibration, ..config }, root))
        }
        Err(error) => {
            let message = format!("`{}` cannot be read: {}", error.path(), error.inner());
            problems.push(Problem::error(&root.origin, Some(error.path().to_string()), message));
            None
        }
    }
}

/// Puts what is faulty back to its default so that the rules can look at the rest; the errors stand all the same.
/// Returns every path taken out: a table that loses a required key goes with it.
fn take_out_faulty(root: &mut Node, shape: &Shape, mut faulty: Vec<Vec<Step>>) -> Vec<Vec<Step>> {
    let mut taken_out = Vec::new();
    while !faulty.is_empty() {
        faulty.iter().for_each(|path| root.remove(path));
        root.fill_defaults(shape);
        taken_out.append(&mut faulty);
        faulty = check_names(root, shape).faulty;
    }
    taken_out
}

/// Applies a setting whole or not at all: half a setting would be reported a second time as a wrong type.
fn apply_setting(setting: &Setting, root: &mut Node, shape: &Shape, problems: &mut Vec<Problem>) {
    let mut changed = root.clone();
    let before = problems.len();
    setting.apply(&mut changed, shape, problems);
    if problems.len() == before {
        *root = changed;
    }
}

/// Reads a text file.
///
/// # Errors
/// The reason with the path: not there, not readable, or not UTF-8 (with the byte offset).
pub(super) fn read_source(layer: Layer, path: &Path) -> Result<Arc<SourceText>, ReadError> {
    let shown = || path.display().to_string();
    let bytes = std::fs::read(path).map_err(|source| ReadError::Io { path: shown(), source })?;
    let text = String::from_utf8(bytes)
        .map_err(|error| ReadError::NotUtf8 { path: shown(), offset: error.utf8_error().valid_up_to() })?;
    Ok(SourceText::file(layer, path, text))
}

/// Why a text file cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The text is not UTF-8.
    #[error("{path}: byte offset {offset}: not UTF-8 text")]
    NotUtf8 {
        /// The file.
        path: String,
        /// The first byte that is not part of a character.
        offset: usize,
    },
}

/// A path of keys, for reading the tree.
pub(super) fn keys(names: &[&str]) -> Vec<Step> {
    names.iter().map(|name| Step::Key((*name).to_owned())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::COMMENTED_DEFAULT;
    use proptest::prelude::*;

    fn load_text(text: &str, settings: &[String]) -> (Option<Config>, Vec<Problem>) {
        let mut problems = Vec::new();
        let source = SourceText::file(Layer::File, Path::new("rig.toml"), text.to_owned());
        let root = Node::parse(&source, &mut problems);
        let loaded = if problems.is_empty() {
            layer_and_check(root, settings, &mut FileShelf::default(), &mut problems)
        } else {
            None
        };
        (loaded.map(|(config, _)| config), problems)
    }

    /// Whatever was written: a config or an error, and every problem lies in the text it names.
    fn assert_accounted_for(config: Option<Config>, problems: &[Problem]) {
        let errors = problems.iter().filter(|problem| problem.gravity == Gravity::Error).count();
        assert!(config.is_some() || errors > 0, "refused without a reason");
        for problem in problems {
            if let Origin::Text { source, span } = &problem.origin {
                assert!(span.start <= span.end && span.end <= source.text.len(), "{problem:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_config_or_has_an_error(text in any::<String>(), setting in any::<String>()) {
            let (config, problems) = load_text(&text, &[setting]);
            assert_accounted_for(config, &problems);
        }

        #[test]
        fn any_piece_replaced_in_a_config_leaves_a_config_or_an_error(
            at in 0..COMMENTED_DEFAULT.len(),
            length in 0_usize..60,
            piece in r#"([a-z_]{1,8}|[0-9.\-]{1,6}|\[|\]|\{|\}|=|"|,|\n|#){0,4}"#,
        ) {
            let text = COMMENTED_DEFAULT.as_bytes();
            let end = (at + length).min(text.len());
            let bytes = [&text[..at], piece.as_bytes(), &text[end..]].concat();
            let (config, problems) = load_text(&String::from_utf8_lossy(&bytes), &[]);
            assert_accounted_for(config, &problems);
        }

        #[test]
        fn any_setting_is_applied_or_has_an_error(
            key in "(lidar|kinect|rig|turntable|target|points_of_interest)(\\.(front|near|port|id|name|intrinsics|fx|t_rig_lidar|rotation_xyzw|calibration)){0,4}",
            value in r#"([a-z]{1,4}|[0-9]{1,3}|[0-9]\.[0-9]|\[|\]|\{|\}|=|"|,| ){0,8}"#,
        ) {
            let (config, problems) = load_text("", &[format!("{key}={value}")]);
            assert_accounted_for(config, &problems);
        }
    }
}
