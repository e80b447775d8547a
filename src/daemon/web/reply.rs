//! Who may ask, and what every answer says about itself.

use std::net::{IpAddr, SocketAddr};

use axum::extract::Request;
use axum::http::StatusCode;
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderMap, HeaderValue, ORIGIN, X_CONTENT_TYPE_OPTIONS,
};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// The page loads nothing from elsewhere, and nobody shows it within a page of theirs.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Why others than [`is_of_this_machine`] order nothing.
pub(super) const ORDERS_FROM_HERE: &str = "orders are taken from this machine alone";

/// The kind of an answer that programs read.
pub(super) const JSON: &str = "application/json";

/// Refuses what another web page asks for, and marks every answer.
pub(super) async fn guard(request: Request, next: Next) -> Response {
    let mut response = match check(request.headers()) {
        Ok(()) => next.run(request).await,
        Err(refusal) => (StatusCode::FORBIDDEN, refusal).into_response(),
    };
    let headers = response.headers_mut();
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    response
}

/// Of another page, or by a name that another's name server may have turned to this machine.
fn check(headers: &HeaderMap) -> Result<(), &'static str> {
    let host = headers.get(HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    if !is_own(host) {
        return Err("ask by IP address or as localhost, e.g. http://127.0.0.1:8080/\n");
    }
    match headers.get(ORIGIN) {
        Some(origin) if origin.as_bytes().strip_prefix(b"http://") != Some(host.as_bytes()) => {
            Err("another web page may not read this one\n")
        }
        _ => Ok(()),
    }
}

/// Whether a `Host` names no one but whom it reached: an IP address or this machine, with a port or without.
fn is_own(host: &str) -> bool {
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !port.contains(']') => (name, port),
        _ => (host, ""),
    };
    let name = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    port.chars().all(|digit| digit.is_ascii_digit()) && (name == "localhost" || name.parse::<IpAddr>().is_ok())
}

/// Whether a peer is of this machine: only such a one may order anything.
pub(super) fn is_of_this_machine(peer: SocketAddr) -> bool {
    peer.ip().to_canonical().is_loopback()
}

/// Why an order with these headers is not read: its body must call itself JSON, which a form of another web page cannot.
pub(super) fn unread(headers: &HeaderMap) -> Option<(StatusCode, &'static str)> {
    let kind = headers.get(CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    let is_json = kind.split(';').next().map(str::trim) == Some(JSON);
    (!is_json).then_some((StatusCode::UNSUPPORTED_MEDIA_TYPE, "send an order with Content-Type: application/json"))
}

/// An answer of a kind.
pub(super) fn of_kind(status: StatusCode, kind: &'static str, body: impl IntoResponse) -> Response {
    (status, [(CONTENT_TYPE, HeaderValue::from_static(kind))], body).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(host: &'static str, origin: Option<&'static str>) -> Result<(), &'static str> {
        let mut headers = HeaderMap::new();
        headers.insert(HOST, HeaderValue::from_static(host));
        if let Some(origin) = origin {
            headers.insert(ORIGIN, HeaderValue::from_static(origin));
        }
        check(&headers)
    }

    #[test]
    fn its_own_page_may_ask_and_programs_too() {
        for host in ["127.0.0.1:8080", "localhost:8080", "localhost", "[::1]:8080", "192.168.1.7:80"] {
            assert_eq!(asked(host, None), Ok(()), "{host}");
        }
        assert_eq!(asked("127.0.0.1:8080", Some("http://127.0.0.1:8080")), Ok(()));
    }

    #[test]
    fn other_pages_may_not_and_neither_by_a_name_of_theirs() {
        for host in ["evil.example:8080", "", "127.0.0.1.evil.example", "localhost:80x"] {
            assert!(asked(host, None).is_err(), "{host}");
        }
        for origin in ["http://evil.example", "null", "https://127.0.0.1:8080", "http://127.0.0.1:8081"] {
            assert!(asked("127.0.0.1:8080", Some(origin)).is_err(), "{origin}");
        }
    }
}
