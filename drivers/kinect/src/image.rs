//! A 640 × 480 image of one kind of pixel.

use crate::frame::{HEIGHT, PIXELS, RawDisparity, WIDTH};

/// 640 × 480 pixels, row by row from the top left. Made once and reused: decoding into it allocates nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    pixels: Box<[T]>,
}

/// Depth along the optical axis in metres, below 10; 0 = no data.
pub type DepthImage = Image<f32>;
/// Depth along the optical axis in millimetres, below 10 000; 0 = no data.
pub type MmImage = Image<u16>;
/// Raw disparities; [`RawDisparity::NO_DATA`] = no data.
pub type RawImage = Image<RawDisparity>;

impl DepthImage {
    /// An image without data.
    pub fn new() -> Self {
        Self::filled(0.0)
    }
}

impl MmImage {
    /// An image without data.
    pub fn new() -> Self {
        Self::filled(0)
    }
}

impl RawImage {
    /// An image without data.
    pub fn new() -> Self {
        Self::filled(RawDisparity::NO_DATA)
    }
}

macro_rules! default_is_no_data {
    ($($image:ty),*) => {$(
        impl Default for $image {
            fn default() -> Self {
                Self::new()
            }
        }
    )*};
}
default_is_no_data!(DepthImage, MmImage, RawImage);

impl<T: Copy> Image<T> {
    /// An image of one value.
    pub fn filled(value: T) -> Self {
        Self { pixels: vec![value; PIXELS].into_boxed_slice() }
    }

    /// The image whose pixel in column `u`, row `v` is `value(u, v)`.
    pub fn from_fn(mut value: impl FnMut(usize, usize) -> T) -> Self {
        Self { pixels: (0..PIXELS).map(|i| value(i % WIDTH, i / WIDTH)).collect() }
    }

    /// All 307 200 pixels: column u, row v at `v * 640 + u`.
    pub fn pixels(&self) -> &[T] {
        &self.pixels
    }

    /// All 307 200 pixels, to be changed.
    pub fn pixels_mut(&mut self) -> &mut [T] {
        &mut self.pixels
    }

    /// The pixel in column `u`, row `v`; `None` outside the image.
    pub fn at(&self, u: usize, v: usize) -> Option<T> {
        if u < WIDTH && v < HEIGHT { self.pixels.get(v * WIDTH + u).copied() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_row_by_row() {
        let image = Image::from_fn(|u, v| (u * 1_000 + v) as u32);
        assert_eq!(image.at(639, 2), Some(639_002));
        assert_eq!(image.pixels()[2 * 640 + 639], 639_002);
    }

    #[test]
    fn there_is_nothing_outside() {
        // Column 640 of row 0 would be column 0 of row 1 in memory.
        assert_eq!(MmImage::new().at(640, 0), None);
        assert_eq!(MmImage::new().at(0, 480), None);
    }
}
