//! A LiDAR's block.

use super::super::report::RateClock;
use super::super::report::hdl64e::{CalibrationSource, Hdl64eReport};
use super::super::report::lidar::{ClockReport, ClockState, LidarReport, LossReport, ModelSource};
use super::Page;
use super::figures::{counted, past_the_hour, percent, rate, seconds, spread, utc};

pub(super) fn block(page: &mut Page, lidar: &LidarReport) {
    page.heading(&format!("LiDAR {}: {}", lidar.id, model(lidar)));
    if let Some(hdl64e) = &lidar.hdl64e {
        this_hdl64e(page, hdl64e);
    }
    page.line("packets", &packets(lidar));
    if let (Some(packets), Some(points)) = (lidar.packets_per_s, lidar.points_per_s) {
        let clock = if lidar.rate_clock == Some(RateClock::Host) { " by the host's stamps" } else { "" };
        page.line("rates", &format!("{} packets/s, {} points/s{clock}", rate(packets), rate(points)));
    } else if let Some(packets) = lidar.packets_per_s {
        page.line("rates", &format!("{} packets/s by the host's stamps", rate(packets)));
    }
    if let Some(rpm) = lidar.rpm {
        page.line("speed", &format!("{rpm:.1} rpm"));
    }
    if lidar.data_packets > 0 {
        page.line("points", &points(lidar));
        page.line("view", &view(lidar));
    }
    if let Some(range) = &lidar.range_m {
        page.line("ranges", &spread(range, 2));
    }
    if let (Some(first), Some(last), Some(span)) = (lidar.first_stamp_us, lidar.last_stamp_us, lidar.device_span_s) {
        let (first, last) = (past_the_hour(first), past_the_hour(last));
        page.line("stamps", &format!("{first} to {last} past the hour, {}", seconds(span)));
    }
    clock(page, &lidar.clock);
    match &lidar.loss {
        Some(of_stamps) => page.line("loss", &loss(of_stamps, lidar.data_packets)),
        None if lidar.data_packets > 0 => page.line("loss", "unknown: this sensor sends no stamps"),
        None => {}
    }
    for refusal in &lidar.rejected {
        page.alert(&format!("not decoded: {} payloads, the first: {}", refusal.count, refusal.reason));
    }
    for warning in &lidar.warnings {
        page.alert(warning);
    }
}

fn model(lidar: &LidarReport) -> String {
    let source = match lidar.model_source {
        Some(ModelSource::ProductByte) => "by its product byte",
        Some(ModelSource::BlockStructure) => "by the structure of its packets",
        Some(ModelSource::Config) => "by the config",
        None => "",
    };
    match &lidar.model {
        Some(model) => format!("{model}, {source}"),
        None => "no packet of a known model".to_owned(),
    }
}

fn packets(lidar: &LidarReport) -> String {
    let modes = match lidar.return_modes.as_slice() {
        [] => String::new(),
        [only] => format!(" ({} return)", only.mode),
        several => {
            let each: Vec<String> = several.iter().map(|m| format!("{} {} return", m.packets, m.mode)).collect();
            format!(" ({})", each.join(", "))
        }
    };
    format!("{} data{modes}, {} position", lidar.data_packets, lidar.position_packets)
}

fn points(lidar: &LidarReport) -> String {
    let share = lidar.return_share.map(|share| format!(", a return from {} of the shots", percent(share)));
    let returns = lidar.returns;
    let dual = if returns.both > 0 || (returns.last > 0 && returns.strongest > 0) {
        format!("; {} last, {} strongest, {} both", returns.last, returns.strongest, returns.both)
    } else {
        String::new()
    };
    let heights = match (lidar.vertical_offsets, &lidar.hdl64e) {
        (_, Some(_)) | (None, _) => "",
        (Some(true), None) => "; vertical offsets on",
        (Some(false), None) => "; vertical offsets off",
    };
    format!("{}{}{dual}{heights}", lidar.points, share.unwrap_or_default())
}

fn view(lidar: &LidarReport) -> String {
    match &lidar.field_of_view {
        Some(view) if view.limited => {
            let seen = (view.to_deg - view.from_deg).rem_euclid(360.0);
            let (from, to, pause) = (view.from_deg, view.to_deg, view.pause_ms);
            format!("limited: {from:.2}° to {to:.2}° ({seen:.1}°), silent {pause:.1} ms a turn")
        }
        Some(_) => "all around, 360°".to_owned(),
        None if lidar.loss.is_none() => "unknown: this sensor sends no stamps".to_owned(),
        None => "unknown: less than a whole turn without loss".to_owned(),
    }
}

fn clock(page: &mut Page, clock: &ClockReport) {
    let state = match clock.state {
        ClockState::None => "none: this sensor sends no stamps",
        ClockState::FreeRunning => "free-running: stamps count from power-up, no UTC",
        ClockState::Contradicted => "no UTC: the NMEA time contradicts the stamps",
        ClockState::Sentence => "UTC by NMEA sentences, no pulse reported",
        ClockState::Locked => "UTC, locked to the receiver",
    };
    page.line("clock", state);
    if let Some(first_firing) = &clock.first_firing {
        page.line("first firing", &utc(first_firing));
    }
    if let Some(pps) = &clock.pps {
        let changes = match clock.pps_changes {
            0 => String::new(),
            n => format!(" (changed {n} times)"),
        };
        let s = clock.sentences;
        let named = [
            (s.valid, "valid"),
            (s.void, "void"),
            (s.bad_checksum, "with a wrong checksum"),
            (s.unusable, "unusable"),
            (s.missing, "missing"),
        ];
        let sentences: Vec<String> =
            named.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        page.line("PPS, NMEA", &format!("pulse {pps}{changes}; sentences: {}", sentences.join(", ")));
    }
    if let (Some(top), Some(bottom)) = (clock.temperature_top_c, clock.temperature_bottom_c) {
        page.line("temperature", &format!("{top} °C top board, {bottom} °C bottom board"));
    }
}

fn loss(loss: &LossReport, received: u64) -> String {
    let mut text = if loss.lost == 0 {
        "none".to_owned()
    } else {
        let share = percent(loss.lost as f64 / (loss.lost + received) as f64);
        let gaps = counted(loss.gaps, "place");
        format!("{} ({share}) in {gaps}, at most {} at once", counted(loss.lost, "packet"), loss.longest_gap)
    };
    for (count, what) in [(loss.duplicates, "came twice"), (loss.late, "late"), (loss.resets, "clock resets")] {
        if count > 0 {
            text.push_str(&format!("; {count} {what}"));
        }
    }
    if loss.pauses > 0 {
        text.push_str(&format!("; {} of the limited view, no loss", counted(loss.pauses, "pause")));
    }
    text
}

fn this_hdl64e(page: &mut Page, hdl64e: &Hdl64eReport) {
    let generation = hdl64e.generation.as_deref().unwrap_or("of unknown generation");
    let firmware = hdl64e.firmware.as_ref().map(|firmware| format!(", firmware {firmware}")).unwrap_or_default();
    let temperature = hdl64e.temperature_c.map(|t| format!(", {t:.1} °C")).unwrap_or_default();
    page.line("unit", &format!("{generation}{firmware}{temperature}"));
    let calibration = match (hdl64e.calibration, &hdl64e.awaiting) {
        (CalibrationSource::File, _) => "from the file".to_owned(),
        (CalibrationSource::InStream, _) => "from the packets".to_owned(),
        (CalibrationSource::None, Some(awaiting)) if awaiting.bytes > 0 => {
            format!("none yet: {} of {} bytes came in the packets", awaiting.bytes, awaiting.of)
        }
        (CalibrationSource::None, _) => "none: no point can be placed".to_owned(),
    };
    page.line("calibration", &calibration);
    if let Some(failure) = hdl64e.awaiting.as_ref().and_then(|awaiting| awaiting.failure.as_ref()) {
        page.alert(failure);
    }
    if let Some(unit) = &hdl64e.unit {
        let calibrated = unit.calibrated.as_deref().unwrap_or("at an unknown time");
        let (from, to) = (unit.view_from_deg, unit.view_to_deg);
        let set = format!("set to {} rpm, view {from:.2}° to {to:.2}°; {} h of operation", unit.rpm_set, unit.hours);
        page.line("", &format!("calibrated {calibrated}; {set}"));
    }
    if let Some(date_time) = &hdl64e.date_time {
        let gps = hdl64e.gps_status.as_ref().map(|status| format!(", GPS status {status}")).unwrap_or_default();
        page.line("its clock", &format!("{date_time}{gps}"));
    }
    for warning in &hdl64e.warnings {
        page.alert(warning);
    }
}
