//! A straight piece of a device's clock.

/// y(x) = y₀ + slope · (x − x₀), ns against ns of device time since the epoch's start.
///
/// The absolute parts are integers; `f64` only ever holds the distance from the line's own point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    /// Device time of the line's point, ns.
    pub(super) x: i64,
    /// Arrival minus device time there, ns.
    pub(super) y: i64,
    /// dy/dx: how much slower than the host the device's clock runs, 1e-6 = 1 ppm.
    pub(super) slope: f64,
}

impl Line {
    /// y at `x`, rounded, with `extra` ns added before the rounding.
    ///
    /// One rounding keeps x + y(x) from falling anywhere: while |slope| + |extra'| < 1 the rounded sum changes by at
    /// most 1 where x changes by 1.
    pub(super) fn at_plus(&self, x: i64, extra: f64) -> i64 {
        let rise = self.slope * (x.saturating_sub(self.x)) as f64 + extra;
        // Rounded half up by floor: `round` would do as well, a cast alone rounds towards zero from both sides.
        self.y.saturating_add((rise + 0.5).floor() as i64)
    }

    /// y at `x`, rounded.
    pub(super) fn at(&self, x: i64) -> i64 {
        self.at_plus(x, 0.0)
    }
}
