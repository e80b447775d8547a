//! What an export must not write to: the recordings and the config it is made from.

use std::io;
use std::path::{Path, PathBuf};

use super::Args;
use crate::cli::Failure;
use crate::config::Loaded;

/// As many links in a row as Linux follows.
const MAX_LINKS: usize = 40;

/// What SQLite keeps beside a `.db3` and reads with it.
const DATABASE_LOGS: [&str; 3] = ["-wal", "-shm", "-journal"];

/// Files and folders that are read, by the one path that each has once all links are followed.
pub(super) struct Protected {
    paths: Vec<PathBuf>,
}

impl Protected {
    /// The inputs, the config and the files it names.
    pub(super) fn new(args: &Args, loaded: &Loaded) -> Self {
        let all = args.input.inputs.iter().chain(&args.input.config.config).chain(&loaded.paths);
        let mut paths = Vec::new();
        // What is not there cannot be harmed; whoever reads it reports it.
        for path in all.filter_map(|path| path.canonicalize().ok()) {
            paths.extend(DATABASE_LOGS.map(|log| {
                let mut beside = path.as_os_str().to_owned();
                beside.push(log);
                PathBuf::from(beside)
            }));
            paths.push(path);
        }
        Self { paths }
    }

    /// Lets a path pass that is none of them and lies in none of them; `resolved` is `path` as [`resolve`] gives it.
    ///
    /// # Errors
    /// Exit code 2, for all other paths.
    pub(super) fn allow(&self, path: &Path, resolved: &Path) -> Result<(), Failure> {
        match self.paths.iter().find(|protected| resolved.starts_with(protected)) {
            None => Ok(()),
            Some(same) if same == resolved => {
                Err(Failure::input(format!("{} is read by this export, it is not written to", path.display()))
                    .with_help("give -o another path"))
            }
            Some(around) => Err(Failure::input(format!(
                "{} lies in the input {}, which is not written to",
                path.display(),
                around.display()
            ))
            .with_help("give -o a path outside of the inputs")),
        }
    }
}

/// The one absolute path of something that may not be there yet: links followed, a last one that leads nowhere too.
///
/// # Errors
/// A path through something that is no folder, links in a ring, or `..` behind a folder that is not there.
pub(super) fn resolve(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        match path.canonicalize() {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            done => return done,
        }
        let Some(name) = path.file_name() else {
            return Err(io::Error::new(io::ErrorKind::NotFound, "a folder on the way is not there"));
        };
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => resolve(parent)?,
            _ => Path::new(".").canonicalize()?,
        };
        let resolved = folder.join(name);
        match resolved.read_link() {
            Ok(target) => path = folder.join(target),
            Err(_) => return Ok(resolved),
        }
    }
    Err(io::Error::other("too many links"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;

    #[test]
    fn what_is_not_there_has_one_path_too() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path().canonicalize().expect("there");
        fs::create_dir(root.join("real")).expect("a folder");
        symlink("real", root.join("alias")).expect("a link");
        symlink("real/later", root.join("dangling")).expect("a link");
        symlink("ring", root.join("ring")).expect("a link");
        let resolved = |path: &str| resolve(&root.join(path)).ok();
        for path in ["real/later", "alias/later", "dangling", "alias/../real/./later"] {
            assert_eq!(resolved(path), Some(root.join("real/later")), "{path}");
        }
        assert_eq!(resolved("alias/new/deep"), Some(root.join("real/new/deep")));
        assert_eq!((resolved("ring"), resolved("new/../later")), (None, None));
        fs::write(root.join("real/file"), "").expect("a file");
        assert_eq!(resolved("real/file/deep"), None, "a file is no folder");
    }
}
