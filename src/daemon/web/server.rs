//! What is served where.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::{WebSocketUpgrade, rejection::WebSocketUpgradeRejection};
use axum::extract::{ConnectInfo, DefaultBodyLimit, State};
use axum::http::StatusCode;
use axum::middleware;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use serde::Serialize;
use thiserror::Error;
use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};

use super::control::{self, ControlDoor};
use super::door::{Door, Peer};
use super::latest::Latest;
use super::reply::{JSON, guard, of_kind};
use super::{metrics, pages, transport};
use crate::config::DEFAULT_HTTP;
use crate::session::transport::Transport;
use crate::stream::bind;
use crate::stream::reach::{self, NonLive};
use crate::stream::{Hello, Publisher};

const PAGE: &str = include_str!("page/index.html");
const STYLE: &str = include_str!("page/page.css");
const WORDS: &str = include_str!("page/words.js");
const VIEW: &str = include_str!("page/view.js");
const PLOTS: &str = include_str!("page/plots.js");
const SCRIPT: &str = include_str!("page/page.js");
const ORDERS: &str = include_str!("page/orders.js");

const JAVASCRIPT: &str = "text/javascript; charset=utf-8";
pub(super) const TEXT: &str = "text/plain; charset=utf-8";

/// What a page may send at once, bytes: it sends nothing.
const MESSAGE_BYTES: usize = 4 * 1024;

/// Connections the kernel holds until they are accepted.
const BACKLOG: i32 = 64;

/// How long the runtime may take to end.
const RUNTIME_END: Duration = Duration::from_millis(200);

/// Where it listens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WebConfig {
    /// The address; port 0 takes a free one.
    pub address: SocketAddr,
    /// Whether data that are not live may be served beyond this machine.
    pub allow_nonlive: bool,
    /// Whether orders are taken, from this machine.
    pub control: bool,
}

/// Why it could not start.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WebError {
    /// The address cannot be had.
    #[error(
        "cannot listen on {address} for the operator's page: {source}; [stream] http names another address, port 0 takes a free one, empty is none"
    )]
    Address {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// An address that others reach, for data that are no measurement.
    #[error(transparent)]
    NonLive(#[from] NonLive),
    /// The thread could not be made.
    #[error("cannot start the operator's page: {0}")]
    Start(#[from] io::Error),
}

/// A running server. Dropped, it ends.
#[derive(Debug)]
pub struct WebServer {
    /// `None` once stopped.
    runtime: Option<Runtime>,
    address: SocketAddr,
    latest: Arc<Latest>,
    control: Arc<ControlDoor>,
}

/// What answers are made of.
#[derive(Clone, Debug)]
pub(super) struct Served {
    /// The hold on a replay.
    pub(super) transport: Option<Transport>,
    latest: Arc<Latest>,
    pub(super) control: Arc<ControlDoor>,
    publisher: Publisher,
    version: Arc<str>,
}

impl WebServer {
    /// Binds and serves what `publisher` publishes to pages, and what [`WebServer::latest`] is told to programs; pages steer
    /// a replay by `transport`. `None`: the default address is taken, which has been told.
    ///
    /// # Errors
    /// [`WebError`]: the address cannot be had, or must not be for these data.
    pub fn start(
        config: &WebConfig,
        hello: &Hello,
        publisher: Publisher,
        transport: Option<Transport>,
    ) -> Result<Option<Self>, WebError> {
        let address = config.address;
        reach::check("the operator's page", address, hello.origin, config.allow_nonlive)?;
        let listener = match bind::listen(address, BACKLOG) {
            Ok(listener) => listener,
            Err(error) if address == DEFAULT_HTTP && error.kind() == io::ErrorKind::AddrInUse => {
                tracing::warn!(
                    "{address} is taken: no operator's page. [stream] http names another address, e.g. 127.0.0.1:0"
                );
                return Ok(None);
            }
            Err(source) => return Err(WebError::Address { address, source }),
        };
        let address = listener.local_addr()?;
        let runtime =
            Builder::new_multi_thread().worker_threads(1).thread_name("web").enable_io().enable_time().build()?;
        let latest = Arc::new(Latest::default());
        let control = Arc::new(ControlDoor::new(config.control));
        let served = Served {
            transport,
            latest: Arc::clone(&latest),
            control: Arc::clone(&control),
            publisher,
            version: hello.version.as_str().into(),
        };
        let door = {
            // Sockets are registered with the runtime that is entered.
            let _entered = runtime.enter();
            Door::new(TcpListener::from_std(listener)?)
        };
        let service = router(served).into_make_service_with_connect_info::<Peer>();
        runtime.spawn(async move {
            if let Err(error) = axum::serve(door, service).await {
                tracing::error!("the operator's page ended: {error}");
            }
        });
        tracing::info!(http = %address, origin = hello.origin.name(), "operator's page at http://{address}/");
        Ok(Some(Self { runtime: Some(runtime), address, latest, control }))
    }

    /// Where it listens, with the port that was chosen.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What is to be told of each epoch and of health.
    pub fn latest(&self) -> Arc<Latest> {
        Arc::clone(&self.latest)
    }

    /// Where orders will go.
    pub fn control(&self) -> &ControlDoor {
        &self.control
    }

    /// Ends it; pages end with the state stream. Not to be called from an asynchronous task.
    pub fn stop(mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_timeout(RUNTIME_END);
        }
    }
}

impl Drop for WebServer {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

fn router(served: Served) -> Router {
    let file = |kind: &'static str, text: &'static str| get(move || async move { of_kind(StatusCode::OK, kind, text) });
    Router::new()
        .route("/", file("text/html; charset=utf-8", PAGE))
        .route("/page.css", file("text/css; charset=utf-8", STYLE))
        .route("/words.js", file(JAVASCRIPT, WORDS))
        .route("/view.js", file(JAVASCRIPT, VIEW))
        .route("/plots.js", file(JAVASCRIPT, PLOTS))
        .route("/orders.js", file(JAVASCRIPT, ORDERS))
        .route("/page.js", file(JAVASCRIPT, SCRIPT))
        .route("/healthz", get(healthz))
        .route("/api/state", get(api_state))
        .route("/api/health", get(api_health))
        .route("/api/control", get(control::report).post(control::order))
        .route("/api/transport", get(transport::report).post(transport::order))
        .route("/metrics", get(metrics_text))
        .route("/ws", get(page_socket))
        .fallback(|| async {
            of_kind(
                StatusCode::NOT_FOUND,
                TEXT,
                "there are /, /healthz, /api/state, /api/health, /api/control, /api/transport, /metrics\n",
            )
        })
        .layer(DefaultBodyLimit::max(control::BODY_BYTES))
        .layer(middleware::from_fn(guard))
        .with_state(served)
}

async fn healthz(State(served): State<Served>) -> Response {
    match served.latest.known().well() {
        Ok(()) => of_kind(StatusCode::OK, TEXT, "ok\n"),
        Err(reason) => of_kind(StatusCode::SERVICE_UNAVAILABLE, TEXT, format!("{reason}\n")),
    }
}

async fn api_state(State(served): State<Served>) -> Response {
    json(served.latest.known().state.as_deref())
}

async fn api_health(State(served): State<Served>) -> Response {
    json(served.latest.known().health.as_ref().map(|(_, line)| &**line))
}

/// A line, or null before the first.
pub(super) fn json(line: Option<&impl Serialize>) -> Response {
    let status = if line.is_some() { StatusCode::OK } else { StatusCode::SERVICE_UNAVAILABLE };
    match serde_json::to_string(&line) {
        Ok(text) => of_kind(status, JSON, text + "\n"),
        Err(error) => of_kind(StatusCode::INTERNAL_SERVER_ERROR, TEXT, format!("{error}\n")),
    }
}

async fn metrics_text(State(served): State<Served>) -> Response {
    let text = metrics::text(&served.latest.known(), &served.version);
    of_kind(StatusCode::OK, metrics::CONTENT_TYPE, text)
}

async fn page_socket(
    State(served): State<Served>,
    ConnectInfo(Peer(peer)): ConnectInfo<Peer>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    match upgrade {
        Ok(upgrade) => upgrade
            .max_message_size(MESSAGE_BYTES)
            .max_frame_size(MESSAGE_BYTES)
            .on_upgrade(move |socket| pages::serve(socket, peer.ip(), served.publisher)),
        Err(rejection) => rejection.into_response(),
    }
}
