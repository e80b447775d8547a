//! Claims about one client's queue, without a socket.

use super::*;

fn frame(class: Class, mark: usize) -> Frame {
    Frame::new(class, format!("{{\"class\":\"{}\",\"mark\":{mark}}}", class.name())).expect("a line")
}

fn mark(frame: &Frame) -> usize {
    let stem = String::from_utf8(frame.stem().to_vec()).expect("UTF-8");
    stem.rsplit(':').next().and_then(|digits| digits.parse().ok()).expect("a mark")
}

fn queue(limits: &Limits, classes: &[Class], hz: Option<f64>) -> Queue {
    let queue = Queue::new(limits);
    let period = hz.map(|hz| Duration::from_secs_f64(1.0 / hz));
    queue.apply(&Request { subscribe: Some(classes.iter().copied().collect()), period: Some(period) });
    queue
}

/// Takes all that can be written now: the marks, and the dropped lines told with each.
fn taken(queue: &Queue, now: Instant) -> Vec<(usize, u64)> {
    std::iter::from_fn(|| match queue.next(now) {
        Next::Line { frame, dropped } => Some((mark(&frame), dropped)),
        _ => None,
    })
    .collect()
}

#[test]
fn beyond_the_bound_the_oldest_data_go_and_are_told_with_the_next_line() {
    let limits = Limits { data_lines: 3, ..Limits::default() };
    let queue = queue(&limits, &[Class::Health], None);
    let now = Instant::now();
    let dropped: u64 = (0..5).map(|mark| queue.offer(&frame(Class::Health, mark), now)).sum();
    assert_eq!(dropped, 2);
    assert_eq!(taken(&queue, now), [(2, 2), (3, 0), (4, 0)]);
}

#[test]
fn bytes_are_bounded_too_and_a_line_larger_than_the_bound_never_waits() {
    // {"class":"CLOUD","mark":1 is 25 bytes without its brace: two of them fit into 60.
    let limits = Limits { data_bytes: 60, ..Limits::default() };
    let queue = queue(&limits, &[Class::Cloud], None);
    let now = Instant::now();
    for mark in 1..=3 {
        queue.offer(&frame(Class::Cloud, mark), now);
    }
    assert_eq!(queue.fill(), Fill { lines: 2, bytes: 50 });
    let large =
        Frame::new(Class::Cloud, format!("{{\"class\":\"CLOUD\",\"x\":\"{}\"}}", "x".repeat(60))).expect("a line");
    // The two that waited are older, so they go first.
    assert_eq!(queue.offer(&large, now), 3);
    assert_eq!(queue.fill(), Fill::default());
}

#[test]
fn control_lines_keep_their_place_and_are_never_dropped_for_data() {
    let limits = Limits { data_lines: 1, ..Limits::default() };
    let queue = queue(&limits, &[Class::Health, Class::Event], None);
    let now = Instant::now();
    queue.offer(&frame(Class::Event, 0), now);
    queue.offer(&frame(Class::Health, 1), now);
    queue.offer(&frame(Class::Event, 2), now);
    queue.offer(&frame(Class::Health, 3), now);
    assert_eq!(taken(&queue, now), [(0, 1), (2, 0), (3, 0)]);
}

#[tokio::test]
async fn a_client_that_lets_too_many_control_lines_wait_is_cut_off() {
    let limits = Limits { control_lines: 2, ..Limits::default() };
    let queue = queue(&limits, &[Class::Event], None);
    let now = Instant::now();
    queue.offer(&frame(Class::Event, 0), now);
    queue.offer(&frame(Class::Event, 1), now);
    assert!(tokio::time::timeout(Duration::from_millis(20), queue.cut()).await.is_err(), "two are allowed");
    queue.offer(&frame(Class::Event, 2), now);
    assert!(tokio::time::timeout(Duration::from_secs(5), queue.cut()).await.is_ok(), "three are not");
}

#[test]
fn what_was_not_subscribed_does_not_wait() {
    let queue = Queue::new(&Limits::default());
    let now = Instant::now();
    for class in Class::ALL {
        queue.offer(&frame(class, class as usize), now);
    }
    assert_eq!(taken(&queue, now), [(Class::State as usize, 0), (Class::Health as usize, 0)]);
}

#[test]
fn max_hz_sends_the_newest_when_its_time_has_come_and_counts_nothing_as_dropped() {
    // 100 lines a second thinned out to 25: every fourth, 40 ms apart.
    let queue = queue(&Limits::default(), &[Class::Cloud], Some(25.0));
    let start = Instant::now();
    let at = |ms: u64| start + Duration::from_millis(ms);
    let mut got = Vec::new();
    for mark in 0..12 {
        queue.offer(&frame(Class::Cloud, mark), at(10 * mark as u64));
        got.extend(taken(&queue, at(10 * mark as u64)));
    }
    assert_eq!(got, [(0, 0), (4, 0), (8, 0)]);
    // The newest is not forgotten when nothing follows it: it waits for 120 ms.
    assert!(matches!(queue.next(at(119)), Next::Wait(Some(due)) if due == at(120)));
    assert_eq!(taken(&queue, at(120)), [(11, 0)]);
    assert!(matches!(queue.next(at(120)), Next::Wait(None)));
}

#[test]
fn jitter_of_the_source_does_not_lower_the_rate() {
    // Due every 20 ms; lines come at 1 ms before and after the beat, by turns.
    let queue = queue(&Limits::default(), &[Class::State], Some(50.0));
    let start = Instant::now();
    let mut got = 0;
    for beat in 1..=50_u64 {
        let now = start + Duration::from_millis(if beat % 2 == 0 { 20 * beat - 1 } else { 20 * beat + 1 });
        queue.offer(&frame(Class::State, 0), now);
        // The writer looks 2 ms later.
        got += taken(&queue, now + Duration::from_millis(2)).len();
    }
    assert!(got >= 49, "{got} of 50");
}

#[test]
fn health_is_not_thinned_out() {
    let queue = queue(&Limits::default(), &[Class::Health], Some(0.001));
    let now = Instant::now();
    queue.offer(&frame(Class::Health, 1), now);
    queue.offer(&frame(Class::Health, 2), now);
    assert_eq!(taken(&queue, now), [(1, 0), (2, 0)]);
}

#[test]
fn a_new_rate_lets_a_held_line_go() {
    let queue = queue(&Limits::default(), &[Class::State], Some(0.001));
    let now = Instant::now();
    queue.offer(&frame(Class::State, 1), now);
    queue.offer(&frame(Class::State, 2), now);
    assert_eq!(taken(&queue, now), [(1, 0)]);
    queue.apply(&Request { subscribe: None, period: Some(None) });
    assert_eq!(taken(&queue, now), [(2, 0)]);
}

#[test]
fn at_the_end_what_waits_is_said_and_nothing_more_comes() {
    let queue = queue(&Limits::default(), &[Class::Health], None);
    let now = Instant::now();
    queue.offer(&frame(Class::Health, 1), now);
    queue.end(Some(frame(Class::Error, 2)));
    queue.offer(&frame(Class::Health, 3), now);
    assert_eq!(taken(&queue, now), [(1, 0), (2, 0)]);
    assert!(matches!(queue.next(now), Next::End));
}
