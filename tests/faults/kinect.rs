//! A Kinect that goes, comes back, sends too little, nothing, or the same again and again: cases 11 to 13.

use bytes::Bytes;
use tumbled_core::health::SensorState;
use tumbled_kinect::{RawDisparity, RawImage, encode_raw};
use tumbled_model::{Body, DepthEncoding, Event};

use super::session::{MS, S, Seen, both, play, seconds, seconds_of};
use crate::support::rig::Rig;

#[test]
fn case_11_ten_seconds_without_the_kinect_cost_the_lidar_nothing_and_it_is_back_at_once() {
    let unplugged = "[[fault]]\nsensor = \"near\"\nfrom_s = 4.0\nuntil_s = 14.0\naction = \"unplug\"\n";
    let played = play(seconds(20, true, true), unplugged, both());
    let [(_, SensorState::Live), (absent, SensorState::Absent), (live, SensorState::Live)] = played.states("near")[..]
    else {
        panic!("{:?}", played.notices)
    };
    println!("case 11: absent after {} ms, live {} ms after its return", absent / MS - 4_000, live / MS - 14_000);
    assert!(absent <= 5 * S && (14 * S..=19 * S).contains(&live), "{absent} {live}");
    assert_eq!(played.states("front").len(), 1);
    assert_eq!(played.between(true, 4 * S, 14 * S), 100);
    assert_eq!(played.between(false, 16 * S, 19 * S), 90);
    played.assert_in_order();
}

#[test]
fn case_12_short_frames_are_left_out_and_counted_and_no_row_of_another_is_moved() {
    // Of a frame's 422 400 bytes the first 60 000 come.
    let short = "[[fault]]\nsensor = \"near\"\nfrom_s = 1.0\naction.resize = { probability = 0.3, bytes = 60000 }\n";
    // From top to bottom, so that no two short frames on end are the same: those would count as repeated.
    let four = || seconds_of(Rig::new(80, 480), 4, false, true);
    let (calm, cut) = (play(four(), "", both()), play(four(), short, both()));
    let resized = cut.done("near").resized;
    assert!((15..45).contains(&resized), "{resized} of 90");
    let near = cut.sensor("near");
    assert_eq!(
        near.malformed.iter().map(|(kind, n)| (kind.as_str(), *n)).collect::<Vec<_>>(),
        [("packed11_length", resized)]
    );
    assert!(near.malformed_first["packed11_length"].contains("422400"), "{:?}", near.malformed_first);
    // What is left are frames of the clean run, at their times and to the bit.
    assert_eq!(calm.epochs.len() as u64, cut.epochs.len() as u64 + resized);
    assert!(cut.epochs.iter().all(|epoch| calm.epochs.contains(epoch)));
}

/// Two seconds of frames in which every pixel says the same.
fn blank(says: impl Fn(usize) -> RawDisparity) -> Vec<Seen> {
    let mut number = 0;
    let frames = seconds(2, false, true).map(move |event| match event.body {
        Body::DepthFrame { sensor, ticks, encoding, lost_packets, .. } => {
            // Two alternate, so that none repeats the one before it.
            number += 1;
            let image = RawImage::from_fn(|_, _| says(number % 2));
            let bytes = Bytes::from(encode_raw(&image, DepthEncoding::Packed11).expect("eleven bits"));
            Event { body: Body::DepthFrame { sensor, ticks, encoding, lost_packets, bytes }, ..event }
        }
        _ => event,
    });
    play(frames, "", both()).epochs
}

#[test]
fn case_13_frames_without_a_single_depth_are_epochs_without_points() {
    // Out of the law's range: behind infinity. The device sends 2047 for no data.
    let saturated = blank(|n| RawDisparity(2_045 + n as u16));
    assert!((58..=60).contains(&saturated.len()), "{}", saturated.len());
    assert!(saturated.iter().all(|epoch| epoch.points == 0), "{:?}", saturated[0]);
    // Nothing but no data: each frame is the one before it once more, as those of a covered lens are.
    let covered = blank(|_| RawDisparity::NO_DATA);
    assert!(covered.iter().all(|epoch| epoch.points == 0));
}

#[test]
fn case_13_the_same_frame_ten_times_is_a_fault_and_gives_no_epoch() {
    // 3.02 s to 3.37 s by arrival: the frame that comes first in it, and ten that repeat it.
    let frozen = "[[fault]]\nsensor = \"near\"\nfrom_s = 3.02\nuntil_s = 3.374\naction = \"freeze\"\n";
    let played = play(seconds(6, true, true), frozen, both());
    assert_eq!(played.done("near").frozen, 10);
    let [(_, SensorState::Live), (fault, SensorState::Fault), (live, SensorState::Live)] = played.states("near")[..]
    else {
        panic!("{:?}", played.notices)
    };
    assert!(fault <= 3_400 * MS && live <= 3_500 * MS, "{fault} {live}");
    assert_eq!(played.sensor("near").kinect.map(|kinect| kinect.repeated), Some(10));
    assert_eq!(played.between(false, 2 * S, 5 * S), 90 - 10);
    assert_eq!(played.between(true, 2 * S, 5 * S), 30);
}
