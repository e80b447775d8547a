//! The sensors: what is built into each model, from its manual.
//!
//! Sources: M16 = VLP-16 manual 63-9243 Rev D/E; M32 = VLP-32C manual 63-9325 Rev B/C; H32 = HDL-32E manual;
//! H64 = HDL-64E S2 manual; (captures) = checked on real captures (see `docs/velodyne.md`).

use serde::{Deserialize, Serialize};

/// A sensor model this crate decodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Model {
    /// VLP-32C, "Ultra Puck": 32 lasers fired in pairs, uneven elevations, azimuth offsets.
    #[serde(rename = "vlp-32c")]
    Vlp32c,
    /// VLP-16 and Puck LITE: 16 lasers, ±15°, two firing sequences a block.
    #[serde(rename = "vlp-16")]
    Vlp16,
    /// Puck Hi-Res: a VLP-16 with ±10°.
    #[serde(rename = "vlp-16-hi-res")]
    Vlp16HiRes,
    /// HDL-32E: 32 lasers, −30.67°…+10.67°.
    #[serde(rename = "hdl-32e")]
    Hdl32e,
    /// HDL-64E S1, S2, S3: 64 lasers, each with its own factory calibration.
    #[serde(rename = "hdl-64e")]
    Hdl64e,
}

/// The timing and geometry of a model whose lasers need no factory calibration file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelSpec {
    /// Distance counts to metres.
    pub distance_lsb_m: f64,
    /// One firing sequence of all lasers, recharge included, ns.
    pub cycle_ns: u32,
    /// From one firing to the next within a sequence, ns.
    pub firing_ns: u32,
    /// Lasers that fire at the same instant.
    pub lasers_per_firing: u8,
    /// Elevations in packet (laser id) order, degrees; their number is the number of lasers.
    pub elevation_deg: &'static [f64],
    /// Azimuth offsets in laser order, degrees: true azimuth = block azimuth + offset.
    pub azimuth_offset_deg: &'static [f64],
    /// Lens focal length f, mm: a beam leaves at height −f·tan(elevation) above the optical centre.
    pub focal_mm: f64,
}

impl Model {
    /// Every model.
    pub const ALL: [Self; 5] = [Self::Vlp32c, Self::Vlp16, Self::Vlp16HiRes, Self::Hdl32e, Self::Hdl64e];

    /// The name as configs and the command line spell it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Vlp32c => "vlp-32c",
            Self::Vlp16 => "vlp-16",
            Self::Vlp16HiRes => "vlp-16-hi-res",
            Self::Hdl32e => "hdl-32e",
            Self::Hdl64e => "hdl-64e",
        }
    }

    /// Built-in timing and geometry; `None` for the HDL-64E, whose lasers come from a calibration.
    pub const fn spec(self) -> Option<&'static ModelSpec> {
        match self {
            Self::Vlp32c => Some(&VLP32C),
            Self::Vlp16 => Some(&VLP16),
            Self::Vlp16HiRes => Some(&VLP16_HI_RES),
            Self::Hdl32e => Some(&HDL32E),
            Self::Hdl64e => None,
        }
    }

    /// Smallest and largest distance that is a measurement and not an artefact, metres.
    ///
    /// Maxima: data sheets. Minima: 0.4 m for the Pucks (real VLP-32C points at 0.71 m are good (captures), the
    /// manual's 1 m is a specification of accuracy), 0.9 m for the HDLs H64.
    pub const fn range_limits_m(self) -> (f32, f32) {
        match self {
            Self::Vlp32c => (0.4, 200.0),
            Self::Vlp16 | Self::Vlp16HiRes => (0.4, 100.0),
            Self::Hdl32e => (0.9, 100.0),
            Self::Hdl64e => (0.9, 120.0),
        }
    }

    /// What `vertical_offsets = "auto"` means for this model: whether z includes the height −f·tan(elevation) at which
    /// each beam leaves the lens.
    ///
    /// | model | auto | because |
    /// |---|---|---|
    /// | VLP-16 | on | its manual lists the heights |
    /// | Puck Hi-Res | on | the same sensor with other elevations |
    /// | VLP-32C | on | an indoor floor wants them: scale +1.31 ± 0.40 (0 off, 1 on), +0.91 ± 0.55 if all lasers may share errors of range and elevation |
    /// | HDL-32E | off | no figure of the maker's is known, and a road decides nothing: scale −0.17 ± 0.81 |
    /// | HDL-64E | off | its calibration has offsets of its own |
    ///
    /// The scales are fitted to real captures. The evidence for the VLP-32C is moderate and conditional:
    /// `docs/velodyne.md` has the tables and their limits, `examples/vertical_offsets` computes them.
    pub const fn vertical_offsets_default(self) -> bool {
        match self {
            Self::Vlp32c | Self::Vlp16 | Self::Vlp16HiRes => true,
            Self::Hdl32e | Self::Hdl64e => false,
        }
    }

    /// The number of lasers.
    pub const fn lasers(self) -> usize {
        match self.spec() {
            Some(spec) => spec.elevation_deg.len(),
            None => 64,
        }
    }
}

impl core::fmt::Display for Model {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name())
    }
}

/// Byte 1205 of a data packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Product {
    /// A model this crate decodes.
    Supported(Model),
    /// A Velodyne product that this crate knows by name and does not decode.
    Unsupported(&'static str),
    /// Nothing known.
    Unknown(u8),
}

impl Product {
    /// What a product byte says (M16 and M32 table of product ids; 0xA1 (captures)).
    ///
    /// A VLP-16 with firmware before 3.0.29 says 0x21, HDL-32E: see [`crate::detect`].
    pub const fn from_byte(byte: u8) -> Self {
        match byte {
            0x21 => Self::Supported(Model::Hdl32e),
            0x22 => Self::Supported(Model::Vlp16), // Puck LITE too
            0x23 => Self::Unsupported("VLP-32A/B"),
            0x24 => Self::Supported(Model::Vlp16HiRes),
            0x28 => Self::Supported(Model::Vlp32c),
            0x31 => Self::Unsupported("Velarray"),
            0x63 | 0xA1 => Self::Unsupported("VLS-128"),
            other => Self::Unknown(other),
        }
    }

    /// The product byte a model sends; the HDL-64E sends none.
    pub const fn byte(model: Model) -> Option<u8> {
        match model {
            Model::Hdl32e => Some(0x21),
            Model::Vlp16 => Some(0x22),
            Model::Vlp16HiRes => Some(0x24),
            Model::Vlp32c => Some(0x28),
            Model::Hdl64e => None,
        }
    }
}

impl core::fmt::Display for Product {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Supported(model) => f.write_str(model.name()),
            Self::Unsupported(name) => f.write_str(name),
            Self::Unknown(byte) => write!(f, "product byte {byte:#04x}"),
        }
    }
}

/// Byte 1204 of a data packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ReturnMode {
    /// 0x37: one return a firing, the strongest.
    Strongest,
    /// 0x38: one return a firing, the last.
    Last,
    /// 0x39: blocks in pairs, the even one the last return, the odd one the strongest.
    Dual,
}

impl ReturnMode {
    /// The mode a byte names, if it does.
    pub const fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            0x37 => Some(Self::Strongest),
            0x38 => Some(Self::Last),
            0x39 => Some(Self::Dual),
            _ => None,
        }
    }

    /// The byte on the wire.
    pub const fn byte(self) -> u8 {
        match self {
            Self::Strongest => 0x37,
            Self::Last => 0x38,
            Self::Dual => 0x39,
        }
    }

    /// Blocks that share one firing sequence's azimuth.
    pub const fn blocks_per_firing(self) -> usize {
        match self {
            Self::Strongest | Self::Last => 1,
            Self::Dual => 2,
        }
    }
}

impl core::fmt::Display for ReturnMode {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Strongest => "strongest",
            Self::Last => "last",
            Self::Dual => "dual",
        })
    }
}

const NO_OFFSETS: [f64; 32] = [0.0; 32];

/// M32 table 9-5; the sign of the azimuth offsets checked by correlating neighbouring lasers' profiles (captures).
const VLP32C: ModelSpec = ModelSpec {
    distance_lsb_m: 0.004,
    cycle_ns: 55_296,
    firing_ns: 2_304,
    lasers_per_firing: 2,
    elevation_deg: &[
        -25.0, -1.0, -1.667, -15.639, -11.31, 0.0, -0.667, -8.843, //
        -7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4.0, //
        -4.667, 1.667, 1.0, -3.667, -3.333, 3.333, 2.333, -2.667, //
        -3.0, 7.0, 4.667, -2.333, -2.0, 15.0, 10.333, -1.333,
    ],
    azimuth_offset_deg: &[
        1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, //
        1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4, //
        1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, //
        1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4,
    ],
    focal_mm: 42.4,
};

/// M16 chapter 9: one laser every 2.304 µs, two sequences a block.
const VLP16: ModelSpec = ModelSpec {
    distance_lsb_m: 0.002,
    cycle_ns: 55_296,
    firing_ns: 2_304,
    lasers_per_firing: 1,
    elevation_deg: &[-15.0, 1.0, -13.0, 3.0, -11.0, 5.0, -9.0, 7.0, -7.0, 9.0, -5.0, 11.0, -3.0, 13.0, -1.0, 15.0],
    azimuth_offset_deg: NO_OFFSETS.split_at(16).0,
    focal_mm: 41.91,
};

const VLP16_HI_RES: ModelSpec = ModelSpec {
    elevation_deg: &[
        -10.0, 0.667, -8.667, 2.0, -7.333, 3.333, -6.0, 4.667, -4.667, 6.0, -3.333, 7.333, -2.0, 8.667, -0.667, 10.0,
    ],
    ..VLP16
};

/// H32: 32 × 1.152 µs + 9.216 µs recharge.
const HDL32E: ModelSpec = ModelSpec {
    distance_lsb_m: 0.002,
    cycle_ns: 46_080,
    firing_ns: 1_152,
    lasers_per_firing: 1,
    elevation_deg: &[
        -30.67, -9.33, -29.33, -8.0, -28.0, -6.67, -26.67, -5.33, //
        -25.33, -4.0, -24.0, -2.67, -22.67, -1.33, -21.33, 0.0, //
        -20.0, 1.33, -18.67, 2.67, -17.33, 4.0, -16.0, 5.33, //
        -14.67, 6.67, -13.33, 8.0, -12.0, 9.33, -10.67, 10.67,
    ],
    azimuth_offset_deg: &NO_OFFSETS,
    focal_mm: 28.83,
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_product_byte_leads_back_to_its_model() {
        for model in Model::ALL {
            if let Some(byte) = Product::byte(model) {
                assert_eq!(Product::from_byte(byte), Product::Supported(model));
            }
        }
        assert_eq!(Product::from_byte(0xA1), Product::Unsupported("VLS-128"));
        assert_eq!(Product::from_byte(0), Product::Unknown(0));
    }

    #[test]
    fn tables_are_complete_and_elevations_differ() {
        for model in Model::ALL {
            let Some(spec) = model.spec() else { continue };
            assert_eq!(spec.elevation_deg.len(), spec.azimuth_offset_deg.len(), "{model}");
            let mut sorted = spec.elevation_deg.to_vec();
            sorted.sort_by(f64::total_cmp);
            assert!(sorted.windows(2).all(|w| w[0] < w[1]), "{model}: two lasers on one ring");
            // All firings of a sequence fit into its cycle.
            let firings = spec.elevation_deg.len() as u32 / u32::from(spec.lasers_per_firing);
            assert!(firings * spec.firing_ns < spec.cycle_ns, "{model}");
        }
    }

    #[test]
    fn vlp16_focal_length_gives_the_manuals_vertical_offsets() {
        // M16 lists mm per laser; f = 41.91 mm must reproduce each to its last digit (0.05 mm) and rounding of f.
        let manual = [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2];
        for (laser, (mm, elevation)) in manual.iter().zip(VLP16.elevation_deg).enumerate() {
            let height = -VLP16.focal_mm * libm::tan(elevation.to_radians());
            assert!((height - mm).abs() < 0.06, "laser {laser}: {height} against {mm}");
        }
    }
}
