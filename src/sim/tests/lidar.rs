//! Packets of the simulated Velodynes, decoded by the crate that decodes real ones, against the world that was cast.

mod support;

use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeMap;
use support::{config, cuboid, decode, hdl64e, quiet, room, sensor, still, target, vlp32c};
use tumbled_model::RigNs;
use tumbled_sim::lidar::{Gps, Head, LidarError, LidarModel, LidarParameters, View};
use tumbled_sim::shape::Material;
use tumbled_sim::world::{Ray, Role, World};
use tumbled_velodyne::beams::BeamTable;
use tumbled_velodyne::clock::{UtcClock, UtcState};
use tumbled_velodyne::hdl64::{self, Generation};
use tumbled_velodyne::position::PositionPacket;
use tumbled_velodyne::{LidarPoint, Model, Return, ReturnMode};

/// The ray a decoded point came along, by the decoder's own geometry, in the rig's frame.
fn ray(model: &LidarModel, point: &LidarPoint) -> Ray {
    let (origin, direction) = match &model.config().head {
        Head::BuiltIn(built_in) => {
            let table = BeamTable::new(built_in.spec().expect("built-in"), built_in.vertical_offsets_default());
            let height_m = table.beam(usize::from(point.laser)).expect("a laser").height_m;
            let to = Point3::from(point.xyz.map(f64::from));
            let origin = Point3::new(0.0, 0.0, height_m);
            (origin, (to - origin).normalize())
        }
        Head::Hdl64e { calibration, .. } => {
            let head_rad = f64::from(point.azimuth_rad) + calibration.lasers()[usize::from(point.laser)].rotation_rad;
            let ray = hdl64::Beams::new(calibration).ray(point.laser, head_rad).expect("a laser");
            (Point3::from(ray.origin), Vector3::from(ray.direction))
        }
    };
    let t_rig_lidar = model.config().t_rig_lidar;
    Ray { origin: t_rig_lidar * origin, direction: t_rig_lidar * direction }
}

/// Range less the distance to what the beam met at the point's own time. Points whose beam meets nothing are left out.
fn residuals(model: &LidarModel, world: &World, packets: u64, seed: u64) -> Vec<(LidarPoint, f64)> {
    let (_, out, times) = decode(model, world, packets, seed);
    let mut residuals = Vec::new();
    for info in &out.packets {
        let t = times[info.index as usize];
        for point in out.points.iter_range(info.points.clone()) {
            let at = RigNs(t.0 + i64::from(point.dt_ns));
            if let Some(hit) = world.at(at).cast(&ray(model, &point), 0.1) {
                residuals.push((point, f64::from(point.range_m) - hit.range_m));
            }
        }
    }
    residuals
}

fn mean_and_sigma(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let square = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>();
    (mean, (square / (values.len() - 1) as f64).sqrt())
}

/// The three heads, at every speed they have, with packets for more than a turn.
fn heads_and_speeds() -> Vec<(Head, u32, u64)> {
    let heads = [Head::BuiltIn(Model::Vlp32c), Head::BuiltIn(Model::Vlp16), hdl64e(Generation::S2)];
    // 320 packets of a VLP-32C are 0.212 s, of a VLP-16 0.425 s, 720 of an HDL-64E S2 0.207 s; a turn at 300 rpm takes 0.2 s.
    let packets = |head: &Head| if matches!(head, Head::Hdl64e { .. }) { 720 } else { 320 };
    let speeds = heads.into_iter().flat_map(|head| [300, 600, 1_200].map(|rpm| (head.clone(), rpm)));
    speeds.map(|(head, rpm)| (head.clone(), rpm, packets(&head))).collect()
}

#[test]
fn residuals_along_the_beam_have_the_injected_sigma_at_every_azimuth() {
    for (head, rpm, packets) in heads_and_speeds() {
        let mut config = config(head, ReturnMode::Strongest, rpm);
        config.parameters =
            LidarParameters { beam_bias_sigma_m: 0.0, footprint_mrad: 3.0, ..LidarParameters::default() };
        config.t_rig_lidar = Isometry3::new(Vector3::new(0.1, -0.2, 0.1), Vector3::new(0.01, -0.02, 0.3));
        let model = sensor(config);
        let mut bins: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for (point, residual) in residuals(&model, &room(), packets, 5) {
            bins.entry(f64::from(point.azimuth_rad).to_degrees() as usize / 30).or_default().push(residual);
        }
        assert_eq!(bins.len(), 12);
        let mut sigmas = Vec::new();
        for (bin, values) in bins {
            assert!(values.len() > 5_000, "{} of {} at {rpm}", values.len(), model.config().model());
            // 15 mm and the counts' 4/√12 = 1.15 mm: 15.04 mm; the mean to 5 standard errors of 15/√5000 mm.
            let (mean, sigma) = mean_and_sigma(&values);
            assert!((sigma / 0.015 - 1.0).abs() < 0.1, "{rpm} rpm, bin {bin}: {sigma}");
            assert!(mean.abs() < 0.001_1, "{rpm} rpm, bin {bin}: {mean}");
            sigmas.push(1e3 * sigma);
        }
        let (least, most) = sigmas.iter().fold((f64::MAX, 0.0_f64), |(low, high), s| (low.min(*s), high.max(*s)));
        println!("{} at {rpm} rpm: σ {least:.2} to {most:.2} mm in 12 sectors", model.config().model());
    }
}

#[test]
fn each_beam_has_its_own_bias_and_keeps_it() {
    let mut config = vlp32c();
    config.parameters = LidarParameters { range_sigma_m: 0.003, beam_bias_sigma_m: 0.010, ..quiet() };
    let model = sensor(config);
    let mut by_laser: BTreeMap<u8, Vec<f64>> = BTreeMap::new();
    for (point, residual) in residuals(&model, &room(), 150, 9) {
        by_laser.entry(point.laser).or_default().push(residual);
    }
    let biases = model.biases(9);
    let (_, spread) = mean_and_sigma(&biases);
    // 64 draws of σ 10 mm: ± 5 standard errors, 10/√128 mm.
    assert!((spread - 0.010).abs() < 0.0045, "{spread}");
    for (laser, values) in by_laser {
        let (mean, _) = mean_and_sigma(&values);
        // 1800 values of σ 3.2 mm: 5 standard errors are 0.38 mm.
        assert!((mean - biases[usize::from(laser)]).abs() < 0.000_5, "laser {laser}: {mean}");
    }
    assert_ne!(model.biases(10), biases);
}

#[test]
fn a_target_that_turns_shows_whether_points_have_their_own_times() {
    for (head, rpm, packets) in heads_and_speeds() {
        let mut config = config(head, ReturnMode::Strongest, rpm);
        config.parameters = LidarParameters { range_sigma_m: 0.002, ..quiet() };
        let world = target(20f64.to_radians());
        let model = sensor(config);
        let turn_ns = 60_000_000_000 / i64::from(rpm);
        let (_, out, times) = decode(&model, &world, 5 * packets, 3);
        let (mut own, mut at_the_turns_start) = (Vec::new(), Vec::new());
        for info in &out.packets {
            let t = times[info.index as usize];
            for point in out.points.iter_range(info.points.clone()) {
                let ray = ray(&model, &point);
                let at = t.0 + i64::from(point.dt_ns);
                let cast =
                    |t: i64| world.at(RigNs(t)).cast(&ray, 0.1).map(|hit| f64::from(point.range_m) - hit.range_m);
                // Beams off the edge of the box at the other time say nothing of it.
                if let (Some(right), Some(wrong)) = (cast(at), cast(at / turn_ns * turn_ns))
                    && wrong.abs() < 0.1
                {
                    own.push(right);
                    at_the_turns_start.push(wrong);
                }
            }
        }
        let name = format!("{} at {rpm} rpm", model.config().model());
        assert!(own.len() > 5_000, "{name}: {}", own.len());
        let ((mean, right), (_, wrong)) = (mean_and_sigma(&own), mean_and_sigma(&at_the_turns_start));
        println!("{name}: {:.2} mm, {:.2} mm with the turn's time for all its points", 1e3 * right, 1e3 * wrong);
        // 2 mm and the counts' 4/√12 mm, 2.31 mm (VLP-32C), or 2/√12 mm, 2.08 mm (the others).
        assert!((right - 0.002_2).abs() < 0.000_3 && mean.abs() < 0.000_2, "{name}: {right} {mean}");
        assert!(wrong > 2.0 * right, "{name}: {wrong} against {right}");
    }
}

#[test]
fn every_model_speed_and_mode_is_read_back_whole() {
    let s = ReturnMode::Strongest;
    let heads = [
        (Head::BuiltIn(Model::Vlp32c), vec![s, ReturnMode::Last, ReturnMode::Dual]),
        (Head::BuiltIn(Model::Vlp16), vec![s, ReturnMode::Last, ReturnMode::Dual]),
        (Head::BuiltIn(Model::Vlp16HiRes), vec![s]),
        (Head::BuiltIn(Model::Hdl32e), vec![s, ReturnMode::Dual]),
        (hdl64e(Generation::S2), vec![s]),
        (hdl64e(Generation::S3), vec![s, ReturnMode::Dual]),
    ];
    for (head, modes) in heads {
        for mode in modes {
            for rpm in [300, 600, 1_200] {
                let model = sensor(config(head.clone(), mode, rpm));
                let (decoder, out, _) = decode(&model, &room(), 120, 1);
                let name = format!("{} {mode} {rpm}", model.config().model());
                assert_eq!(decoder.model(), Some(model.config().model()), "{name}");
                assert_eq!((out.packets.len(), decoder.tracker().totals().lost), (120, 0), "{name}");
                // Every beam meets a wall; in dual return its one echo is sent twice and is one point.
                let per_packet = 384 / mode.blocks_per_firing();
                assert_eq!(out.points.len(), 120 * per_packet, "{name}");
                let ret = match mode {
                    ReturnMode::Strongest => Return::Strongest,
                    ReturnMode::Last => Return::Last,
                    ReturnMode::Dual => Return::Both,
                };
                let found = out.points.ret.iter().filter(|found| **found == ret).count();
                assert_eq!(found, out.points.len(), "{name}");
                let rpm_read = decoder.tracker().rpm().expect("turning");
                assert!((rpm_read - f64::from(rpm)).abs() < 0.02 * f64::from(rpm), "{name}: {rpm_read}");
            }
        }
    }
}

#[test]
fn a_limited_view_jumps_and_pauses_as_the_decoder_expects() {
    for (head, rpm, view) in [
        (Head::BuiltIn(Model::Vlp32c), 600, (270.0, 450.0)),
        (Head::BuiltIn(Model::Vlp16), 300, (100.0, 250.0)),
        (Head::BuiltIn(Model::Vlp32c), 1_200, (30.0, 110.0)),
        (hdl64e(Generation::S2), 600, (200.0, 460.0)),
    ] {
        let (from_deg, to_deg) = view;
        let mut config = config(head, ReturnMode::Strongest, rpm);
        config.view = View::Sector { from_deg, to_deg };
        let model = sensor(config);
        let (decoder, out, _) = decode(&model, &room(), 700, 1);
        let totals = decoder.tracker().totals();
        assert_eq!((out.packets.len(), totals.lost, totals.resets), (700, 0, 0));
        assert!(totals.pauses >= 2, "{totals:?}");
        // The sector's ends lie on firings, up to 0.4° from where they were set at 1200 rpm.
        let silent = decoder.tracker().silent_sector().expect("seen");
        assert!((f64::from(silent.width_cdeg) * 0.01 - (360.0 - to_deg + from_deg)).abs() < 1.0, "{silent:?}");
        // Stamps tell pauses to 1 µs: a beam that turned on for as long is off by 0.007° at most.
        for (point, residual) in residuals(&model, &room(), 700, 1) {
            assert!(residual.abs() < 0.004, "{point:?}: {residual}");
        }
    }
}

/// A board of 1 × 1 m at 2.5 m, its edges upright, before the room's wall or before another `behind_m` farther.
fn board_before(behind_m: f64) -> World {
    let board = |x: f64, width| still(cuboid([0.01, width, 1.0], Material::Matt), Role::Target, [x, 0.0, 0.0]);
    World::new(vec![board(2.5, 1.0), board(2.5 + behind_m, 4.0)])
}

#[test]
fn dual_return_reports_both_sides_of_an_edge() {
    let mut config = config(Head::BuiltIn(Model::Vlp32c), ReturnMode::Dual, 300);
    config.parameters.footprint_mrad = 3.0;
    let (_, out, _) = decode(&sensor(config), &board_before(1.5), 1_200, 2);
    let mut pairs = 0;
    let mut points = out.points.iter_range(0..out.points.len()).peekable();
    while let Some(point) = points.next() {
        match point.ret {
            // The last comes before the other return of its firing, and is the farther of the two.
            Return::Last => {
                let other = points.next_if(|next| next.ret == Return::Strongest).expect("a pair");
                assert_eq!((other.laser, other.dt_ns), (point.laser, point.dt_ns));
                assert!(point.range_m - other.range_m > 0.9, "{point:?} {other:?}");
                pairs += 1;
            }
            Return::Both => {}
            Return::Strongest => panic!("a strongest return without a last one: {point:?}"),
        }
    }
    // A footprint of 3 mrad crosses each upright edge in 3 mrad / 1.74 mrad ≈ 1.7 firings of each of about 25 lasers that
    // hit the board, twice a turn; 1200 packets of six groups are two turns at 300 rpm, of which each sees two edges.
    assert!((60..400).contains(&pairs), "{pairs}");
}

#[test]
fn edges_before_something_close_mix_and_before_something_far_do_not() {
    let between = |behind_m: f64, footprint_mrad: f64| {
        let mut config = config(Head::BuiltIn(Model::Vlp32c), ReturnMode::Strongest, 300);
        config.parameters.footprint_mrad = footprint_mrad;
        let (_, out, _) = decode(&sensor(config), &board_before(behind_m), 600, 2);
        // Boards are 10 mm thick; between them there is nothing.
        let gap = 2.53..2.47 + behind_m as f32;
        out.points.x.iter().zip(&out.points.y).filter(|(x, y)| gap.contains(*x) && y.abs() < 0.6).count()
    };
    assert!(between(0.5, 3.0) > 20, "{}", between(0.5, 3.0));
    assert_eq!((between(0.5, 0.0), between(1.5, 3.0)), (0, 0));
}

#[test]
fn dark_boards_answer_less_often_than_matt_ones() {
    let points = |material| {
        let world = World::new(vec![still(cuboid([0.01, 1.0, 1.0], material), Role::Target, [3.0, 0.0, 0.0])]);
        decode(&sensor(vlp32c()), &world, 1_500, 4).1.points.len() as f64
    };
    // exp(−(3/5)⁴) = 0.878 at 3 m and 0.864 at the corners, 3.08 m; incidence stays below 14°. Thousands of beams: 5
    // standard errors are below 0.02.
    let share = points(Material::Dark) / points(Material::Matt);
    assert!((share - 0.873).abs() < 0.025, "{share}");
}

#[test]
fn the_same_seed_gives_the_same_bytes_in_any_order() {
    let mut config = vlp32c();
    config.parameters = LidarParameters::default();
    config.view = View::Sector { from_deg: 120.0, to_deg: 260.0 };
    let (model, world) = (sensor(config), target(0.3));
    let forward: Vec<_> = (0..200).map(|index| model.packet(&world, index, 8)).collect();
    let again = sensor(model.config().clone());
    for index in (0..200).rev() {
        assert_eq!(again.packet(&world, index, 8), forward[index as usize]);
    }
    let other: Vec<_> = (0..200).map(|index| model.packet(&world, index, 9)).collect();
    assert!(forward.iter().zip(&other).any(|(a, b)| a.bytes != b.bytes));
}

#[test]
fn packets_are_found_by_time() {
    let model = sensor(vlp32c());
    // 663.552 µs a packet: the first that begins at 1 s or later is number 1508, at 1.000636 s.
    assert_eq!(model.first_packet_at(RigNs(1_000_000_000)), 1_508);
    assert_eq!(model.packet(&World::default(), 1_508, 0).t, RigNs(1_508 * 663_552));
    assert_eq!(model.first_packet_at(RigNs(-5)), 0);
}

#[test]
fn position_packets_say_what_the_scenario_has() {
    let state = |gps, locked| {
        let mut config = vlp32c();
        config.gps = gps;
        if locked {
            config.clock = tumbled_sim::clock::SimClock::locked(config.unix_at_zero);
        }
        let model = sensor(config);
        let mut clock = UtcClock::default();
        for index in 0..10 {
            let packet = model.position(index).expect("a VLP sends them");
            clock.update(&PositionPacket::parse(&packet.bytes).expect("512 bytes"));
        }
        clock.state()
    };
    assert_eq!(state(Gps::None, false), UtcState::FreeRunning);
    assert_eq!(state(Gps::Sentence, false), UtcState::Contradicted);
    assert_eq!(state(Gps::Locked, true), UtcState::Locked);
    assert!(sensor(config(hdl64e(Generation::S2), ReturnMode::Strongest, 600)).position(0).is_none());
}

#[test]
fn settings_no_sensor_has_are_refused() {
    let refused = |change: &dyn Fn(&mut tumbled_sim::lidar::LidarConfig)| {
        let mut config = vlp32c();
        change(&mut config);
        LidarModel::new(config).expect_err("refused")
    };
    assert_eq!(refused(&|config| config.rpm = 0), LidarError::Speed(0));
    assert_eq!(refused(&|config| config.head = Head::BuiltIn(Model::Hdl64e)), LidarError::NoCalibration);
    let (from_deg, to_deg) = (10.0, 370.0);
    let view = refused(&|config| config.view = View::Sector { from_deg, to_deg });
    assert_eq!(view, LidarError::View { from_deg, to_deg });
    let dual = refused(&|config| {
        config.head = hdl64e(Generation::S2);
        config.mode = ReturnMode::Dual;
    });
    assert_eq!(dual, LidarError::Generation { generation: Generation::S2, mode: ReturnMode::Dual });
}
