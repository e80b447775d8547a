//! A model as a picture: four views of its points, planes in colours of their own, with the contour.

use nalgebra::{Point3, Vector3};
use tumbled_core::recon::{EdgeKind, FusedPoint, Reconstruction};

use crate::cli::Failure;

/// A view is so many pixels wide and high; two beside each other, two rows.
const SIDE: usize = 560;
/// The part of a view that the model fills.
const FILLED: f64 = 0.88;
/// Azimuth about z and elevation of the eye, degrees.
const EYES: [(f64, f64); 4] = [(35.0, 22.0), (125.0, 22.0), (215.0, 22.0), (305.0, -22.0)];
/// An edge is drawn over points that hide it by less than this, m.
const OVER_M: f64 = 0.03;
const PAPER: [u8; 3] = [255, 255, 255];
const LOOSE: [f64; 3] = [150.0, 150.0, 150.0];

/// The picture, one pixel after the other, and how far from the eye what it shows is.
struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
    depths: Vec<f64>,
}

impl Canvas {
    fn put(&mut self, (x, y): (f64, f64), depth: f64, colour: [u8; 3], over_m: f64) {
        if !(x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64) {
            return;
        }
        let at = y as usize * self.width + x as usize;
        if let (Some(pixel), Some(held)) = (self.pixels.get_mut(at), self.depths.get_mut(at))
            && depth < *held + over_m
        {
            *pixel = colour;
            *held = held.min(depth);
        }
    }
}

/// How a view sees a place.
struct Eye {
    right: Vector3<f64>,
    up: Vector3<f64>,
    toward: Vector3<f64>,
    middle: Point3<f64>,
    pixels_per_m: f64,
    corner: (f64, f64),
}

impl Eye {
    fn see(&self, place: &Point3<f64>) -> ((f64, f64), f64) {
        let from = place - self.middle;
        let half = SIDE as f64 / 2.0;
        let x = self.corner.0 + half + from.dot(&self.right) * self.pixels_per_m;
        let y = self.corner.1 + half - from.dot(&self.up) * self.pixels_per_m;
        ((x, y), -from.dot(&self.toward))
    }
}

/// model.png.
///
/// # Errors
/// None that a model could cause.
pub fn png(model: &Reconstruction) -> Result<Vec<u8>, Failure> {
    let (width, height) = (2 * SIDE, 2 * SIDE);
    let mut canvas =
        Canvas { width, height, pixels: vec![PAPER; width * height], depths: vec![f64::INFINITY; width * height] };
    let (middle, radius) = about(&model.points);
    for ((azimuth, elevation), number) in EYES.iter().zip(0..) {
        let (azimuth, elevation) = (azimuth.to_radians(), elevation.to_radians());
        let toward = Vector3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
        let right = Vector3::z().cross(&toward).normalize();
        let eye = Eye {
            right,
            up: toward.cross(&right),
            toward,
            middle,
            pixels_per_m: FILLED * SIDE as f64 / (2.0 * radius),
            corner: ((number % 2 * SIDE) as f64, (number / 2 * SIDE) as f64),
        };
        draw(&mut canvas, model, &eye);
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(Failure::failed)?;
    writer.write_image_data(canvas.pixels.as_flattened()).map_err(Failure::failed)?;
    writer.finish().map_err(Failure::failed)?;
    Ok(bytes)
}

/// The middle of the points' box, and how far they reach from it, m.
fn about(points: &[FusedPoint]) -> (Point3<f64>, f64) {
    let Some(first) = points.first() else { return (Point3::origin(), 1.0) };
    let (low, high) = points
        .iter()
        .fold((first.place, first.place), |(low, high), point| (low.inf(&point.place), high.sup(&point.place)));
    let middle = nalgebra::center(&low, &high);
    let reach = points.iter().map(|point| (point.place - middle).norm()).fold(0.05, f64::max);
    (middle, reach)
}

fn draw(canvas: &mut Canvas, model: &Reconstruction, eye: &Eye) {
    // A disc of a point's share of the surface, with a little overlap.
    let radius = 0.75 * model.spacing_m;
    let steps = (radius * eye.pixels_per_m * 2.0).ceil().clamp(1.0, 40.0);
    for (point, plane) in model.points.iter().zip(&model.plane_of) {
        let facing = point.normal.dot(&eye.toward);
        if facing <= 0.0 {
            continue;
        }
        let normal =
            plane.and_then(|plane| model.planes.get(plane as usize)).map_or(point.normal, |plane| plane.normal);
        let light = 0.45 + 0.55 * normal.dot(&(eye.toward + eye.up * 0.6 + eye.right * 0.4).normalize()).max(0.0);
        let colour = plane.map_or(LOOSE, colour_of).map(|channel| (channel * light).clamp(0.0, 255.0) as u8);
        let aside = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let u = normal.cross(&aside).normalize();
        let v = normal.cross(&u);
        let count = steps as i32;
        for (a, b) in (-count..=count).flat_map(|a| (-count..=count).map(move |b| (a, b))) {
            let (a, b) = (f64::from(a) / steps, f64::from(b) / steps);
            if a * a + b * b <= 1.0 {
                let (at, depth) = eye.see(&(point.place + (u * a + v * b) * radius));
                canvas.put(at, depth, colour, 0.0);
            }
        }
    }
    for edge in &model.edges {
        let (colour, width) = match edge.kind {
            EdgeKind::Crease => ([20, 20, 20], 1.6),
            EdgeKind::Boundary => ([190, 30, 30], 1.6),
            EdgeKind::Occlusion => ([140, 140, 220], 0.8),
        };
        let steps = (edge.length_m() * eye.pixels_per_m * 2.0).ceil().max(1.0);
        for step in 0..=steps as usize {
            let place = edge.ends[0] + (edge.ends[1] - edge.ends[0]) * (step as f64 / steps);
            let ((x, y), depth) = eye.see(&place);
            for (dx, dy) in
                [(0.0, 0.0), (width / 2.0, 0.0), (-width / 2.0, 0.0), (0.0, width / 2.0), (0.0, -width / 2.0)]
            {
                canvas.put((x + dx, y + dy), depth, colour, OVER_M);
            }
        }
    }
}

/// A colour for a plane: hues a golden angle apart.
fn colour_of(plane: u32) -> [f64; 3] {
    let hue = (f64::from(plane) * 0.618_034).fract() * 6.0;
    [0.0, 4.0, 2.0].map(|shift| {
        let at = ((hue + shift) % 6.0 - 3.0).abs() - 1.0;
        110.0 + 130.0 * at.clamp(0.0, 1.0)
    })
}
