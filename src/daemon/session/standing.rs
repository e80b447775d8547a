//! How a source stands: told by its own thread, shown in health and in the report.

use std::sync::{Arc, Mutex, PoisonError};

use tumbled_io::live::{Device, Notice, SourceInfo};

/// How one source stands. Clones share it.
#[derive(Clone, Debug, Default)]
pub(super) struct Standing(Arc<Mutex<Stand>>);

/// What is known of a source at a moment.
#[derive(Clone, Debug, Default)]
pub(super) struct Stand {
    /// How often it was opened.
    pub(super) opened: u64,
    /// Why it does not deliver, and what to do; `None`: it is open, or was not tried yet.
    pub(super) cause: Option<String>,
}

impl Standing {
    /// What is known now.
    pub(super) fn now(&self) -> Stand {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Takes what happened to the source, and tells the log: the same cause again and again once.
    pub(super) fn take(&self, sensor: &str, notice: Notice) {
        let mut stand = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match notice {
            Notice::Opened(info) => {
                stand.opened += 1;
                stand.cause = None;
                opened(sensor, &info);
            }
            Notice::Failed { error, retry_in } => {
                let cause = error.to_string();
                if stand.cause.as_ref() == Some(&cause) {
                    tracing::debug!(%sensor, retry_in_ms = retry_in.as_millis() as u64, "still: {cause}");
                } else {
                    tracing::warn!(%sensor, retry_in_ms = retry_in.as_millis() as u64, "{cause}");
                    stand.cause = Some(cause);
                }
            }
            _ => {}
        }
    }
}

fn opened(sensor: &str, info: &SourceInfo) {
    match &info.device {
        Device::Udp(udp) => {
            let position = udp.position.map_or_else(|| "none".to_owned(), |address| address.to_string());
            tracing::info!(%sensor, data = %udp.data, %position, "receiving");
        }
        Device::Kinect(kinect) => {
            let model = kinect.model.map_or("unknown", |model| model.name());
            let serial = kinect.serial.as_deref().unwrap_or("unknown");
            let place = kinect.place.as_deref().unwrap_or("unknown");
            tracing::info!(%sensor, model, serial, place, recorded = kinect.recorded, "receiving from a Kinect");
        }
        Device::Serial(serial) => {
            let (port, baud) = (serial.path.display(), serial.baud);
            match serial.axis {
                Some(axis) => tracing::info!(%sensor, %port, baud, device = axis.device, axis = axis.axis, "reading"),
                None => tracing::info!(%sensor, %port, baud, "reading"),
            }
        }
        _ => tracing::info!(%sensor, "receiving"),
    }
    for warning in &info.warnings {
        tracing::warn!(%sensor, "{warning}");
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tumbled_io::live::{SourceError, SourceInfo};

    use super::*;

    #[test]
    fn a_cause_stands_until_the_source_is_open() {
        let standing = Standing::default();
        let failed = || Notice::Failed { error: SourceError::PortInUse { port: 2368 }, retry_in: Duration::ZERO };
        standing.take("front", failed());
        standing.take("front", failed());
        let stand = standing.now();
        assert!(stand.opened == 0 && stand.cause.is_some_and(|cause| cause.starts_with("UDP port 2368 is in use")));
        standing.take("front", Notice::Opened(SourceInfo::new("front".into(), Device::Stored)));
        let stand = standing.now();
        assert_eq!((stand.opened, stand.cause), (1, None));
    }
}
