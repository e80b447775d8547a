//! Real captures against the points expected of them (`../shared/data/velodyne`, skipped where that is absent).
//!
//! The tolerances are those of the captures' README: against the manual's formula in f64 1e-4°, 0.05 mm, 1 ns; against
//! velodyne-decoder 3.1.0, which rounds azimuths to 0.01° and takes one mean speed a packet, 0.035°, 0.5 mm, 1 µs.

mod support;

use support::{Expected, Worst, capture, compare, expected, udp};
use tumbled_velodyne::hdl64::{Calibration, Generation};
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};
use tumbled_velodyne::{LidarPoint, Model};

/// All points of a pcap's first `packets` data packets: packet number, point, jump flag.
fn decode(pcap: &[u8], settings: Settings, packets: usize) -> (StreamDecoder, Vec<(u64, LidarPoint, bool)>) {
    let mut decoder = StreamDecoder::new(settings);
    let mut out = Decoded::default();
    for (arrived, port, payload) in udp(pcap) {
        assert!(port == 2368 || port == 8308);
        decoder.push(payload, arrived, &mut out);
    }
    decoder.finish(&mut out);
    let points = out
        .packets
        .iter()
        .take(packets)
        .flat_map(|info| out.points.iter_range(info.points.clone()).map(move |p| (info.index, p, info.azimuth_jump)))
        .collect();
    (decoder, points)
}

/// velodyne-decoder's height of a beam: −f·tan(elevation), the elevation read off the point itself.
fn height(model: Model) -> impl Fn(&LidarPoint) -> f64 {
    let spec = model.spec().expect("built-in model");
    move |p| -spec.focal_mm * 1e-3 * libm::tan(spec.elevation_deg[usize::from(p.laser)].to_radians())
}

fn everywhere(_: &Expected) -> (bool, bool) {
    (true, true)
}

fn assert_within(worst: &Worst, azimuth_deg: f64, metres: f64, dt_ns: i64) {
    println!("{worst:?}");
    assert!(worst.azimuth_deg <= azimuth_deg, "{worst:?}");
    assert!(worst.range_m <= metres && worst.z_m <= metres, "{worst:?}");
    assert!(worst.dt_ns <= dt_ns && worst.intensity == 0, "{worst:?}");
}

#[test]
fn vlp32c_equals_the_manuals_formula() {
    let name = "vlp32c_strongest_600rpm_fov180_a";
    let (Some(pcap), Some(pts)) = (capture(&format!("{name}.pcap")), capture(&format!("{name}.ref.pts"))) else {
        return;
    };
    let (decoder, points) = decode(&pcap, Settings { vertical_offsets: Some(false), ..Settings::default() }, 228);
    let want = expected(&pts);
    assert_eq!(want.len(), 78_978);
    let worst = compare(&points, &want, |_| 0.0, |e| (true, !e.jump));
    assert_within(&worst, 1e-4, 5e-5, 1);
    assert!(worst.xyz_m <= 5e-5, "{worst:?}");
    let totals = decoder.tracker().totals();
    assert_eq!((totals.received, totals.lost, totals.pauses), (228, 0, 2), "the third pause is the last packet's");
    // 50 375 µs from stamp to stamp less one packet's 663.552 µs: 899 firing cycles of 55.296 µs.
    let silent = decoder.tracker().silent_sector().expect("a limited field of view");
    assert!((silent.pause_ns - 899 * 55_296).abs() <= 2_000, "{silent:?}");
    let rpm = decoder.tracker().rpm().expect("turning");
    assert!((rpm - 599.9).abs() < 0.5, "{rpm}");
}

fn against_velodyne_decoder(name: &str, settings: Settings, model: Model, packets: usize, points: usize) -> Option<()> {
    let (pcap, pts) = (capture(&format!("{name}.pcap"))?, capture(&format!("{name}.vd310.pts"))?);
    let want = expected(&pts);
    assert_eq!(want.len(), points);
    let (decoder, got) = decode(&pcap, Settings { vertical_offsets: Some(true), ..settings }, packets);
    let worst = compare(&got, &want, height(model), everywhere);
    assert_within(&worst, 0.035, 5e-4, 1_000);
    assert_eq!(decoder.tracker().totals().lost, 0);
    assert_eq!(decoder.period_mismatch(), None);
    Some(())
}

#[test]
fn vlp16_single_return() {
    against_velodyne_decoder("vlp16_strongest_600rpm", Settings::default(), Model::Vlp16, 80, 15_848);
}

#[test]
fn vlp16_dual_return() {
    against_velodyne_decoder("vlp16_dual_600rpm_a", Settings::default(), Model::Vlp16, 76, 7_794);
}

#[test]
fn vlp16_with_gps() {
    against_velodyne_decoder("vlp16_strongest_gps_600rpm", Settings::default(), Model::Vlp16, 20, 6_261);
}

#[test]
fn hdl32e() {
    against_velodyne_decoder("hdl32e_strongest_gps_700rpm", Settings::default(), Model::Hdl32e, 100, 28_551);
}

#[test]
fn hdl64e_s1() {
    let name = "hdl64e_s1_600rpm_a";
    let (Some(pcap), Some(csv), Some(pts)) =
        (capture(&format!("{name}.pcap")), capture("hdl64e_calibration.csv"), capture(&format!("{name}.vd310.pts")))
    else {
        return;
    };
    let csv = String::from_utf8(csv).expect("text");
    let calibration = Calibration::parse(&csv).expect("64 lasers");
    let settings = Settings { hdl64e_calibration: Some(calibration), ..Settings::default() };
    let (decoder, got) = decode(&pcap, settings, 50);
    assert_eq!(decoder.model(), Some(Model::Hdl64e));
    assert_eq!(decoder.hdl64().and_then(|h| h.generation()), Some(Generation::S1));
    let want = expected(&pts);
    assert_eq!(want.len(), 18_364);
    // The captures' README: firing times are estimates, and the azimuth within a block follows from them.
    let worst = compare(&got, &want, |_| 0.0, everywhere);
    println!("{worst:?}");
    assert!(worst.azimuth_deg <= 0.2 && worst.range_m <= 0.01 && worst.intensity <= 1, "{worst:?}");
}
