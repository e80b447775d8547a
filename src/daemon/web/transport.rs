//! A replay steered from the page.

use axum::body::Bytes;
use axum::extract::{ConnectInfo, State};
use axum::http::StatusCode;
use axum::http::header::HeaderMap;
use axum::response::Response;

use super::door::Peer;
use super::reply::{ORDERS_FROM_HERE, is_of_this_machine, of_kind, unread};
use super::server::{Served, TEXT, json};
use crate::session::transport::TransportOrder;

/// `GET /api/transport`: how the replay plays; null where there is none.
pub(super) async fn report(State(served): State<Served>, ConnectInfo(Peer(peer)): ConnectInfo<Peer>) -> Response {
    let report = served.transport.as_ref().map(|transport| transport.report(is_of_this_machine(peer)));
    json(Some(&report))
}

/// `POST /api/transport`, from this machine alone.
pub(super) async fn order(
    State(served): State<Served>,
    ConnectInfo(Peer(peer)): ConnectInfo<Peer>,
    headers: HeaderMap,
    line: Bytes,
) -> Response {
    let Some(transport) = &served.transport else { return refused(StatusCode::NOT_FOUND, "this is no replay") };
    if !is_of_this_machine(peer) {
        return refused(StatusCode::FORBIDDEN, ORDERS_FROM_HERE);
    }
    if let Some((status, why)) = unread(&headers) {
        return refused(status, why);
    }
    let order = serde_json::from_slice::<TransportOrder>(&line).map_err(|error| {
        format!(
            "no order: {error}; e.g. {{\"do\":\"pause\"}}, {{\"do\":\"speed\",\"value\":4}}, {{\"do\":\"to\",\"value\":12.5}}"
        )
    });
    match order.and_then(|order| transport.order(&order)) {
        Ok(()) => json(Some(&transport.report(true))),
        Err(message) => refused(StatusCode::BAD_REQUEST, &message),
    }
}

fn refused(status: StatusCode, why: &str) -> Response {
    of_kind(status, TEXT, format!("{why}\n"))
}
