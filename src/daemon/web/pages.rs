//! The page's WebSocket: lines of the state stream, as many as a person can follow.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::time::{Duration, Instant};

use axum::extract::ws::{Message, WebSocket};
use tokio::time::timeout;

use crate::stream::request::Request;
use crate::stream::{Class, Publisher, Subscriber};

/// Between two STATE lines of a kind: 20 a second, and 10 predicted ones in all.
const EPOCH_PERIOD: Duration = Duration::from_millis(50);
const PREDICTED_PERIOD: Duration = Duration::from_millis(100);

/// Between two clouds of a sensor.
const CLOUD_PERIOD: Duration = Duration::from_millis(450);

/// What a page shows.
const SHOWN: [Class; 8] =
    [Class::State, Class::Health, Class::Cloud, Class::Event, Class::Point, Class::Model, Class::Contour, Class::Truth];

/// Where a line's first keys end at the latest: class, origin, kind or epoch and sensor.
const HEAD_BYTES: usize = 200;

/// Sensors whose clouds are thinned out each for itself; a rig has fewer.
const SENSORS: usize = 32;

/// Serves a page until it leaves, does not read or the daemon ends.
pub(super) async fn serve(mut socket: WebSocket, address: IpAddr, publisher: Publisher) {
    let classes = SHOWN.into_iter().collect();
    let request = Request { subscribe: Some(classes), period: None };
    match publisher.join(address, &request) {
        Ok(client) => lines(&mut socket, client).await,
        Err(refusal) => {
            let Ok(line) = serde_json::to_string(&refusal) else { return };
            if timeout(Duration::from_secs(1), socket.send(Message::text(line))).await.is_err() {
                tracing::debug!("a page that was refused did not read why");
            }
        }
    }
}

async fn lines(socket: &mut WebSocket, mut client: Subscriber) {
    let mut pace = Pace::default();
    loop {
        tokio::select! {
            line = client.next(|class, line| pace.is_due(class, line, Instant::now())) => {
                let Some(line) = line else { return };
                match timeout(client.lag(), socket.send(Message::text(line))).await {
                    Ok(Ok(())) => {}
                    Ok(Err(_)) => return,
                    Err(_) => return client.count_cut_off(),
                }
            }
            message = socket.recv() => match message {
                // The page says nothing but that it is there.
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => return,
            },
        }
    }
}

/// When the last line of each kind went.
#[derive(Debug, Default)]
struct Pace {
    sent: BTreeMap<String, Instant>,
}

impl Pace {
    fn is_due(&mut self, class: Class, line: &[u8], now: Instant) -> bool {
        let head = String::from_utf8_lossy(line.get(..HEAD_BYTES.min(line.len())).unwrap_or_default());
        let (key, period) = match class {
            Class::State if value(&head, "\"kind\":\"") == "epoch" => ("epoch".to_owned(), EPOCH_PERIOD),
            Class::State => ("predicted".to_owned(), PREDICTED_PERIOD),
            Class::Cloud => (format!("cloud of {}", value(&head, "\"sensor\":\"")), CLOUD_PERIOD),
            Class::Point => ("point".to_owned(), PREDICTED_PERIOD),
            Class::Truth => ("truth".to_owned(), PREDICTED_PERIOD),
            _ => return true,
        };
        let is_due = self.sent.get(&key).is_none_or(|sent| now.duration_since(*sent) >= period);
        if is_due && (self.sent.len() < SENSORS || self.sent.contains_key(&key)) {
            self.sent.insert(key, now);
        }
        is_due
    }
}

/// What stands after a key, up to the next quotation mark.
fn value<'a>(head: &'a str, key: &str) -> &'a str {
    head.split_once(key).and_then(|(_, rest)| rest.split('"').next()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_go_twenty_times_a_second_and_clouds_twice_for_each_sensor() {
        let mut pace = Pace::default();
        let start = Instant::now();
        let mut due = |class, line: &str, ms| pace.is_due(class, line.as_bytes(), start + Duration::from_millis(ms));
        let epoch = r#"{"class":"STATE","origin":"live","kind":"epoch","epoch":1"#;
        let predicted = r#"{"class":"STATE","origin":"live","kind":"predicted","epoch":1"#;
        assert!(due(Class::State, epoch, 0) && !due(Class::State, epoch, 49) && due(Class::State, epoch, 50));
        assert!(due(Class::State, predicted, 51) && !due(Class::State, predicted, 150));
        let cloud = |sensor: &str| format!(r#"{{"class":"CLOUD","origin":"live","epoch":3,"sensor":"{sensor}""#);
        assert!(due(Class::Cloud, &cloud("near"), 60) && due(Class::Cloud, &cloud("front"), 61));
        assert!(!due(Class::Cloud, &cloud("near"), 509) && due(Class::Cloud, &cloud("near"), 510));
        assert!(due(Class::Health, "{}", 510) && due(Class::Health, "{}", 511));
    }
}
