//! All clients, and the way to them.

use std::net::IpAddr;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use serde::Serialize;
use tokio::sync::Notify;

use super::class::Class;
use super::frame::{Frame, NotALine};
use super::hello::{ErrorLine, Hello};
use super::limits::Limits;
use super::queue::Queue;
use super::request::Request;
use super::subscriber::Subscriber;

/// Where a client is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Peer {
    /// On this machine: loopback or the Unix socket.
    Local,
    /// Elsewhere.
    Remote(IpAddr),
}

impl Peer {
    pub(super) fn of_address(address: IpAddr) -> Self {
        let address = address.to_canonical();
        if address.is_loopback() { Self::Local } else { Self::Remote(address) }
    }
}

/// The clients now and what was counted since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClientTotals {
    /// Connected now.
    pub clients: usize,
    /// Connected since the start.
    pub accepted: u64,
    /// Refused because there were too many.
    pub refused: u64,
    /// Cut off because they did not read.
    pub cut_off: u64,
    /// Data lines dropped because a client was behind.
    pub dropped: u64,
    /// Lines that wait for clients now.
    pub queued_lines: usize,
    /// Bytes that wait for clients now. A line that waits for several is counted for each, though it is there once.
    pub queued_bytes: usize,
}

/// All clients.
#[derive(Debug)]
pub(super) struct Hub {
    pub(super) limits: Limits,
    hello: Frame,
    clients: Mutex<Clients>,
    /// A client left.
    left: Notify,
    counts: Counts,
}

#[derive(Debug, Default)]
struct Clients {
    list: Vec<Member>,
    next_id: u64,
    /// Nobody is admitted any more.
    stopped: bool,
}

#[derive(Debug)]
struct Member {
    id: u64,
    peer: Peer,
    queue: Arc<Queue>,
}

#[derive(Debug, Default)]
struct Counts {
    accepted: AtomicU64,
    refused: AtomicU64,
    cut_off: AtomicU64,
    dropped: AtomicU64,
    publish_errors: AtomicUsize,
}

impl Hub {
    /// Without clients. HELLO is the same for all and serialised once.
    pub(super) fn new(limits: Limits, hello: &Hello) -> Result<Arc<Self>, NotALine> {
        let hello = frame(Class::Hello, hello)?;
        Ok(Arc::new(Self { limits, hello, clients: Mutex::default(), left: Notify::new(), counts: Counts::default() }))
    }

    /// A new client, if there is room; HELLO is the first thing that waits for it.
    pub(super) fn admit(self: &Arc<Self>, peer: Peer) -> Result<Admitted, ErrorLine> {
        let mut clients = self.lock();
        if let Some(refusal) = self.refusal(&clients, peer) {
            self.counts.refused.fetch_add(1, Ordering::Relaxed);
            return Err(refusal);
        }
        let queue = Arc::new(Queue::new(&self.limits));
        queue.control(self.hello.clone());
        let id = clients.next_id;
        clients.next_id += 1;
        clients.list.push(Member { id, peer, queue: Arc::clone(&queue) });
        self.counts.accepted.fetch_add(1, Ordering::Relaxed);
        Ok(Admitted { hub: Arc::clone(self), id, queue })
    }

    fn refusal(&self, clients: &Clients, peer: Peer) -> Option<ErrorLine> {
        if clients.stopped {
            return Some(stopping());
        }
        let (all, each) = (self.limits.clients, self.limits.clients_per_address);
        if clients.list.len() >= all {
            let message = format!("there are {all} clients already, and no more are served: end one of them");
            return Some(ErrorLine::closing("too_many_clients", message));
        }
        let of_this_address = clients.list.iter().filter(|member| member.peer == peer).count();
        if peer != Peer::Local && of_this_address >= each {
            let message = format!("there are {each} clients of your address already: end one of them");
            return Some(ErrorLine::closing("too_many_clients", message));
        }
        None
    }

    /// Tells everybody that the server ends, and admits nobody any more.
    pub(super) fn stop(&self) {
        let mut clients = self.lock();
        clients.stopped = true;
        let last = frame(Class::Error, &stopping()).ok();
        for member in &clients.list {
            member.queue.end(last.clone());
        }
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.lock().stopped
    }

    /// Waits until every client has left.
    pub(super) async fn all_left(&self) {
        while !self.lock().list.is_empty() {
            self.left.notified().await;
        }
    }

    pub(super) fn count_cut_off(&self) {
        self.counts.cut_off.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn totals(&self) -> ClientTotals {
        let clients = self.lock();
        let fills = clients.list.iter().map(|member| member.queue.fill());
        let (lines, bytes) = fills.fold((0, 0), |(lines, bytes), fill| (lines + fill.lines, bytes + fill.bytes));
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        ClientTotals {
            clients: clients.list.len(),
            accepted: read(&self.counts.accepted),
            refused: read(&self.counts.refused),
            cut_off: read(&self.counts.cut_off),
            dropped: read(&self.counts.dropped),
            queued_lines: lines,
            queued_bytes: bytes,
        }
    }

    fn wants(&self, class: Class) -> bool {
        self.lock().list.iter().any(|member| member.queue.wants(class))
    }

    fn send(&self, frame: &Frame) {
        let now = Instant::now();
        let clients = self.lock();
        let dropped: u64 = clients.list.iter().map(|member| member.queue.offer(frame, now)).sum();
        self.counts.dropped.fetch_add(dropped, Ordering::Relaxed);
    }

    /// Held for at most 32 pushes or removals; nothing waits for a client under it.
    fn lock(&self) -> MutexGuard<'_, Clients> {
        // A list of queues is whole after every statement; a panic elsewhere does not make it less so.
        self.clients.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A client that is on the list until this is dropped, however its task ends.
#[derive(Debug)]
pub(super) struct Admitted {
    pub(super) hub: Arc<Hub>,
    id: u64,
    pub(super) queue: Arc<Queue>,
}

impl Drop for Admitted {
    fn drop(&mut self) {
        self.hub.lock().list.retain(|member| member.id != self.id);
        self.hub.left.notify_one();
    }
}

/// The way to the clients for whoever measures. Cheap to clone; never waits for a client or the network.
#[derive(Clone, Debug)]
pub struct Publisher {
    hub: Arc<Hub>,
}

impl Publisher {
    pub(super) fn new(hub: Arc<Hub>) -> Self {
        Self { hub }
    }

    /// A client at `address` whose connection another server of the daemon holds; it counts as the stream's own do.
    ///
    /// # Errors
    /// There are too many, or the stream ends: what to tell it.
    pub fn join(&self, address: IpAddr, request: &Request) -> Result<Subscriber, ErrorLine> {
        let client = self.hub.admit(Peer::of_address(address))?;
        client.queue.apply(request);
        Ok(Subscriber::new(client))
    }

    /// Whether a client is subscribed to this class: ask before making a line that is costly to make.
    pub fn wants(&self, class: Class) -> bool {
        self.hub.wants(class)
    }

    /// Sends a line to all who subscribed to its class. `line` is serialised once, and not at all if nobody wants it; its
    /// first key has to be `class`.
    pub fn publish(&self, class: Class, line: &impl Serialize) {
        if self.wants(class) {
            self.send(frame(class, line));
        }
    }

    /// The same with a line that is already JSON: one object, its first key `class`, without a newline.
    pub fn publish_json(&self, class: Class, line: String) {
        if self.wants(class) {
            self.send(Frame::new(class, line));
        }
    }

    fn send(&self, frame: Result<Frame, NotALine>) {
        match frame {
            Ok(frame) => self.hub.send(&frame),
            // A bug of the program. Told once: a line of this kind may come 50 times a second.
            Err(error) => {
                if self.hub.counts.publish_errors.fetch_add(1, Ordering::Relaxed) == 0 {
                    tracing::error!("a line was not sent: {error}");
                }
            }
        }
    }
}

/// A payload as a frame.
pub(super) fn frame(class: Class, line: &impl Serialize) -> Result<Frame, NotALine> {
    match serde_json::to_string(line) {
        Ok(json) => Frame::new(class, json),
        Err(error) => Err(NotALine { class, found: error.to_string() }),
    }
}

fn stopping() -> ErrorLine {
    ErrorLine::closing("stopping", "the daemon stops: connect again when it runs".to_owned())
}

#[cfg(test)]
mod tests {
    use tumbled_model::UnixNs;

    use super::super::hello::StreamOrigin;
    use super::*;

    fn hub() -> Arc<Hub> {
        let hello = Hello::new("s", "rig", StreamOrigin::Live, UnixNs(0));
        Hub::new(Limits::default(), &hello).expect("a HELLO")
    }

    fn remote(last: u8) -> Peer {
        Peer::of_address(IpAddr::from([192, 168, 1, last]))
    }

    #[test]
    fn an_address_elsewhere_gets_four_clients_and_this_machine_all_thirty_two() {
        let hub = hub();
        let mut clients: Vec<Admitted> = (0..4).map(|_| hub.admit(remote(5)).expect("four")).collect();
        let refusal = hub.admit(remote(5)).expect_err("a fifth");
        assert_eq!((refusal.code.as_str(), refusal.closing), ("too_many_clients", true));
        clients.extend((0..28).map(|_| hub.admit(Peer::Local).expect("28 more")));
        assert!(hub.admit(Peer::Local).is_err() && hub.admit(remote(6)).is_err(), "32 in all");
        assert_eq!((hub.totals().clients, hub.totals().accepted, hub.totals().refused), (32, 32, 3));
        clients.truncate(3);
        assert!(hub.admit(remote(5)).is_ok(), "one of the address left");
    }

    #[test]
    fn loopback_is_this_machine_in_both_families_and_mapped() {
        for address in ["127.0.0.1", "127.8.9.1", "::1", "::ffff:127.0.0.1"] {
            assert_eq!(Peer::of_address(address.parse().expect("an address")), Peer::Local, "{address}");
        }
        let mapped = Peer::of_address("::ffff:10.0.0.7".parse().expect("an address"));
        assert_eq!(mapped, Peer::Remote(IpAddr::from([10, 0, 0, 7])));
    }

    #[test]
    fn nobody_is_admitted_after_the_stop() {
        let hub = hub();
        hub.stop();
        assert_eq!(hub.admit(Peer::Local).expect_err("stopped").code, "stopping");
    }
}
