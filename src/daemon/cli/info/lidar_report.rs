//! From a watched LiDAR to its part of the report.

use tumbled_velodyne::clock::UtcState;
use tumbled_velodyne::stream::Refused;
use tumbled_velodyne::track::{PacketTracker, StreamTotals};
use tumbled_velodyne::{Model, Product};

use super::hdl64e;
use super::lidar::LidarWatch;
use super::report::lidar::{
    Claim, ClockReport, ClockState, FieldOfView, LidarReport, LossReport, ModeCount, ModelSource,
};
use super::report::{RateClock, Refusal};

/// The report of one LiDAR; `host_times` says whether the inputs have times of their own.
pub(super) fn report(watch: &LidarWatch, host_times: bool) -> LidarReport {
    let (decoder, counts) = (&watch.decoder, watch.decoder.counts());
    let stamps = watch.timeline.stamps();
    let (packets_per_s, rate_clock) = packet_rate(watch, host_times);
    let points_per_packet = (counts.data_packets > 0).then(|| counts.points as f64 / counts.data_packets as f64);
    let (shots, hit) = watch.shots;
    LidarReport {
        id: watch.id.clone(),
        model: decoder.model().map(|model| model.name().to_owned()),
        model_source: decoder.model().map(|model| model_source(watch.forced, model)),
        claims: watch.claims.iter().map(|(product, packets)| claim(*product, *packets)).collect(),
        data_packets: counts.data_packets,
        position_packets: counts.position_packets,
        rejected: counts.rejected.values().map(refusal).collect(),
        return_modes: counts.modes.iter().map(|(mode, n)| ModeCount { mode: mode.to_string(), packets: *n }).collect(),
        points: counts.points,
        returns: watch.returns,
        return_share: (shots > 0).then(|| hit as f64 / shots as f64),
        packets_per_s,
        points_per_s: packets_per_s.zip(points_per_packet).map(|(packets, points)| packets * points),
        rate_clock,
        rpm: watch.head.rpm().filter(|_| stamps.is_some() || host_times),
        vertical_offsets: decoder.vertical_offsets(),
        first_stamp_us: stamps.map(|(first, _)| first.0),
        last_stamp_us: stamps.map(|(_, last)| last.0),
        device_span_s: stamps.map(|_| watch.timeline.elapsed_ns() as f64 * 1e-9),
        clock: clock(watch),
        loss: stamps.map(|_| loss(decoder.tracker().totals())),
        field_of_view: stamps.and_then(|_| field_of_view(decoder.tracker(), watch.head.whole_turn())),
        range_m: watch.ranges.spread(),
        hdl64e: decoder.hdl64().map(|hdl64| hdl64e::report(hdl64, watch.has_calibration_file)),
        warnings: warnings(watch),
    }
}

fn model_source(forced: Option<Model>, model: Model) -> ModelSource {
    match (forced, model) {
        (Some(_), _) => ModelSource::Config,
        (None, Model::Hdl64e) => ModelSource::BlockStructure,
        (None, _) => ModelSource::ProductByte,
    }
}

fn claim(product: Product, packets: u64) -> Claim {
    Claim { product: product.to_string(), packets }
}

/// By the sensor's stamps, or by the host's where it has none.
fn packet_rate(watch: &LidarWatch, host_times: bool) -> (Option<f64>, Option<RateClock>) {
    if watch.timeline.stamps().is_some() {
        let rate = device_rate(watch);
        return (rate, rate.map(|_| RateClock::Device));
    }
    let Some((first, newest, count)) = watch.host.filter(|_| host_times) else { return (None, None) };
    let span_s = (newest - first).as_secs_f64();
    let rate = (count > 1 && span_s > 0.0).then(|| (count - 1) as f64 / span_s);
    (rate, rate.map(|_| RateClock::Host))
}

/// Over whole turns where the view is limited: a short capture may begin and end anywhere in the view, and would have
/// its silences counted too often or too seldom.
fn device_rate(watch: &LidarWatch) -> Option<f64> {
    let tracker = watch.decoder.tracker();
    let turn_ns = watch.head.rpm().filter(|rpm| *rpm > 0.0).map(|rpm| 60e9 / rpm);
    let (Some(silent), Some(turn_ns)) = (tracker.silent_sector(), turn_ns) else {
        return watch.timeline.packets_per_s(0);
    };
    let silent_ns = silent.pause_ns.saturating_mul(tracker.totals().pauses as i64);
    let in_view = watch.timeline.packets_per_s(silent_ns)?;
    Some(in_view * (1.0 - silent.pause_ns as f64 / turn_ns).max(0.0))
}

fn clock(watch: &LidarWatch) -> ClockReport {
    let clock = watch.decoder.clock();
    // Text tails have no stamp in them: every S1, early S2.
    let clockless = watch.decoder.hdl64().is_some_and(|hdl64| hdl64.status().text == Some(true));
    let temperature_c = clock.temperature_c();
    let first_firing = watch.timeline.first_utc().map(|utc| utc + watch.first_firing());
    ClockReport {
        state: match clock.state() {
            _ if clockless => ClockState::None,
            UtcState::FreeRunning => ClockState::FreeRunning,
            UtcState::Contradicted => ClockState::Contradicted,
            UtcState::Sentence => ClockState::Sentence,
            UtcState::Locked => ClockState::Locked,
        },
        first_firing: first_firing.map(Into::into),
        pps: clock.pps().map(|pps| pps.to_string()),
        pps_changes: clock.pps_changes(),
        sentences: watch.sentences,
        temperature_top_c: temperature_c.map(|(top, _)| top),
        temperature_bottom_c: temperature_c.map(|(_, bottom)| bottom),
        thermal_shutdowns: watch.thermal_shutdowns,
    }
}

fn loss(totals: StreamTotals) -> LossReport {
    LossReport {
        lost: totals.lost,
        gaps: totals.gaps,
        longest_gap: totals.longest_gap,
        duplicates: totals.duplicates,
        late: totals.late,
        resets: totals.resets,
        pauses: totals.pauses,
    }
}

fn field_of_view(tracker: &PacketTracker, whole_turn: bool) -> Option<FieldOfView> {
    let Some(silent) = tracker.silent_sector() else {
        return whole_turn.then_some(FieldOfView { limited: false, from_deg: 0.0, to_deg: 360.0, pause_ms: 0.0 });
    };
    let first_cdeg = (u32::from(silent.from_cdeg) + u32::from(silent.width_cdeg)) % 36_000;
    Some(FieldOfView {
        limited: true,
        from_deg: f64::from(first_cdeg) / 100.0,
        to_deg: f64::from(silent.from_cdeg) / 100.0,
        pause_ms: silent.pause_ns as f64 * 1e-6,
    })
}

/// What a person should know that no other field says in words.
fn warnings(watch: &LidarWatch) -> Vec<String> {
    let decoder = &watch.decoder;
    let mut warnings = Vec::new();
    warnings.extend(decoder.period_mismatch().map(|mismatch| mismatch.to_string()));
    if let Some(forced) = watch.forced {
        for (product, packets) in &watch.claims {
            if !matches!(product, Product::Supported(model) if *model == forced) {
                let claimed = product.to_string();
                let old_vlp16 = (*product, forced) == (Product::Supported(Model::Hdl32e), Model::Vlp16);
                let known = if old_vlp16 && decoder.period_mismatch().is_none() {
                    " (a VLP-16 with firmware before 3.0.29 says so)"
                } else {
                    ""
                };
                let says = format!("{packets} packets say {claimed}, lidar.model says {forced}: decoded as {forced}");
                warnings.push(format!("{says}{known}"));
            }
        }
    }
    let resets = decoder.tracker().totals().resets;
    if resets > 0 {
        warnings.push(format!("the sensor's clock was set anew {resets} times: losses around it are unknown"));
    }
    if resets > 0 && watch.timeline.first_utc().is_none() && decoder.clock().state() >= UtcState::Sentence {
        warnings.push("stamps are UTC only since the clock was last set: the first firing's UTC is unknown".to_owned());
    }
    if decoder.clock().state() == UtcState::Contradicted {
        warnings.push("the NMEA time contradicts the stamps: no UTC; check the sensor's PPS input".to_owned());
    }
    if watch.sentences.bad_checksum > 0 {
        let broken = watch.sentences.bad_checksum;
        warnings
            .push(format!("{broken} NMEA sentences with a wrong checksum: check the receiver's wiring and baud rate"));
    }
    if watch.thermal_shutdowns > 0 {
        warnings.push("the sensor reports that it shut its lasers down because of heat: cool it".to_owned());
    }
    warnings
}

fn refusal(refused: &Refused) -> Refusal {
    Refusal { reason: refused.first.to_string(), count: refused.count }
}
