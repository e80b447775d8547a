//! The flat surfaces in the captures, picked out by eye, and how near them a return must lie.

use tumbled_velodyne::Model;

/// A capture and the flat surfaces in it.
pub(crate) struct Scene {
    /// What the report calls it.
    pub(crate) name: &'static str,
    /// The capture's file name.
    pub(crate) file: &'static str,
    /// The model of its sensor.
    pub(crate) model: Model,
    /// Data packets taken from its start, those in which the surfaces were picked. Beyond them the spread about the
    /// planes grows (VLP-16 from 8 to 10 mm, HDL-32E from 10 to 13 mm): those sensors do not stand still.
    pub(crate) packets: u64,
    /// The surfaces that are fitted together.
    pub(crate) surfaces: &'static [Surface],
    /// Whether to fit quadratic surfaces as well: floors and roads may be curved where walls are not.
    pub(crate) also_curved: bool,
}

/// Roughly where a flat surface is, in the sensor's frame (x forward, y left, z up), metres.
pub(crate) struct Surface {
    /// Normal pointing away from the sensor; normalised before use.
    pub(crate) normal: [f64; 3],
    /// Distance of the plane from the sensor's origin along the normal.
    pub(crate) distance_m: f64,
    /// Distances along the beam that are looked at: from, to (excluded).
    pub(crate) range_m: (f64, f64),
    /// Largest distance of a return from the rough plane.
    pub(crate) gate_m: f64,
    /// Rings that are looked at: first, last.
    pub(crate) rings: (u8, u8),
    /// Part of the horizontal plane that is looked at: x from, x to, y from, y to.
    pub(crate) window_m: Option<[f64; 4]>,
}

const fn surface(normal: [f64; 3], distance_m: f64, range_m: (f64, f64), gate_m: f64, rings: (u8, u8)) -> Surface {
    Surface { normal, distance_m, range_m, gate_m, rings, window_m: None }
}

/// A wall of the VLP-32C's room; the rings below ring 12 see the floor before they reach any.
const fn wall(normal: [f64; 3], distance_m: f64, range_m: (f64, f64), window_m: [f64; 4]) -> Surface {
    Surface { normal, distance_m, range_m, gate_m: 0.05, rings: (12, 31), window_m: Some(window_m) }
}

/// The floor of the VLP-32C's room, seen by its 15 lowest rings from 0.7 m to 7 m.
pub(crate) const VLP32C_FLOOR: Scene = Scene {
    name: "VLP-32C floor",
    file: "vlp32c_strongest_600rpm_fov180_a.pcap",
    model: Model::Vlp32c,
    packets: 228,
    surfaces: &[surface([0.0065, -0.0070, -1.0], 0.300, (0.4, 7.5), 0.03, (0, 31))],
    also_curved: true,
};

/// What else could tell: surfaces that turn out to say little or nothing.
pub(crate) const OTHERS: [Scene; 4] = [
    Scene {
        name: "VLP-32C walls",
        file: VLP32C_FLOOR.file,
        model: Model::Vlp32c,
        packets: 228,
        surfaces: &[
            wall([-0.180, 0.984, -0.015], 2.617, (2.5, 3.1), [-0.1, 0.85, 2.6, 2.85]),
            wall([-0.187, 0.982, -0.022], 2.703, (3.0, 3.8), [0.8, 1.9, 2.9, 3.15]),
            wall([0.998, 0.059, -0.019], 3.178, (3.3, 4.0), [3.1, 3.35, -2.1, -1.1]),
            wall([0.984, 0.176, 0.013], 8.758, (8.6, 9.4), [8.1, 8.75, 1.0, 4.3]),
            wall([0.988, 0.152, 0.019], 5.640, (6.2, 7.5), [4.8, 5.25, 3.6, 5.5]),
            wall([0.162, -0.987, -0.021], 4.432, (4.4, 5.0), [1.1, 2.8, -4.35, -4.0]),
        ],
        also_curved: false,
    },
    Scene {
        name: "VLP-16 walls, two of them tilted by 17°",
        file: "vlp16_strongest_600rpm.pcap",
        model: Model::Vlp16,
        packets: 80,
        surfaces: &[
            surface([0.391, 0.919, -0.059], 0.437, (0.7, 2.3), 0.04, (0, 15)),
            surface([0.896, -0.336, -0.290], 1.837, (1.7, 5.6), 0.04, (0, 15)),
            surface([-0.892, 0.342, 0.297], 1.011, (1.0, 4.3), 0.04, (0, 15)),
        ],
        also_curved: false,
    },
    Scene {
        name: "VLP-16 with GPS, walls",
        file: "vlp16_strongest_gps_600rpm.pcap",
        model: Model::Vlp16,
        packets: 20,
        surfaces: &[
            surface([-0.999, -0.028, -0.019], 1.462, (1.4, 2.0), 0.04, (0, 15)),
            surface([0.026, -1.0, 0.013], 1.212, (1.4, 2.0), 0.04, (0, 15)),
            surface([-0.999, -0.024, -0.025], 1.05, (1.15, 1.4), 0.04, (0, 15)),
        ],
        also_curved: false,
    },
    Scene {
        name: "HDL-32E road",
        file: "hdl32e_strongest_gps_700rpm.pcap",
        model: Model::Hdl32e,
        packets: 100,
        surfaces: &[surface([-0.030, -0.031, -0.999], 2.171, (4.0, 9.0), 0.04, (0, 31))],
        also_curved: true,
    },
];
