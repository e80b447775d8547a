//! Other people's programs that results are compared with.

use std::path::PathBuf;
use std::process::Command;

/// The Python of `TUMBLED_FOREIGN_PYTHON` if it has these modules; `None` and a printed line where there is none.
pub(crate) fn python(modules: &str, packages: &str) -> Option<PathBuf> {
    let has_them = |python: &PathBuf| {
        let imported = Command::new(python).args(["-c", &format!("import {modules}")]).output();
        imported.is_ok_and(|output| output.status.success())
    };
    let found = std::env::var_os("TUMBLED_FOREIGN_PYTHON").map(PathBuf::from).filter(has_them);
    if found.is_none() {
        println!("skipped: TUMBLED_FOREIGN_PYTHON names no Python with {packages}");
    }
    found
}
