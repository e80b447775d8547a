//! Decoded points, structure of arrays.

use core::ops::Range;

/// Which return of the laser pulse a point is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Return {
    /// The strongest return; in dual mode the second strongest when the strongest is also the last.
    Strongest = 1,
    /// The last return.
    Last = 2,
    /// Dual mode: strongest and last are the same return.
    Both = 3,
}

/// One point, as [`Points::get`] and [`Points::push`] speak of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LidarPoint {
    /// Coordinates in the sensor's frame ([`tumbled_model::Lidar`]), metres.
    pub xyz: [f32; 3],
    /// Distance along the beam, metres.
    pub range_m: f32,
    /// Direction of the beam at its own firing time, clockwise from above, radians, 0..2π.
    pub azimuth_rad: f32,
    /// Firing time after the packet's own stamp, ns. Negative only where a stamp marks the packet's end (HDL-64E S1, HDL-32E by setting).
    pub dt_ns: i32,
    /// Calibrated reflectivity, 0..=255.
    pub intensity: u8,
    /// Laser id in packet order.
    pub laser: u8,
    /// Rank of the laser by elevation, 0 = lowest.
    pub ring: u8,
    /// Firing sequence within the packet.
    pub column: u8,
    /// Which return.
    pub ret: Return,
}

macro_rules! columns {
    ($($(#[$doc:meta])* $name:ident: $t:ty),* $(,)?) => {
        /// Points as columns of equal length. Cleared and refilled: capacity is kept, so a steady stream does not allocate.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct Points {
            $($(#[$doc])* pub $name: Vec<$t>,)*
        }

        impl Points {
            /// Empty columns with room for `points` points.
            pub fn with_capacity(points: usize) -> Self {
                Self { $($name: Vec::with_capacity(points),)* }
            }

            /// Forgets the points, keeps the memory.
            pub fn clear(&mut self) {
                $(self.$name.clear();)*
            }

            /// Moves the point at `from` to `to` in every column; indices past the end change nothing.
            fn move_point(&mut self, from: usize, to: usize) {
                $(if from < self.$name.len() && to < self.$name.len() {
                    self.$name.swap(from, to);
                })*
            }

            /// Appends the points of `range` of other columns; indices past their end give nothing.
            pub fn extend_from_range(&mut self, other: &Self, range: Range<usize>) {
                $(self.$name.extend_from_slice(other.$name.get(range.start..range.end.min(other.$name.len())).unwrap_or_default());)*
            }

            /// Cuts every column to `len` points.
            pub fn truncate(&mut self, len: usize) {
                $(self.$name.truncate(len);)*
            }
        }
    };
}

columns! {
    /// Metres, forward.
    x: f32,
    /// Metres, left.
    y: f32,
    /// Metres, up.
    z: f32,
    /// See [`LidarPoint::range_m`].
    range_m: f32,
    /// See [`LidarPoint::azimuth_rad`].
    azimuth_rad: f32,
    /// See [`LidarPoint::dt_ns`].
    dt_ns: i32,
    /// See [`LidarPoint::intensity`].
    intensity: u8,
    /// See [`LidarPoint::laser`].
    laser: u8,
    /// See [`LidarPoint::ring`].
    ring: u8,
    /// See [`LidarPoint::column`].
    column: u8,
    /// See [`LidarPoint::ret`].
    ret: Return,
}

impl Points {
    /// How many points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Appends one point to every column.
    #[inline]
    pub fn push(&mut self, point: LidarPoint) {
        let [x, y, z] = point.xyz;
        self.x.push(x);
        self.y.push(y);
        self.z.push(z);
        self.range_m.push(point.range_m);
        self.azimuth_rad.push(point.azimuth_rad);
        self.dt_ns.push(point.dt_ns);
        self.intensity.push(point.intensity);
        self.laser.push(point.laser);
        self.ring.push(point.ring);
        self.column.push(point.column);
        self.ret.push(point.ret);
    }

    /// From point `start` on keeps only those with `min <= range_m <= max`, in their order.
    pub fn retain_range_m(&mut self, start: usize, min: f32, max: f32) {
        let mut kept = start;
        for index in start..self.len() {
            if self.range_m.get(index).is_some_and(|range| (min..=max).contains(range)) {
                self.move_point(index, kept);
                kept += 1;
            }
        }
        self.truncate(kept);
    }

    /// The point at `index`, put together from the columns.
    pub fn get(&self, index: usize) -> Option<LidarPoint> {
        Some(LidarPoint {
            xyz: [*self.x.get(index)?, *self.y.get(index)?, *self.z.get(index)?],
            range_m: *self.range_m.get(index)?,
            azimuth_rad: *self.azimuth_rad.get(index)?,
            dt_ns: *self.dt_ns.get(index)?,
            intensity: *self.intensity.get(index)?,
            laser: *self.laser.get(index)?,
            ring: *self.ring.get(index)?,
            column: *self.column.get(index)?,
            ret: *self.ret.get(index)?,
        })
    }

    /// The points of `range`, in order; indices past the end give nothing.
    pub fn iter_range(&self, range: Range<usize>) -> impl Iterator<Item = LidarPoint> + '_ {
        range.map_while(|index| self.get(index))
    }
}
