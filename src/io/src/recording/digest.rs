//! What a recording was imported from, so that nobody has to trust a file name.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use super::attached::AttachedFile;
use super::header::InputFile;

/// The name, size and digest of a file; of a folder, of the files in it.
///
/// A folder's digest is over its files in order of their names: each name, a zero byte, the size as u64 little-endian
/// and the content. Its name ends with `/`. Folders in it are not looked into, as captures have none.
///
/// # Errors
/// When something cannot be read.
pub fn digest_of(path: &Path) -> io::Result<InputFile> {
    let mut hasher = blake3::Hasher::new();
    // `data/.` and `..` have no name of their own.
    let named = path.canonicalize()?;
    let mut name = named.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut bytes = 0;
    if path.is_dir() {
        name.push('/');
        let entries = fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
        let mut files: Vec<_> = entries.into_iter().filter(|path| path.is_file()).collect();
        files.sort();
        for path in files {
            hasher.update(path.file_name().unwrap_or_default().as_encoded_bytes());
            hasher.update(&[0]);
            let mut file = File::open(&path)?;
            hasher.update(&file.metadata()?.len().to_le_bytes());
            bytes += io::copy(&mut file, &mut hasher)?;
        }
    } else {
        bytes = io::copy(&mut File::open(path)?, &mut hasher)?;
    }
    Ok(InputFile { name, bytes, blake3: hasher.finalize().to_hex().to_string() })
}

/// The session id of an import: the same inputs read with the same config and the same files are the same session.
pub fn import_session(inputs: &[InputFile], config: &str, files: &[AttachedFile]) -> String {
    let mut hasher = blake3::Hasher::new();
    for input in inputs {
        hasher.update(input.blake3.as_bytes());
    }
    hasher.update(config.as_bytes());
    for attached in files {
        hasher.update(attached.file.blake3.as_bytes());
    }
    let digest = hasher.finalize().to_hex();
    format!("import-{}", digest.get(..24).unwrap_or_default())
}
