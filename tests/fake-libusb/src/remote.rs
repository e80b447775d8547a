//! Live control: a Unix socket that takes the script's faults, and says what the library holds.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::{fs, thread};

use fake_libusb_control::script::fault_of_device;

use crate::world::{lock, wake};

/// The longest line.
const LINE: u64 = 4_096;

/// Makes the socket and answers on it for as long as the process lives.
pub(crate) fn listen(path: &Path) -> io::Result<()> {
    if path.exists() {
        fs::remove_file(path)?;
    }
    let listener = UnixListener::bind(path)?;
    thread::Builder::new().name("usb-control".into()).spawn(move || {
        while let Ok((stream, _)) = listener.accept() {
            // A connection without a thread to answer it is closed, which its client notices.
            drop(thread::Builder::new().name("usb-control".into()).spawn(move || answer(stream)));
        }
    })?;
    Ok(())
}

/// Answers line by line until the client goes.
fn answer(mut stream: UnixStream) {
    let Ok(read) = stream.try_clone() else { return };
    let mut lines = BufReader::new(read);
    loop {
        let mut line = String::new();
        match lines.by_ref().take(LINE).read_line(&mut line) {
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        let reply = match obey(line.trim()) {
            Ok(done) => format!("ok {done}").trim_end().to_owned(),
            Err(reason) => format!("error: {reason}"),
        };
        if stream.write_all(format!("{reply}\n").as_bytes()).is_err() {
            return;
        }
    }
}

/// Does what a line says and returns when it is done.
fn obey(line: &str) -> Result<String, String> {
    let mut guard = lock();
    let world = guard.as_mut().ok_or("the host has not begun")?;
    if line == "status" {
        world.advance();
        let status = world.status().to_string();
        world.chronicle.flush();
        return Ok(status);
    }
    let (device, fault) = fault_of_device(line)?;
    let frame = world.apply(device, &fault)?;
    drop(guard);
    wake();
    Ok(frame.map_or_else(String::new, |frame| format!("frame {frame}")))
}
