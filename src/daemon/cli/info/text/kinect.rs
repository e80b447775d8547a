//! A Kinect's block.

use super::super::report::RateClock;
use super::super::report::kinect::{Encoding, KinectReport};
use super::Page;
use super::figures::{counted, percent, spread};

pub(super) fn block(page: &mut Page, kinect: &KinectReport) {
    page.heading(&format!("Kinect {}: {}", kinect.id, counted(kinect.frames, "depth frame")));
    page.line("encoding", &encodings(kinect));
    page.line("rate", &rate(kinect));
    if let (Some(first), Some(last)) = (kinect.first_ticks, kinect.last_ticks) {
        page.line("stamps", &format!("{first} to {last} ticks of 60 MHz"));
    }
    if let Some(share) = &kinect.valid_share {
        let (mean, min) = (percent(share.mean), percent(share.min));
        let worst = if kinect.frames > 1 { format!(", worst frame {min}") } else { String::new() };
        page.line("valid", &format!("{mean} of the pixels{worst}"));
    }
    if let Some(depth) = &kinect.depth_m {
        page.line("depths", &spread(depth, 3));
    }
    page.line("loss", &loss(kinect));
    if kinect.repeated > 0 {
        page.line("repeated", &counted(kinect.repeated, "frame"));
    }
    for refusal in &kinect.refused {
        page.alert(&format!("not decoded: {}: {}", counted(refusal.count, "frame"), refusal.reason));
    }
    for warning in &kinect.warnings {
        page.alert(warning);
    }
}

fn encodings(kinect: &KinectReport) -> String {
    match kinect.encodings.as_slice() {
        [only] => encoding(only.encoding).to_owned(),
        several => {
            let each: Vec<String> = several.iter().map(|e| format!("{} {}", e.frames, encoding(e.encoding))).collect();
            each.join("; ")
        }
    }
}

const fn encoding(encoding: Encoding) -> &'static str {
    match encoding {
        Encoding::Packed11 => "raw disparity, packed 11 bit",
        Encoding::Raw11 => "raw disparity, 16 bit",
        Encoding::Mm16 => "millimetres, 16 bit",
    }
}

fn rate(kinect: &KinectReport) -> String {
    match (kinect.rate_hz, kinect.rate_clock) {
        (Some(hz), Some(RateClock::Device)) => format!("{hz:.2} Hz"),
        (Some(hz), _) => format!("{hz:.2} Hz by the host's stamps"),
        (None, _) if kinect.frames < 2 => "unknown: one frame".to_owned(),
        (None, _) => "unknown: the input has no times".to_owned(),
    }
}

fn loss(kinect: &KinectReport) -> String {
    let frames = match kinect.frames_missing {
        Some(0) => "no frame missing".to_owned(),
        Some(n) => format!("{} missing by the stamps", counted(n, "frame")),
        None => "missing frames unknown: no stamps".to_owned(),
    };
    match kinect.usb_packets_lost {
        0 => format!("{frames}; no USB packet lost"),
        n => {
            let where_ = counted(kinect.frames_with_usb_loss, "frame");
            format!("{frames}; {} lost in {where_}, {} pixels", counted(n, "USB packet"), kinect.pixels_lost)
        }
    }
}
