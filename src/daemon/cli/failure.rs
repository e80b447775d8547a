//! How a command ends, and the exit code that says so.

use std::error::Error;
use std::fmt;

use crate::config::ConfigError;

/// How a command that was carried out ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Fine: exit code 0.
    Fine,
    /// What was compared is not the same: exit code 1. The difference is in the report.
    Different,
    /// Finished, but data were lost or a quality gate failed: exit code 3. What was lost is in the report or the log.
    Incomplete,
}

/// Why a command was not carried out.
#[derive(Debug)]
#[non_exhaustive]
pub enum Failure {
    /// The config cannot be used: exit code 2.
    Config(ConfigError),
    /// Bad usage or a bad input file: exit code 2.
    Input {
        /// What was found and what was expected, with the file and the line or byte offset.
        error: Box<dyn Error + Send + Sync>,
        /// What to do, unless the error says it.
        help: Option<String>,
    },
    /// Something else went wrong, e.g. the disk is full: exit code 1.
    Failed {
        /// What.
        error: Box<dyn Error + Send + Sync>,
        /// What to do, unless the error says it.
        help: Option<String>,
    },
    /// Standard output could not be written: exit code 1, or 0 if its reader left.
    Output(std::io::Error),
}

impl Failure {
    /// Bad usage or a bad input file.
    pub fn input(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Input { error: error.into(), help: None }
    }

    /// Something else that went wrong.
    pub fn failed(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Failed { error: error.into(), help: None }
    }

    /// The same with a remedy.
    #[must_use]
    pub fn with_help(self, remedy: impl Into<String>) -> Self {
        let help = Some(remedy.into());
        match self {
            Self::Input { error, .. } => Self::Input { error, help },
            Self::Failed { error, .. } => Self::Failed { error, help },
            // These say for themselves what to do.
            other @ (Self::Config(_) | Self::Output(_)) => other,
        }
    }

    /// The exit code of the process.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Config(_) | Self::Input { .. } => 2,
            Self::Failed { .. } | Self::Output(_) => 1,
        }
    }
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Self {
        Self::Config(error)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(error) => write!(f, "{error}"),
            Self::Input { error, .. } | Self::Failed { error, .. } => write!(f, "{error}"),
            Self::Output(error) => write!(f, "cannot write to standard output: {error}"),
        }
    }
}

impl Error for Failure {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Config(_) => None,
            Self::Input { error, .. } | Self::Failed { error, .. } => error.source(),
            Self::Output(error) => error.source(),
        }
    }
}

impl miette::Diagnostic for Failure {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        match self {
            Self::Input { help, .. } | Self::Failed { help, .. } => {
                help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
            }
            Self::Config(_) | Self::Output(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exit_codes_are_those_of_the_contract() {
        let io = || std::io::Error::other("disk full");
        assert_eq!(Failure::input("no such port").exit_code(), 2);
        assert_eq!(Failure::failed(io()).exit_code(), 1);
        assert_eq!(Failure::Output(io()).exit_code(), 1);
        let error = crate::config::load(None, &["lidar.port=x".to_owned()]).expect_err("not a port");
        assert_eq!(Failure::from(error).exit_code(), 2);
    }
}
