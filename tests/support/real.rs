//! Real captures, which lie beside the repository where people have them.

use std::path::PathBuf;

use super::repository;

/// The path of a real capture; `None` and a printed line when it is not there.
pub(crate) fn real(name: &str) -> Option<PathBuf> {
    let path = repository().join("../shared/data").join(name);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: ../shared/data/{name} is not there");
    None
}
