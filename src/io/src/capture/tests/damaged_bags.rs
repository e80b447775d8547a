//! ROS 2 bags with bytes changed, cut off or made up.

use super::super::cdr::tests::scan_message;
use super::bags::{Posted, SCAN, db3_bag, mcap_bag};
use super::*;
use proptest::prelude::*;
use std::fs;
use std::sync::LazyLock;

/// A file that is written over for each input of a test: making and removing one costs more than reading it.
struct Rewritten {
    folder: tempfile::TempDir,
    name: &'static str,
}

impl Rewritten {
    fn new(name: &'static str) -> Self {
        Self { folder: tempfile::tempdir().unwrap(), name }
    }

    /// The file with this content and no other, and nothing beside it.
    fn holding(&self, content: &[u8]) -> std::path::PathBuf {
        let path = self.folder.path().join(self.name);
        for log in ["-wal", "-shm", "-journal"] {
            // What reading an SQLite file may leave, seldom there.
            fs::remove_file(self.folder.path().join(format!("{}{log}", self.name))).unwrap_or_default();
        }
        // Not emptied first: some file systems write such a file to the disk when it is closed.
        let mut file = fs::OpenOptions::new().write(true).create(true).truncate(false).open(&path).unwrap();
        std::io::Write::write_all(&mut file, content).unwrap();
        file.set_len(content.len() as u64).unwrap();
        path
    }
}

/// Two messages of two packets each.
fn small_bag() -> [Posted<'static>; 2] {
    let scan = ("/points", SCAN, 0, scan_message(false, &[(1, 0, 1), (2, 0, 2)]));
    [scan.clone(), scan]
}

/// Whatever opens is read to its end: at most as many packets as there are bytes for.
fn drain(path: &Path, length: usize) {
    if let Ok(capture) = open_default(path) {
        let packets =
            capture.filter(|record| record.as_ref().is_ok_and(|r| matches!(r.body, Body::LidarPacket { .. })));
        assert!(packets.count() <= length, "each packet has bytes of its own");
    }
}

proptest! {
    #[test]
    fn flipped_bytes_in_an_mcap_end_without_panic(
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), kind in 0..3usize,
        cut in any::<prop::sample::Index>(), cutting in any::<bool>(),
    ) {
        thread_local! { static FILE: Rewritten = Rewritten::new("bag.mcap"); } // removed with the test's thread
        static BAGS: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| {
            [None, Some(mcap::Compression::Lz4), Some(mcap::Compression::Zstd)].map(|c| mcap_bag(c, &small_bag()))
        });
        let mut content = BAGS[kind].clone();
        for (at, value) in flips {
            let at = at.index(content.len());
            content[at] ^= value;
        }
        if cutting {
            content.truncate(cut.index(content.len()));
        }
        FILE.with(|file| drain(&file.holding(&content), 20_000));
    }

    #[test]
    fn any_bytes_behind_the_mcap_magic_end_without_panic(
        tail in prop::collection::vec(any::<u8>(), 0..300), op in 1u8..16, len in 0u64..400,
    ) {
        thread_local! { static FILE: Rewritten = Rewritten::new("bag.mcap"); } // removed with the test's thread
        let content = [mcap::MAGIC, &[op], &len.to_le_bytes(), &tail].concat();
        FILE.with(|file| drain(&file.holding(&content), content.len()));
    }

    #[test]
    fn flipped_bytes_in_an_sqlite_bag_end_without_panic(
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        head in any::<bool>(), cut in any::<prop::sample::Index>(), cutting in any::<bool>(),
    ) {
        thread_local! { static FILE: Rewritten = Rewritten::new("bag.db3"); } // removed with the test's thread
        static BAG: LazyLock<Vec<u8>> = LazyLock::new(|| {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("bag.db3");
            db3_bag(&path, &small_bag());
            fs::read(&path).unwrap()
        });
        let mut content = BAG.clone();
        // Half of the time only the pages that hold the schema and the topics.
        let range = if head { content.len().min(8192) } else { content.len() };
        for (at, value) in flips {
            content[at.index(range)] ^= value;
        }
        if cutting {
            content.truncate(cut.index(content.len()));
        }
        FILE.with(|file| drain(&file.holding(&content), 20_000));
    }
}
