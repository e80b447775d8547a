//! Orders from the operator's page: the lines of the control socket, where the config allows it and from this machine alone.

use std::net::SocketAddr;
use std::sync::OnceLock;

use axum::body::Bytes;
use axum::extract::{ConnectInfo, State};
use axum::http::StatusCode;
use axum::http::header::HeaderMap;
use axum::response::Response;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::door::Peer;
use super::reply::{JSON, ORDERS_FROM_HERE, is_of_this_machine, of_kind, unread};
use super::server::Served;
use crate::control::{Desk, MOST_LINE_BYTES, Order, RecordingReply, Reply};

/// The most bytes of a request that are read.
pub(super) const BODY_BYTES: usize = MOST_LINE_BYTES as usize;

/// Whether orders are taken here, and where they go once the session runs.
#[derive(Debug, Default)]
pub struct ControlDoor {
    allowed: bool,
    desk: OnceLock<Desk>,
}

impl ControlDoor {
    /// As `[stream] http_control` says.
    pub fn new(allowed: bool) -> Self {
        Self { allowed, desk: OnceLock::new() }
    }

    /// The session runs: its orders go to this desk. Only the first counts.
    pub fn open(&self, desk: Desk) {
        self.desk.get_or_init(|| desk);
    }

    /// The desk, for a peer that may give orders.
    fn desk(&self, peer: SocketAddr) -> Result<&Desk, &'static str> {
        if !self.allowed {
            return Err("no orders are taken here: [stream] http_control = true allows them; `tumbled ctl` gives them");
        }
        if !is_of_this_machine(peer) {
            return Err(ORDERS_FROM_HERE);
        }
        self.desk.get().ok_or("nothing can be ordered here: this is a replay, or the session has not begun")
    }
}

/// What may be ordered here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled GET /api/control")]
pub struct ControlReport {
    /// Whether the one who asks may give orders.
    pub allowed: bool,
    /// Why not, and what to do; null: they may.
    pub why: Option<String>,
    /// The orders; none where none are allowed.
    pub orders: Vec<Order>,
    /// What is being recorded; null: nothing, or that is not told because no orders are allowed.
    pub recording: Option<RecordingReply>,
}

/// `GET /api/control`.
pub(super) async fn report(State(served): State<Served>, ConnectInfo(Peer(peer)): ConnectInfo<Peer>) -> Response {
    let report = match served.control.desk(peer) {
        Ok(desk) => {
            ControlReport { allowed: true, why: None, orders: Order::ALL.to_vec(), recording: desk.recording() }
        }
        Err(why) => ControlReport { allowed: false, why: Some(why.to_owned()), orders: Vec::new(), recording: None },
    };
    answer(StatusCode::OK, &report)
}

/// `POST /api/control`.
pub(super) async fn order(
    State(served): State<Served>,
    ConnectInfo(Peer(peer)): ConnectInfo<Peer>,
    headers: HeaderMap,
    line: Bytes,
) -> Response {
    let refused = |status, message: String| answer(status, &Reply::Error { message });
    let desk = match served.control.desk(peer) {
        Ok(desk) => desk.clone(),
        Err(why) => return refused(StatusCode::FORBIDDEN, why.to_owned()),
    };
    if let Some((status, why)) = unread(&headers) {
        return refused(status, why.to_owned());
    }
    // A snapshot takes as long as the disk does: not on the thread that serves the page.
    match tokio::task::spawn_blocking(move || desk.carry_out(&line)).await {
        Ok(reply @ Reply::Done { .. }) => answer(StatusCode::OK, &reply),
        Ok(reply @ Reply::Error { .. }) => answer(StatusCode::BAD_REQUEST, &reply),
        Err(error) => refused(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()),
    }
}

fn answer(status: StatusCode, line: &impl Serialize) -> Response {
    match serde_json::to_string(line) {
        Ok(text) => of_kind(status, JSON, text + "\n"),
        Err(error) => {
            of_kind(StatusCode::INTERNAL_SERVER_ERROR, JSON, format!("{}\n", serde_json::json!(error.to_string())))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_door_that_is_shut_says_why_to_each() {
        let here: SocketAddr = "127.0.0.1:50000".parse().expect("an address");
        let there: SocketAddr = "192.168.1.5:50000".parse().expect("an address");
        let mapped: SocketAddr = "[::ffff:127.0.0.1]:50000".parse().expect("an address");
        let why = |door: &ControlDoor, peer| door.desk(peer).err().unwrap_or_default();
        assert!(why(&ControlDoor::default(), here).contains("http_control = true"));
        let allowed = ControlDoor::new(true);
        assert!(why(&allowed, there).contains("this machine alone"));
        assert!(why(&allowed, here).contains("has not begun") && why(&allowed, mapped).contains("has not begun"));
    }
}
