//! What an HDL-64E says about itself, as part of the report.

use tumbled_velodyne::hdl64::in_stream::STREAM_LEN;
use tumbled_velodyne::hdl64::{Firmware, Hdl64Decoder, Unit, Warnings};

use super::report::hdl64e::{Awaiting, CalibrationSource, Hdl64eReport, UnitReport};

/// The report of one HDL-64E.
pub(super) fn report(decoder: &Hdl64Decoder, has_calibration_file: bool) -> Hdl64eReport {
    let status = decoder.status();
    Hdl64eReport {
        generation: decoder.generation().map(|generation| format!("{generation:?}")),
        calibration: match decoder.calibration() {
            Some(_) if has_calibration_file => CalibrationSource::File,
            Some(_) => CalibrationSource::InStream,
            None => CalibrationSource::None,
        },
        awaiting: decoder.awaiting().map(|(bytes, failure)| Awaiting {
            bytes,
            of: STREAM_LEN,
            failure: failure.map(ToString::to_string),
        }),
        firmware: status.firmware.map(firmware),
        temperature_c: status.temperature_c,
        date_time: status.date_time().map(|time| time.to_string()),
        gps_status: status.gps.map(|byte| char::from(byte).escape_default().to_string()),
        warnings: status.warnings.map(in_words).unwrap_or_default(),
        unit: decoder.unit().map(unit),
    }
}

fn firmware(firmware: Firmware) -> String {
    match firmware {
        Firmware::Number(number) => number.to_string(),
        Firmware::Text(characters) => characters.escape_ascii().to_string(),
    }
}

fn in_words(warnings: Warnings) -> Vec<String> {
    let said = [
        (warnings.lens_contaminated(), "the lens is dirty"),
        (warnings.too_hot(), "too hot inside"),
        (warnings.too_cold(), "too cold inside"),
    ];
    said.iter().filter(|(set, _)| *set).map(|(_, words)| (*words).to_owned()).collect()
}

fn unit(unit: &Unit) -> UnitReport {
    UnitReport {
        calibrated: unit.calibrated.map(|time| time.to_string()),
        rpm_set: unit.rpm,
        view_from_deg: f64::from(unit.view_from_cdeg) / 100.0,
        view_to_deg: f64::from(unit.view_to_cdeg) / 100.0,
        hours: unit.hours,
    }
}
