//! Real frames: what the decoder makes of them, against the tables and images they came with.
//!
//! The captures are not part of the repository; without them each test prints what it skipped.

mod capture_files;

use bytes::Bytes;
use capture_files::{csv_pairs, grey16, read, read_text};
use tumbled_kinect::{
    BackProjector, DepthImage, DepthTable, Freshness, FrozenDetector, Intrinsics, MmImage, NoiseModel, Points,
    RawDisparity, RawImage, RepeatCause, ZeroPlane, decode_metres, decode_mm, decode_raw, encode_raw,
};
use tumbled_model::{DepthEncoding, PacketMask};

const RAW_ENCODINGS: [DepthEncoding; 2] = [DepthEncoding::Packed11, DepthEncoding::Raw11];

/// The camera of the seq7 frames, as published with them.
const SEQ7_CAMERA: Intrinsics =
    Intrinsics { fx: 585.0, fy: 585.0, cx: 320.0, cy: 240.0, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 };

fn mm_of(encoding: DepthEncoding, bytes: &[u8], table: &DepthTable) -> MmImage {
    let mut mm = MmImage::new();
    decode_mm(encoding, bytes, &PacketMask::NONE, table, &mut mm).expect("a whole frame");
    mm
}

fn raw_image(codes: &[u16]) -> RawImage {
    let mut image = RawImage::new();
    assert_eq!(codes.len(), image.pixels().len());
    for (pixel, &code) in image.pixels_mut().iter_mut().zip(codes) {
        *pixel = RawDisparity(code);
    }
    image
}

/// Frame `n` of seq7 as a recorder of 16-bit millimetres would have it.
fn read_frame(n: usize) -> Option<Vec<u8>> {
    let mm = grey16(&format!("kinect/seq7/frame-{n:06}.depth.png"))?;
    Some(mm.iter().flat_map(|mm| mm.to_le_bytes()).collect())
}

/// Depths as a decoder without millimetres past 10 m gives them.
fn without_markers(mm: Vec<u16>) -> Vec<u16> {
    mm.into_iter().map(|mm| if mm >= 10_000 { 0 } else { mm }).collect()
}

#[test]
fn factory_law_is_libfreenects_table_row_by_row() {
    let Some(text) = read_text("kinect/raw_to_mm_nominal.csv") else { return };
    let rows = csv_pairs(&text);
    assert_eq!(rows.len(), 2_048);
    let law = DepthTable::from_law(&ZeroPlane::default());
    for &(code, mm) in &rows {
        let expected = if code < 1_055 { mm } else { 0 };
        assert_eq!(law.mm()[usize::from(code)], expected, "raw {code}");
    }
    // The same table read as a device's own: its overflowed end stands for no data.
    let read: DepthTable = text.parse().expect("a table");
    assert_eq!(read.mm(), law.mm());
}

#[test]
fn nyu_frame_decodes_to_the_factory_table_packed_and_unpacked() {
    let (Some(dump), Some(codes)) = (read("kinect/raw11/nyu_raw11_le.pgm"), grey16("kinect/raw11/nyu_raw11.png"))
    else {
        return;
    };
    let Some(nominal) = read_text("kinect/raw_to_mm_nominal.csv") else { return };
    let nominal = csv_pairs(&nominal);
    let dump = dump.strip_prefix(b"P5 640 480 65535\n").expect("the header of a depth dump");
    let image = raw_image(&codes);
    assert_eq!(encode_raw(&image, DepthEncoding::Raw11).expect("eleven bits"), dump, "dump and PNG are one frame");

    let expected: Vec<u16> =
        codes.iter().map(|&code| if code < 1_055 { nominal[usize::from(code)].1 } else { 0 }).collect();
    let table = DepthTable::from_law(&ZeroPlane::default());
    let packed = encode_raw(&image, DepthEncoding::Packed11).expect("eleven bits");
    assert!(mm_of(DepthEncoding::Packed11, &packed, &table).pixels() == expected);
    assert!(mm_of(DepthEncoding::Raw11, dump, &table).pixels() == expected);

    let mut raw = RawImage::new();
    decode_raw(DepthEncoding::Packed11, &packed, &PacketMask::NONE, &mut raw).expect("a whole frame");
    assert!(raw == image, "the frame holds codes below 1055 and 2047 only");
}

#[test]
fn seq7_disparities_decode_to_the_recorded_millimetres() {
    let Some(text) = read_text("kinect/seq7/raw_to_mm_seq7.csv") else { return };
    let table: DepthTable = text.parse().expect("a table");
    assert_eq!(table.depths(), 345);
    for n in 0..10 {
        let Some(codes) = grey16(&format!("kinect/seq7_raw11/frame-{n:06}.raw11.png")) else { return };
        let Some(mm) = grey16(&format!("kinect/seq7/frame-{n:06}.depth.png")) else { return };
        let expected = without_markers(mm);
        for encoding in RAW_ENCODINGS {
            let bytes = encode_raw(&raw_image(&codes), encoding).expect("eleven bits");
            assert!(mm_of(encoding, &bytes, &table).pixels() == expected, "frame {n}, {encoding:?}");
            let mut metres = DepthImage::new();
            decode_metres(encoding, &bytes, &PacketMask::NONE, &table, &mut metres).expect("a whole frame");
            let same = metres.pixels().iter().zip(&expected).all(|(&z, &mm)| z == f32::from(mm) / 1_000.0);
            assert!(same, "frame {n}, {encoding:?}");
        }
    }
}

#[test]
fn all_sixty_seq7_frames_in_millimetres_keep_every_depth_and_no_marker() {
    let table = DepthTable::from_law(&ZeroPlane::default());
    let mut markers = 0;
    for n in 0..60 {
        let Some(bytes) = read_frame(n) else { return };
        let mm: Vec<u16> = bytes.as_chunks::<2>().0.iter().map(|mm| u16::from_le_bytes(*mm)).collect();
        markers += mm.iter().filter(|&&mm| mm == 65_535).count();
        let expected = without_markers(mm);
        let decoded = mm_of(DepthEncoding::Mm16, &bytes, &table);
        assert!(decoded.pixels() == expected, "frame {n}");
        let border = (0..480).flat_map(|v| (632..640).map(move |u| (u, v)));
        assert!(border.into_iter().all(|(u, v)| decoded.at(u, v) == Some(0)), "the last columns carry no data");
    }
    assert!(markers >= 46, "frame 33 alone has 46 pixels of 65535; found {markers}");
}

#[test]
fn lost_packets_of_a_real_frame_lose_their_pixels_and_no_others() {
    let Some(codes) = grey16("kinect/raw11/nyu_raw11.png") else { return };
    let table = DepthTable::from_law(&ZeroPlane::default());
    let packed = encode_raw(&raw_image(&codes), DepthEncoding::Packed11).expect("eleven bits");
    let whole = mm_of(DepthEncoding::Packed11, &packed, &table);
    let mut lost = PacketMask::NONE;
    let mut damaged = packed;
    for packet in [3, 4, 5, 100, 200] {
        lost.mark_lost(packet);
        damaged[packet * 1_748..(packet + 1) * 1_748].fill(0x5A); // what happened to lie in the buffer
    }
    let mut mm = MmImage::new();
    let loss = decode_mm(DepthEncoding::Packed11, &damaged, &lost, &table, &mut mm).expect("a whole frame");
    // Packets 3-5: bits 41952..83904, pixels 3813 to 7627: 3815. Packets 100 and 200 (bits 1398400..1412384 and
    // 2796800..2810784): pixels 127127 to 128398 and 254254 to 255525, 1272 each.
    assert_eq!((loss.packets, loss.pixels), (5, 3_815 + 2 * 1_272));
    let mut differ = 0;
    for (pixel, (&mm, &whole)) in mm.pixels().iter().zip(whole.pixels()).enumerate() {
        let gone = [3_813..7_628, 127_127..128_399, 254_254..255_526].iter().any(|run| run.contains(&pixel));
        assert_eq!(mm, if gone { 0 } else { whole }, "pixel {pixel}");
        differ += usize::from(mm != whole);
    }
    assert!(differ > 5_000, "most of these pixels had data, {differ}");
}

/// A patch of a surface in one frame.
struct Patch {
    /// Mean depth, m.
    z: f64,
    /// Standard deviation of the points about the fitted plane, along their rays, m.
    plane: f64,
    /// The same about the fitted surface of second order.
    quadratic: f64,
    /// What the points themselves say it is: r.m.s. of their sigma_z.
    model: f64,
}

/// Pixels along a patch's edge.
const SIDE: usize = 25;

/// The patches of 25 × 25 pixels in which every pixel has a point.
///
/// A plane n·p = 1 is n·(x/z, y/z, 1) = 1/z: linear in the ray, so it is fitted to 1/z, where the noise is the same for
/// near and far points, and a residual e of it is a distance of z²·e along the ray.
fn patches(points: &Points) -> Vec<Patch> {
    let mut index = vec![None; 640 * 480];
    for (i, &pixel) in points.pixel().iter().enumerate() {
        index[pixel as usize] = Some(i);
    }
    let mut found = Vec::new();
    for v in (0..=480 - SIDE).step_by(SIDE) {
        for u in (0..=632 - SIDE).step_by(SIDE) {
            let pixels = (0..SIDE * SIDE).map(|k| (v + k / SIDE) * 640 + u + k % SIDE);
            let Some(members) = pixels.map(|pixel| index[pixel]).collect::<Option<Vec<_>>>() else { continue };
            let n = members.len() as f64;
            let z = members.iter().map(|&i| f64::from(points.z()[i])).sum::<f64>() / n;
            let variance = |i: usize| f64::from(points.sigma_z()[i]) * f64::from(points.sigma_z()[i]);
            let model = (members.iter().map(|&i| variance(i)).sum::<f64>() / n).sqrt();
            let middle = members[members.len() / 2];
            let ray = |i: usize| [points.x()[i] / points.z()[i], points.y()[i] / points.z()[i]].map(f64::from);
            let [middle_x, middle_y] = ray(middle);
            let basis = |i: usize| {
                let [x, y] = ray(i);
                let (x, y) = ((x - middle_x) * 50.0, (y - middle_y) * 50.0); // a patch spans about -1 to 1
                [1.0, x, y, x * x, x * y, y * y]
            };
            let rows: Vec<([f64; 6], f64)> =
                members.iter().map(|&i| (basis(i), 1.0 / f64::from(points.z()[i]))).collect();
            found.push(Patch { z, plane: z * z * spread(&rows, 3), quadratic: z * z * spread(&rows, 6), model });
        }
    }
    found
}

/// Standard deviation of what is left of the right sides when the first `terms` columns are fitted to them by least squares.
fn spread(rows: &[([f64; 6], f64)], terms: usize) -> f64 {
    // Normal equations, bordered by the right side: elimination leaves the sum of squared residuals in the corner.
    let mut normal = [[0.0; 7]; 7];
    for (basis, value) in rows {
        let mut row = [0.0; 7];
        row[..terms].copy_from_slice(&basis[..terms]);
        row[terms] = *value;
        for i in 0..=terms {
            for j in 0..=terms {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    for pivot in 0..terms {
        let pivot_row = normal[pivot];
        for row in &mut normal[pivot + 1..=terms] {
            let share = row[pivot] / pivot_row[pivot];
            row.iter_mut().zip(pivot_row).skip(pivot).for_each(|(entry, above)| *entry -= share * above);
        }
    }
    (normal[terms][terms] / (rows.len() - terms) as f64).sqrt()
}

/// The commonest of many values: the middle of the shortest interval that holds a quarter of them.
///
/// Some patches hold an edge or a crumpled surface and spread by centimetres. A limit that leaves them out would cut off
/// the noise it is to measure; the place where the values crowd does not depend on any.
fn commonest(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let quarter = values.len() / 4;
    let intervals = values.iter().zip(&values[quarter..]);
    let (from, to) = intervals.min_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0))).expect("some patches");
    (from + to) / 2.0
}

#[test]
fn points_of_real_surfaces_at_two_metres_lie_on_their_planes_within_the_noise_models_spread() {
    let table = DepthTable::from_law(&ZeroPlane::default());
    let projector = BackProjector::new(&SEQ7_CAMERA, &NoiseModel::default()).expect("a camera");
    let (mut depth, mut points) = (DepthImage::new(), Points::new());
    let mut near_two_metres = Vec::new();
    for n in 0..60 {
        let Some(mm) = read_frame(n) else { return };
        decode_metres(DepthEncoding::Mm16, &mm, &PacketMask::NONE, &table, &mut depth).expect("a whole frame");
        projector.points(&depth, &mut points);
        near_two_metres.extend(patches(&points).into_iter().filter(|patch| (1.8..2.2).contains(&patch.z)));
    }
    assert!(near_two_metres.len() > 4_000, "{} patches", near_two_metres.len());
    let model =
        1_000.0 * commonest(near_two_metres.iter().map(|patch| patch.model * 4.0 / patch.z / patch.z).collect());
    // Scaled to 2.0 m by z², so that patches from 1.8 to 2.2 m can be compared.
    let plane =
        1_000.0 * commonest(near_two_metres.iter().map(|patch| patch.plane * 4.0 / patch.z / patch.z).collect());
    let quadratic =
        1_000.0 * commonest(near_two_metres.iter().map(|patch| patch.quadratic * 4.0 / patch.z / patch.z).collect());
    println!(
        "{} patches at 1.8 to 2.2 m: {plane:.2} mm about planes, {quadratic:.2} mm about quadratics, model {model:.2} mm",
        near_two_metres.len()
    );
    // The table measured on chosen smooth patches of this sequence says 5.3 mm at 2 m (a quadratic removed);
    // Khoshelham & Elberink 5.7, Nguyen et al. 6.1. Planes leave what a surface and the device's own warp curve over 9 cm.
    assert!((model - 5.3).abs() < 0.15, "{model} mm");
    assert!((quadratic / 5.3 - 1.0).abs() < 0.12, "{quadratic} mm about quadratics");
    assert!((plane / 5.3 - 1.0).abs() < 0.20, "{plane} mm about planes");
}

#[test]
fn real_frames_in_a_row_are_never_taken_for_a_frozen_device() {
    let mut detector = FrozenDetector::new(1);
    for n in 0..60 {
        let Some(mm) = read_frame(n) else { return };
        let mm = Bytes::from(mm);
        assert_eq!(detector.observe(None, DepthEncoding::Mm16, &mm), Freshness::Fresh, "frame {n}");
        let again = detector.clone().observe(None, DepthEncoding::Mm16, &mm);
        assert_eq!(again, Freshness::Frozen { run: 1, cause: RepeatCause::SameBytes }, "frame {n} twice");
    }
}
