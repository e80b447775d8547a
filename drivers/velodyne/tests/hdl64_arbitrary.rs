//! Arbitrary bytes into every parser of the HDL-64E: an answer or a typed error, never a panic, and no point that is no
//! number. `PROPTEST_CASES` sets how many.

use proptest::prelude::*;
use tumbled_velodyne::hdl64::in_stream::{self, STREAM_LEN};
use tumbled_velodyne::hdl64::{Calibration, Hdl64Decoder, LASERS, LaserCalibration};
use tumbled_velodyne::{DataPacket, Points};

fn decoder(seed: u8) -> Hdl64Decoder {
    let laser = LaserCalibration { distance_m: f64::from(seed) / 100.0, ..LaserCalibration::default() };
    Hdl64Decoder::new((seed != 0).then(|| Calibration::new([laser; LASERS]).expect("plausible")))
}

/// Pieces that calibration files are made of, so that the parsers get past the first line.
fn piece() -> impl Strategy<Value = String> {
    prop_oneof![
        Just("lasers:\n".to_owned()),
        Just("laser_id,rot_correction,vert_correction,dist_correction\n".to_owned()),
        Just("- {laser_id: 1, rot_correction: 0".to_owned()),
        Just(", vert_correction: 0, dist_correction: 1}\n".to_owned()),
        Just("<DB><points_>".to_owned()),
        Just("<px><id_>1</id_><rotCorrection_>1</rotCorrection_>".to_owned()),
        Just("</px></points_></DB>".to_owned()),
        Just("1,0.1,0.1,nan\n".to_owned()),
        Just("&a *a ? : - [ { } ] , | > \" ' % @ ` ! \t\n".to_owned()),
        "\\PC{0,12}",
        "[-0-9.eE,:<>\\[\\]{}&*#\n ]{0,20}",
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn texts(pieces in prop::collection::vec(piece(), 0..40)) {
        let text = pieces.concat();
        match Calibration::parse(&text) {
            Ok(calibration) => prop_assert!(calibration.lasers().iter().all(|l| l.vertical_rad.abs() <= 0.8)),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn status_streams(bytes in prop::collection::vec(any::<u8>(), STREAM_LEN), at in 0usize..STREAM_LEN, s3: bool) {
        let mut stream: [u8; STREAM_LEN] = bytes.try_into().expect("the length asked for");
        for (i, byte) in b"UNIT#".iter().enumerate() {
            stream[(at + i) % STREAM_LEN] = *byte;
        }
        let end = (at + STREAM_LEN - 2) % STREAM_LEN;
        if !s3 {
            // S2 ends with 1820 = 0x071C: past the check into the numbers.
            stream[end] = 0x1C;
            stream[(end + 1) % STREAM_LEN] = 0x07;
        }
        if let Ok(found) = in_stream::parse(&stream, s3) {
            prop_assert!(found.calibration.lasers().iter().all(|l| l.distance_m.abs() <= 5.0));
        }
    }

    #[test]
    fn packets(
        seed: u8,
        packets in prop::collection::vec((prop::collection::vec(any::<u8>(), 1206), 0u8..4, any::<bool>()), 1..4),
    ) {
        let mut decoder = decoder(seed);
        let mut points = Points::default();
        for (mut bytes, order, tame) in packets {
            for block in 0..12usize {
                let lower = match order {
                    0 => block % 2 == 1,
                    1 => block % 4 == 0,
                    2 => bytes[100 * block] & 1 == 1,
                    _ => false,
                };
                bytes[100 * block..100 * block + 2].copy_from_slice(if lower { &[0xFF, 0xDD] } else { &[0xFF, 0xEE] });
                if tame {
                    bytes[100 * block + 3] %= 140; // 140 · 256 < 36 000
                }
            }
            let before = points.len();
            match decoder.decode(&DataPacket::new(&bytes).expect("1206 bytes"), &mut points) {
                Ok(packet) => {
                    prop_assert_eq!(points.len(), before + packet.points);
                    for point in points.iter_range(before..points.len()) {
                        prop_assert!(point.xyz.iter().all(|v| v.is_finite() && v.abs() < 150.0));
                        prop_assert!((0.0..core::f32::consts::TAU).contains(&point.azimuth_rad));
                    }
                }
                Err(error) => prop_assert!(!tame && points.len() == before, "{}", error),
            }
        }
    }
}
