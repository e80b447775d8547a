//! Errors and warnings for people, on stderr.

use std::io::{IsTerminal, Write};

use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme};

use super::Failure;
use crate::config::ConfigError;

/// Something to tell a person.
pub trait Tell {
    /// Its diagnostics in the order they are shown, and a closing line.
    fn parts(&self) -> (Vec<&dyn Diagnostic>, Option<String>);
}

impl Tell for Failure {
    fn parts(&self) -> (Vec<&dyn Diagnostic>, Option<String>) {
        match self {
            Self::Config(error) => error.parts(),
            other => (vec![other], None),
        }
    }
}

impl Tell for ConfigError {
    fn parts(&self) -> (Vec<&dyn Diagnostic>, Option<String>) {
        let problems = self.problems.iter().map(|problem| problem as &dyn Diagnostic);
        (problems.collect(), Some(self.to_string()))
    }
}

impl Tell for crate::config::Problem {
    fn parts(&self) -> (Vec<&dyn Diagnostic>, Option<String>) {
        (vec![self], None)
    }
}

/// Shows it: with colours and lines on a terminal, plain in a log.
pub fn to_stderr(what: &impl Tell) {
    let mut stderr = std::io::stderr().lock();
    let theme = if stderr.is_terminal() { GraphicalTheme::unicode() } else { GraphicalTheme::none() };
    let text = render(what, theme);
    // There is no other place to say that stderr is closed.
    stderr.write_all(text.as_bytes()).unwrap_or_default();
}

/// Shows a warning, unless `-qq` asks for errors alone.
pub fn warning(what: &impl Tell) {
    if tracing::enabled!(tracing::Level::WARN) {
        to_stderr(what);
    }
}

fn render(what: &impl Tell, theme: GraphicalTheme) -> String {
    // Not wrapped: a path or a list of numbers must stay whole, to be copied.
    let handler = GraphicalReportHandler::new_themed(theme).with_links(false).with_wrap_lines(false);
    let (diagnostics, closing) = what.parts();
    let mut text = String::new();
    for diagnostic in diagnostics {
        // The only error is that of writing to a String, which does not fail.
        handler.render_report(&mut text, diagnostic).unwrap_or_default();
        text.push('\n');
    }
    if let Some(closing) = closing {
        text.push_str(&closing);
        text.push('\n');
    }
    text
}
