//! A serial port without a device: a pseudo terminal, for what answers in a device's place.

use super::stop::StopToken;
use nix::errno::Errno;
use nix::fcntl::OFlag;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{self, BaudRate, SetArg};
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The device's end of a pseudo terminal. Clients open [`PseudoTerminal::path`] like a serial port; any may come and go.
#[derive(Debug)]
pub struct PseudoTerminal {
    device: PtyMaster,
    path: PathBuf,
    /// The clients' end, held open: without it the device's end fails whenever the last client has gone.
    _port: File,
}

impl PseudoTerminal {
    /// A new pseudo terminal: raw (no echo, no line ends changed), 115 200 baud for those who ask; it delivers at once.
    ///
    /// # Errors
    /// When the system has none.
    pub fn open() -> io::Result<Self> {
        let device = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC)?;
        grantpt(&device)?;
        unlockpt(&device)?;
        let path = PathBuf::from(ptsname_r(&device)?);
        let no_terminal_of_ours = OFlag::O_NOCTTY.bits();
        let port = OpenOptions::new().read(true).write(true).custom_flags(no_terminal_of_ours).open(&path)?;
        let mut settings = termios::tcgetattr(&port)?;
        termios::cfmakeraw(&mut settings);
        termios::cfsetspeed(&mut settings, BaudRate::B115200)?;
        termios::tcsetattr(&port, SetArg::TCSANOW, &settings)?;
        Ok(Self { device, path, _port: port })
    }

    /// What clients open, e.g. `/dev/pts/3`.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits until a client has written something, the time is over or the stop comes; whether something can be read.
    ///
    /// # Errors
    /// When the system cannot wait.
    pub fn wait(&self, time: Duration, stop: &StopToken) -> io::Result<bool> {
        let of = |fd| PollFd::new(fd, PollFlags::POLLIN);
        let mut waiting = [of(stop.as_fd()), of(self.device.as_fd())];
        let timeout = PollTimeout::try_from(time).unwrap_or(PollTimeout::MAX);
        match poll(&mut waiting, timeout) {
            Ok(_) => Ok(waiting.last().and_then(PollFd::any).unwrap_or(false)),
            Err(Errno::EINTR) => Ok(false),
            Err(errno) => Err(errno.into()),
        }
    }

    /// Reads what clients have written, as much as there is room for; 0: nothing.
    ///
    /// # Errors
    /// When the terminal is gone.
    pub fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self.device.read(into) {
            Err(error) if is_passing(&error) => Ok(0),
            read => read,
        }
    }

    /// Writes to whoever reads; how many of the bytes were taken. The kernel keeps some 4 kB that nobody reads; like a
    /// line without a listener, it takes no more then.
    ///
    /// # Errors
    /// When the terminal is gone.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.device.write(bytes) {
            Err(error) if is_passing(&error) => Ok(0),
            written => written,
        }
    }
}

fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_pass_unchanged_both_ways_and_clients_come_and_go() {
        let mut terminal = PseudoTerminal::open().expect("a pseudo terminal");
        let stop = StopToken::new().expect("a descriptor");
        for bytes in [&b"/01 1 00 get pos\n"[..], b"\r\x03\x04\x11\x13\0\xff"] {
            let mut client = OpenOptions::new().read(true).write(true).open(terminal.path()).expect("opens");
            client.write_all(bytes).expect("writes");
            assert!(terminal.wait(Duration::from_secs(10), &stop).expect("waits"));
            let mut read = [0; 64];
            let n = terminal.read(&mut read).expect("reads");
            assert_eq!(&read[..n], bytes);
            assert_eq!(terminal.write(bytes).expect("writes"), bytes.len());
            client.read_exact(&mut read[..bytes.len()]).expect("reads");
            assert_eq!(&read[..bytes.len()], bytes);
        }
        let mut nothing = [0; 8];
        assert_eq!(terminal.read(&mut nothing).expect("still there"), 0);
    }

    #[test]
    fn what_nobody_reads_is_bounded_and_a_stop_ends_the_wait() {
        let mut terminal = PseudoTerminal::open().expect("a pseudo terminal");
        let taken: usize = (0..1_000).map(|_| terminal.write(&[7; 1_000]).expect("there")).sum();
        assert!(taken < 1_000_000, "{taken}");
        let stop = StopToken::new().expect("a descriptor");
        stop.stop();
        assert!(!terminal.wait(Duration::from_secs(3_600), &stop).expect("waits"));
    }
}
