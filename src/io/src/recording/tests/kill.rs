//! A recorder killed at any moment: everything up to its last sync is there.

use super::*;
use crate::live::{Ledger, QueueBound};
use crate::recording::RecorderThread;
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Kills in one run of the test.
const KILLS: u64 = 20;
/// Of them at the same time: the writers sleep most of the time.
const AT_ONCE: u64 = 5;

/// The process to be killed: records 1 500 packets and 30 frames a second until it is, and says on stdout what is
/// synced and what it has given. Its path comes on stdin; without one it does nothing.
#[test]
#[ignore = "started and killed by a_killed_recording_is_readable_up_to_its_last_sync"]
fn writer_process() {
    let mut path = String::new();
    if std::io::stdin().read_line(&mut path).is_err() || path.trim().is_empty() {
        return;
    }
    let recorder =
        Recorder::create(Path::new(path.trim()), header("killed"), RecorderOptions::default()).expect("a new file");
    let mut ledger = Ledger::replay();
    let mut intake = ledger.intake("front".into(), QueueBound::LIDAR_PACKETS);
    let thread = RecorderThread::start(recorder, ledger.recorder()).expect("a thread");
    let _running = ledger.start().expect("a thread");
    let begun = Instant::now();
    let (frame, packet) = (noise(422_400, 1), noise(1206, 2));
    let mut seq = 0;
    // A minute is long after the kill: nobody is left behind when the parent dies first.
    while begun.elapsed() < Duration::from_secs(60) {
        // 50 packets and a frame every 33 ms.
        for n in 0..51 {
            let arrived = begun.elapsed().as_nanos() as i64;
            let payload = if n == 50 { &frame } else { &packet };
            intake.push_recorded(lidar(seq, arrived, payload)).expect("the ledger runs");
            seq += 1;
        }
        let status = thread.status();
        let synced = status.synced_seq.map_or(-1, |seq| seq as i64);
        println!("\n@ {} {} {synced} {}", seq - 1, begun.elapsed().as_nanos(), status.longest_sync.as_nanos());
        std::io::stdout().flush().expect("a reader");
        std::thread::sleep(Duration::from_millis(33));
    }
}

/// What the killed process said last: given, at (ns), synced (-1: nothing), longest sync (ns).
struct LastWords {
    given_at: i64,
    synced: i64,
    longest_sync: i64,
}

fn kill_after(path: &Path, delay: Duration) -> LastWords {
    let mut child = Command::new(std::env::current_exe().expect("this test"))
        .args(["recording::tests::kill::writer_process", "--exact", "--ignored", "--nocapture"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("the writer starts");
    writeln!(child.stdin.take().expect("piped"), "{}", path.display()).expect("the writer listens");
    let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines().map_while(Result::ok);
    let first = lines.by_ref().find(|line| line.starts_with("@ ")).expect("it records");
    std::thread::sleep(delay);
    child.kill().expect("it was alive");
    child.wait().expect("it is dead");
    // A line cut off by the kill has too few numbers.
    let words = |line: String| {
        let numbers: Vec<i64> = line.strip_prefix("@ ")?.split(' ').map_while(|word| word.parse().ok()).collect();
        let [_given, given_at, synced, longest_sync] = numbers[..] else { return None };
        Some(LastWords { given_at, synced, longest_sync })
    };
    std::iter::once(first).chain(lines).filter_map(words).last().expect("the first line at least")
}

#[test]
fn a_killed_recording_is_readable_up_to_its_last_sync() {
    let folder = tempfile::tempdir().unwrap();
    let losses: Vec<i64> = (0..KILLS / AT_ONCE)
        .flat_map(|round| {
            std::thread::scope(|scope| {
                let writers: Vec<_> = (0..AT_ONCE)
                    .map(|n| {
                        let number = round * AT_ONCE + n;
                        let path = folder.path().join(format!("{number}.mcap"));
                        // 0.1 to 2.5 s, by a fixed generator: moments spread over the writer's second.
                        let delay = Duration::from_millis(100 + u64::from(noise(1, number * 7919)[0]) * 2400 / 255);
                        scope.spawn(move || judge(&path, delay))
                    })
                    .collect();
                writers.into_iter().map(|writer| writer.join().expect("judged")).collect::<Vec<_>>()
            })
        })
        .collect();
    println!("killed {} times: at most {} ms lost", losses.len(), losses.iter().max().unwrap() / 1_000_000);
}

/// Kills a writer, reads what it left, and returns how much time is lost, ns.
fn judge(path: &Path, delay: Duration) -> i64 {
    let last = kill_after(path, delay);
    let (events, info) = read(&[path]);
    assert!(events.iter().enumerate().all(|(n, event)| event.seq == n as u64), "no hole before the end");
    assert!(events.last().map_or(-1, |event| event.seq as i64) >= last.synced, "synced is safe");
    assert!(!info.whole() && info.parts[0].events_recorded.is_none(), "it says that it was not finished");
    assert!(info.parts[0].damage.len() <= 1);
    let lost = last.given_at - events.last().map_or(0, |event| event.arrived.0);
    // A second, and what the medium took of it where it is slow: while it syncs nothing new is written.
    let bound = 1_000_000_000 + 2 * last.longest_sync;
    assert!(lost <= bound, "{lost} ns lost, at most {bound} expected");
    lost
}
