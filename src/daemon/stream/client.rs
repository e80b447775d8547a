//! One client's connection: its requests are read and its lines are written, by one task.

use std::time::{Duration, Instant};

use bytes::Buf;
use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, BufReader};
use tokio::time::{sleep_until, timeout};

use super::class::Class;
use super::hello::ErrorLine;
use super::hub::{Admitted, frame};
use super::queue::Next;
use super::request::{REQUEST_BYTES, RequestError, parse};

/// What is read at a time: a subscription fits.
const READ_BYTES: usize = 4 * 1024;

/// What is still read of a client whose connection ends, so that the line that says why is not lost with it.
const DISCARD_BYTES: usize = 1 << 20;

/// How writing ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// All was said.
    Said,
    /// The client left.
    Left,
    /// It did not take a line in time.
    Lagging,
}

/// Serves a client until it leaves, is cut off, or the server ends.
pub(super) async fn serve(read: impl AsyncRead + Unpin, mut write: impl AsyncWrite + Unpin, client: Admitted) {
    let limits = &client.hub.limits;
    let mut read = BufReader::with_capacity(READ_BYTES, read);
    let end = {
        let mut writing = std::pin::pin!(write_lines(&mut write, &client));
        tokio::select! {
            end = &mut writing => end,
            () = read_requests(&mut read, &client) => {
                // It closed its side: it has left, or wants no more than what waits.
                client.queue.end(None);
                timeout(limits.farewell, writing).await.unwrap_or(End::Left)
            }
            () = client.queue.cut() => End::Lagging,
        }
    };
    match end {
        End::Lagging => {
            client.hub.count_cut_off();
            tracing::warn!("a client of the state stream did not read and was cut off");
        }
        // Closing with bytes unread would take back what was just written. At the server's end there is no time for it,
        // and nothing unread: requests were read all along.
        End::Said if !client.hub.is_stopped() => {
            timeout(limits.farewell, discard(&mut read)).await.unwrap_or_default();
        }
        End::Said | End::Left => {}
    }
}

/// Writes what the queue gives, each line with its number and what was dropped before it.
async fn write_lines(write: &mut (impl AsyncWrite + Unpin), client: &Admitted) -> End {
    let mut seq = 0;
    loop {
        match client.queue.next(Instant::now()) {
            Next::Line { frame, dropped } => {
                let tail = frame.tail(seq, dropped);
                let mut line = frame.stem().clone().chain(tail.as_bytes());
                match timeout(client.hub.limits.lag, write.write_all_buf(&mut line)).await {
                    Ok(Ok(())) => seq += 1,
                    Ok(Err(_)) => return End::Left,
                    Err(_) => return End::Lagging,
                }
            }
            Next::Wait(None) => client.queue.ready().await,
            Next::Wait(Some(due)) => tokio::select! {
                () = client.queue.ready() => {}
                () = sleep_until(due.into()) => {}
            },
            Next::End => {
                return match write.shutdown().await {
                    Ok(()) => End::Said,
                    Err(_) => End::Left,
                };
            }
        }
    }
}

/// Carries out requests until the client closes its side.
async fn read_requests(read: &mut (impl AsyncBufReadExt + Unpin), client: &Admitted) {
    let mut rate = Rate::new(client.hub.limits.requests_per_s);
    loop {
        let request = match next_line(read).await {
            Ok(Some(line)) => rate.count(Instant::now()).and_then(|()| match line.trim_ascii() {
                [] => Ok(None), // somebody pressed Enter
                line => parse(line).map(Some),
            }),
            Ok(None) => return,
            Err(error) => Err(error),
        };
        match request {
            Ok(request) => request.iter().for_each(|request| client.queue.apply(request)),
            Err(error) => {
                let answer = frame(Class::Error, &ErrorLine::of_request(&error)).ok();
                if error.closes() {
                    client.queue.end(answer);
                    // The writer ends the connection once it has said why.
                    return std::future::pending().await;
                }
                answer.into_iter().for_each(|answer| client.queue.control(answer));
            }
        }
    }
}

/// The next line without its newline; `None` at the end. What follows the last newline is no line.
async fn next_line(read: &mut (impl AsyncBufReadExt + Unpin)) -> Result<Option<Vec<u8>>, RequestError> {
    let mut line = Vec::new();
    loop {
        let Ok(bytes) = read.fill_buf().await else { return Ok(None) };
        if bytes.is_empty() {
            return Ok(None);
        }
        let newline = bytes.iter().position(|byte| *byte == b'\n');
        let part = bytes.get(..newline.unwrap_or(bytes.len())).unwrap_or_default();
        if line.len() + part.len() > REQUEST_BYTES {
            return Err(RequestError::TooLong);
        }
        line.extend_from_slice(part);
        let used = part.len() + usize::from(newline.is_some());
        read.consume(used);
        if newline.is_some() {
            return Ok(Some(line));
        }
    }
}

/// Reads what a client still sends, up to a bound.
async fn discard(read: &mut (impl AsyncRead + Unpin)) {
    let mut rest = read.take(DISCARD_BYTES as u64);
    // Whether it ended by a close, an error or the bound is all the same.
    tokio::io::copy(&mut rest, &mut tokio::io::sink()).await.unwrap_or_default();
}

/// Counts the requests of a second.
#[derive(Debug)]
struct Rate {
    limit: u32,
    count: u32,
    since: Option<Instant>,
}

impl Rate {
    fn new(limit: u32) -> Self {
        Self { limit, count: 0, since: None }
    }

    fn count(&mut self, now: Instant) -> Result<(), RequestError> {
        if self.since.is_none_or(|since| now.duration_since(since) >= Duration::from_secs(1)) {
            self.since = Some(now);
            self.count = 0;
        }
        self.count += 1;
        if self.count > self.limit { Err(RequestError::TooMany { limit: self.limit }) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn lines_end_at_newlines_and_nowhere_else() {
        // A buffer of 4 bytes: lines come in pieces.
        let mut read = BufReader::with_capacity(4, &b"{\"a\":1}\r\n\nx"[..]);
        assert_eq!(next_line(&mut read).await, Ok(Some(b"{\"a\":1}\r".to_vec())));
        assert_eq!(next_line(&mut read).await, Ok(Some(Vec::new())));
        assert_eq!(next_line(&mut read).await, Ok(None));
    }

    #[tokio::test]
    async fn a_line_without_end_is_not_collected_without_end() {
        let mut read = BufReader::with_capacity(READ_BYTES, tokio::io::repeat(b'x'));
        assert_eq!(next_line(&mut read).await, Err(RequestError::TooLong));
    }

    #[test]
    fn a_second_begins_with_its_first_request() {
        let mut rate = Rate::new(2);
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        assert!(rate.count(at(0)).is_ok() && rate.count(at(900)).is_ok());
        assert_eq!(rate.count(at(999)), Err(RequestError::TooMany { limit: 2 }));
        assert!(rate.count(at(1_000)).is_ok());
    }
}
