//! Recordings with something changed in them.

use std::path::Path;

use tumbled::session::Checkpoint;
use tumbled_io::recording::{Reader, Recorder, RecorderOptions};
use tumbled_model::Body;

/// Copies a recording with its checkpoints; `change` is shown each LiDAR packet's place in the ledger and its payload.
pub(crate) fn rewrite(from: &Path, to: &Path, mut change: impl FnMut(u64, &mut [u8])) {
    let mut reader = Reader::open(&[from]).expect("opens");
    let mut recorder = Recorder::create(to, reader.header().clone(), RecorderOptions::default()).expect("begins");
    let results = |reader: &mut Reader, recorder: &mut Recorder| {
        for result in reader.take_results() {
            assert!(recorder.write_result(&Checkpoint::kind(), result.t, result.seq, &result.json));
        }
    };
    while let Some(event) = reader.next() {
        let mut event = event.expect("reads");
        results(&mut reader, &mut recorder);
        if let Body::LidarPacket { bytes, .. } = &mut event.body {
            let mut payload = bytes.to_vec();
            change(event.seq, &mut payload);
            *bytes = payload.into();
        }
        assert!(recorder.write(&event));
    }
    results(&mut reader, &mut recorder);
    assert!(recorder.finish().stopped.is_none());
}
