//! Noise, its likeness from pixel to pixel, the lattice and the warp, on flat patches.

use crate::scenes::{code, frame, kinect, wall};
use nalgebra::{Cholesky, SMatrix, SVector};
use tumbled_kinect::ZeroPlane;
use tumbled_model::RigNs;
use tumbled_sim::kinect::{Frame, KinectParameters};

/// Side of a patch, px, as in the measurement on recorded frames.
const SIDE: usize = 25;

/// Residuals of a patch after its best quadratic surface is removed; `None`: a pixel without data.
fn residuals(frame: &Frame, left: usize, top: usize) -> Option<Vec<f64>> {
    let terms = |i: usize| {
        let place = |k: usize| (k as f64 - 12.0) / 12.0;
        let (x, y) = (place(i % SIDE), place(i / SIDE));
        SVector::<f64, 6>::new(1.0, x, y, x * x, x * y, y * y)
    };
    let codes: Option<Vec<f64>> =
        (0..SIDE * SIDE).map(|i| code(frame, left + i % SIDE, top + i / SIDE).map(f64::from)).collect();
    let codes = codes?;
    let (mut normal, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
    for (i, code) in codes.iter().enumerate() {
        normal += terms(i) * terms(i).transpose();
        right += terms(i) * *code;
    }
    let fit = Cholesky::new(normal).expect("six terms over 625 pixels").solve(&right);
    Some(codes.iter().enumerate().map(|(i, code)| code - fit.dot(&terms(i))).collect())
}

/// Standard deviation, and correlation with the neighbour to the right and below, over all patches of a frame.
fn measured(frame: &Frame) -> (f64, [f64; 2]) {
    let (mut square, mut across, mut down, mut pixels, mut pairs) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for top in (0..480 - SIDE).step_by(SIDE) {
        for left in (0..630 - SIDE).step_by(SIDE) {
            let Some(r) = residuals(frame, left, top) else { continue };
            square += r.iter().map(|x| x * x).sum::<f64>();
            pixels += r.len() as f64;
            for y in 0..SIDE - 1 {
                for x in 0..SIDE - 1 {
                    across += r[y * SIDE + x] * r[y * SIDE + x + 1];
                    down += r[y * SIDE + x] * r[(y + 1) * SIDE + x];
                    pairs += 1.0;
                }
            }
        }
    }
    assert!(pixels > 100_000.0, "{pixels} pixels in whole patches");
    let variance = square / pixels;
    (variance.sqrt(), [across / pairs / variance, down / pairs / variance])
}

#[test]
fn noise_by_depth_is_the_measured_one_rounding_included() {
    // The middle of each measured range, and its standard deviation in steps. A wall turned by 12° and 9°, as walls are:
    // on one square to the camera the rounding depends on where between two codes it happens to stand.
    for (metres, expected) in [(0.8, 0.56), (1.25, 0.52), (1.75, 0.47), (2.25, 0.445), (2.75, 0.45)] {
        let (sigma, _) = measured(&frame(KinectParameters::default(), &wall(metres, 9.0, 12.0)));
        println!("{metres} m: {sigma:.3} steps, expected {expected}");
        assert!((sigma / expected - 1.0).abs() < 0.15, "{metres} m: {sigma} steps, expected {expected}");
    }
}

#[test]
fn neighbours_are_as_alike_as_in_recorded_frames() {
    for metres in [0.8, 1.25, 1.75, 2.25, 2.75] {
        let (_, alike) = measured(&frame(KinectParameters::default(), &wall(metres, 9.0, 12.0)));
        println!("{metres} m: {alike:.3?}");
        // Recorded: 0.55 to 0.65.
        assert!(alike.iter().all(|alike| (alike / 0.6 - 1.0).abs() < 0.15), "{metres} m: {alike:?}");
    }
}

#[test]
fn without_noise_every_code_is_the_laws() {
    // The decoder's law, written elsewhere: the codes of a turned wall, pixel by pixel from its plane.
    let world = wall(1.8, 20.0, -30.0);
    let frame = kinect(KinectParameters::ideal()).with_truth().frame(&world, RigNs(0), 0, 1);
    let depth = frame.truth.as_ref().expect("asked for").depth.clone();
    let law = ZeroPlane::default();
    let mut different = 0;
    for v in 0..480 {
        for u in 0..632 {
            let metres = f64::from(depth.at(u, v).expect("in the image"));
            let expected = law.code_at(metres).map(|code| code.0);
            different += u32::from(code(&frame, u, v) != expected);
        }
    }
    // The truth is in f32 and the law's constants to 7 digits: 1e-4 of a step, so 3e-4 of the pixels may fall the other way.
    assert!(different < 100, "{different} of 303 360");
}

#[test]
fn a_plane_is_unbiased_but_for_the_warp() {
    let law = ZeroPlane::default();
    let bias = |parameters: KinectParameters| {
        let frame = kinect(parameters).with_truth().frame(&wall(1.5, 9.0, 12.0), RigNs(0), 3, 4);
        let depth = frame.truth.as_ref().expect("asked for").depth.clone();
        // By block of 80 × 80 pixels.
        let mut blocks = Vec::new();
        for (left, top) in (0..6).flat_map(|v| (0..7).map(move |u| (80 * u, 80 * v))) {
            let errors: Vec<f64> = (0..6_400)
                .filter_map(|i| {
                    let (u, v) = (left + i % 80, top + i / 80);
                    let metres = law.metres(f64::from(code(&frame, u, v)?)).expect("a depth");
                    Some(metres - f64::from(depth.at(u, v).expect("in the image")))
                })
                .collect();
            assert_eq!(errors.len(), 6_400);
            blocks.push(errors.iter().sum::<f64>() / 6_400.0);
        }
        blocks
    };
    // 0.5 steps of 6.5 mm, alike over about 25 pixels: 3.3 mm · √(25/6400) = 0.2 mm in a block; four of that.
    let straight = bias(KinectParameters { warp_m: 0.0, ..KinectParameters::default() });
    assert!(straight.iter().all(|bias| bias.abs() < 0.8e-3), "{straight:?}");
    // Cold, the warp is within 0.6 · 5 mm, and somewhere well beyond the noise.
    let warped = bias(KinectParameters::default());
    assert!(warped.iter().all(|bias| bias.abs() < 3.8e-3), "{warped:?}");
    assert!(warped.iter().any(|bias| bias.abs() > 1.2e-3), "{warped:?}");
    // A scale of 0.3 % at 1.5 m is 4.5 mm; the wall is 1.2 to 1.9 m away.
    let scaled = bias(KinectParameters { warp_m: 0.0, depth_scale: 1.003, ..KinectParameters::default() });
    let mean = scaled.iter().sum::<f64>() / scaled.len() as f64;
    assert!((mean - 4.5e-3).abs() < 0.5e-3, "{mean}");
}
