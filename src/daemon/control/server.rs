//! Serves the control socket: one connection after the other, each for a moment.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tumbled_io::live::StopToken;

use super::desk::Desk;
use super::orders::Reply;
use super::socket::{ControlError, Listener};

/// The longest request, bytes: a marker's text in escapes.
pub const MOST_LINE_BYTES: u64 = 8_192;
/// How long a client may take with its requests; others wait meanwhile.
const PATIENCE: Duration = Duration::from_secs(2);
/// How often a new connection is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// The running server.
#[derive(Debug)]
pub struct ControlServer {
    stop: StopToken,
    thread: JoinHandle<()>,
}

impl ControlServer {
    /// Takes orders from now on.
    ///
    /// # Errors
    /// No thread, no descriptor.
    pub fn start(listener: Listener, desk: Desk) -> Result<Self, ControlError> {
        let stop = StopToken::new().map_err(ControlError::Start)?;
        let until = stop.clone();
        let work = move || {
            loop {
                match listener.accept() {
                    Ok(client) => drop(serve(&desk, client)),
                    Err(_) if until.wait(LOOK_EVERY) => return,
                    Err(_) => {}
                }
                if until.is_stopped() {
                    return;
                }
            }
        };
        let thread = std::thread::Builder::new().name("control".to_owned()).spawn(work);
        Ok(Self { stop, thread: thread.map_err(ControlError::Start)? })
    }

    /// Takes no more.
    pub fn stop(self) {
        self.stop.stop();
        if self.thread.join().is_err() {
            tracing::error!("the control socket's thread had failed");
        }
    }
}

/// A client's requests, until it ends, says nothing for a while or says too much.
fn serve(desk: &Desk, client: UnixStream) -> io::Result<()> {
    client.set_nonblocking(false)?;
    client.set_read_timeout(Some(PATIENCE))?;
    client.set_write_timeout(Some(PATIENCE))?;
    let begun = Instant::now();
    let mut answers = client.try_clone()?;
    let mut requests = BufReader::new(client);
    while begun.elapsed() < PATIENCE {
        let mut line = Vec::new();
        let read = (&mut requests).take(MOST_LINE_BYTES).read_until(b'\n', &mut line)?;
        if read == 0 {
            return Ok(());
        }
        let is_whole = line.ends_with(b"\n");
        let reply = if is_whole || (read as u64) < MOST_LINE_BYTES {
            desk.carry_out(&line)
        } else {
            Reply::Error { message: format!("a request has {MOST_LINE_BYTES} bytes at most") }
        };
        let mut text = serde_json::to_vec(&reply).map_err(io::Error::other)?;
        text.push(b'\n');
        answers.write_all(&text)?;
        if !is_whole {
            return Ok(());
        }
    }
    Ok(())
}
