//! What of a config may change while a session runs, and what needs a new one.

use crate::config::Loaded;
use crate::config::show::{self, KeyReport};

/// Keys that the core takes over in a running session: where things are, not what they are.
const CHANGEABLE: [&str; 6] =
    ["target.", "points_of_interest", "time.hold_ms", "time.silent_after_ms", "rig.calibration", "rig.name"];
/// The same for keys of each sensor.
const CHANGEABLE_OF_SENSORS: [&str; 4] = ["t_rig_lidar", "t_rig_kinect", "time_offset_ms", "intrinsics"];

/// How a config differs from the one in use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Change {
    /// Not at all.
    None,
    /// In keys that may change.
    Allowed(Vec<String>),
    /// In keys that need a new session: nothing is changed.
    Refused(Vec<String>),
}

/// Compares two configs key by key.
pub fn compare(now: &Loaded, next: &Loaded) -> Change {
    let (now, next) = (show::report(&now.tree).keys, show::report(&next.tree).keys);
    let differs = |key: &&KeyReport, others: &[KeyReport]| {
        others.iter().find(|other| other.key == key.key).is_none_or(|other| other.value != key.value)
    };
    let mut changed: Vec<String> = next.iter().filter(|key| differs(key, &now)).map(|key| key.key.clone()).collect();
    let gone = now.iter().filter(|key| next.iter().all(|other| other.key != key.key));
    changed.extend(gone.map(|key| key.key.clone()));
    let refused: Vec<String> = changed.iter().filter(|key| !is_changeable(key)).cloned().collect();
    match (changed.is_empty(), refused.is_empty()) {
        (true, _) => Change::None,
        (false, true) => Change::Allowed(changed),
        (false, false) => Change::Refused(refused),
    }
}

fn is_changeable(key: &str) -> bool {
    let of_rig = CHANGEABLE.iter().any(|allowed| key.starts_with(allowed));
    let mut steps = key.split('.');
    let of_sensor =
        matches!(steps.next(), Some("lidar" | "kinect")) && steps.any(|step| CHANGEABLE_OF_SENSORS.contains(&step));
    of_rig || of_sensor
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    fn with(settings: &[&str]) -> Loaded {
        let settings: Vec<String> = settings.iter().map(|setting| (*setting).to_owned()).collect();
        config::load(None, &settings).expect("a config")
    }

    #[test]
    fn mountings_offsets_and_the_region_may_change() {
        assert_eq!(compare(&with(&[]), &with(&[])), Change::None);
        let next = with(&["target.roi_radius_m=0.8", "lidar.front.time_offset_ms=1.5", "kinect.near.time_offset_ms=9"]);
        let Change::Allowed(mut keys) = compare(&with(&[]), &next) else { panic!("allowed") };
        keys.sort();
        assert_eq!(keys, ["kinect.near.time_offset_ms", "lidar.front.time_offset_ms", "target.roi_radius_m"]);
    }

    #[test]
    fn ports_and_models_need_a_new_session_and_are_named() {
        let next = with(&["target.roi_radius_m=0.8", "lidar.front.port=2370", "stream.tcp=127.0.0.1:0"]);
        let Change::Refused(mut keys) = compare(&with(&[]), &next) else { panic!("refused") };
        keys.sort();
        assert_eq!(keys, ["lidar.front.port", "stream.tcp"]);
    }
}
