//! A capture's packets to returns without the vertical offset, each with the offset it may have.

use crate::surfaces::Scene;
use nalgebra::Vector3;
use pcap_file::pcap::PcapReader;
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use tumbled_model::RigNs;
use tumbled_velodyne::beams::BeamTable;
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};

/// One return of a laser.
pub(crate) struct Sample {
    /// Where the manual's formula without the offset puts it, sensor's frame, metres.
    pub(crate) point: Vector3<f64>,
    /// Clockwise from above, degrees, 0..360.
    pub(crate) azimuth_deg: f64,
    /// Rank of the laser by elevation, 0 = lowest.
    pub(crate) ring: u8,
    /// The offset in question: −f·tan(elevation), metres.
    pub(crate) height_m: f64,
}

/// Why a capture that is there could not be read.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CaptureError {
    #[error("{path}: {source}", path = .path.display())]
    Open { path: PathBuf, source: std::io::Error },
    #[error("{path}, packet {packet}: {source}", path = .path.display())]
    Pcap { path: PathBuf, packet: u64, source: pcap_file::PcapError },
    #[error("a {0} has no built-in elevations")]
    NoElevations(tumbled_velodyne::Model),
}

/// The returns of the scene's first data packets; `None`, with a printed line, where the capture is not there.
pub(crate) fn samples(folder: &Path, scene: &Scene) -> Result<Option<Vec<Sample>>, CaptureError> {
    let path = folder.join(scene.file);
    let file = match File::open(&path) {
        Ok(file) => file,
        Err(missing) if missing.kind() == ErrorKind::NotFound => {
            println!("skipped: {} is not there\n", path.display());
            return Ok(None);
        }
        Err(source) => return Err(CaptureError::Open { path, source }),
    };
    let spec = scene.model.spec().ok_or(CaptureError::NoElevations(scene.model))?;
    let beams = BeamTable::new(spec, true);

    let settings = Settings { model: Some(scene.model), vertical_offsets: Some(false), ..Settings::default() };
    let mut decoder = StreamDecoder::new(settings);
    let mut decoded = Decoded::default();
    let pcap = |packet: u64, source| CaptureError::Pcap { path: path.clone(), packet, source };
    let mut reader = PcapReader::new(file).map_err(|source| pcap(0, source))?;
    let mut packet = 0;
    while let Some(frame) = reader.next_packet() {
        packet += 1;
        let frame = frame.map_err(|source| pcap(packet, source))?;
        if let Some(payload) = udp_payload(&frame.data) {
            decoder.push(payload, RigNs(frame.timestamp.as_nanos() as i64), &mut decoded);
        }
    }
    decoder.finish(&mut decoded);

    let mut samples = Vec::with_capacity(decoded.points.len());
    for info in decoded.packets.iter().filter(|info| info.index < scene.packets) {
        for point in decoded.points.iter_range(info.points.clone()) {
            samples.push(Sample {
                point: Vector3::from(point.xyz.map(f64::from)),
                azimuth_deg: f64::from(point.azimuth_rad).to_degrees(),
                ring: point.ring,
                height_m: beams.beam(usize::from(point.laser)).map_or(0.0, |beam| beam.height_m),
            });
        }
    }
    Ok(Some(samples))
}

/// What an Ethernet frame with IPv4 and UDP carries.
fn udp_payload(frame: &[u8]) -> Option<&[u8]> {
    let ip = frame.get(14..)?;
    let header = usize::from(ip.first()? & 0x0F) * 4;
    ip.get(header + 8..)
}
