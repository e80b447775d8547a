//! The pictures of `docs/simulation.md`, the Kinect's part: `cargo run -p tumbled-sim --example kinect_picture -- docs/simulation`.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::error::Error;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tumbled_kinect::{Intrinsics, RawDisparity};
use tumbled_model::RigNs;
use tumbled_sim::kinect::{DepthLaw, Frame, KinectModel, KinectParameters};
use tumbled_sim::motion::Still;
use tumbled_sim::shape::{Material, Mesh, Triangle};
use tumbled_sim::world::{Body, Role, World};

fn main() -> Result<(), Box<dyn Error>> {
    let folder =
        PathBuf::from(std::env::args().nth(1).ok_or("name the folder for the pictures, e.g. docs/simulation")?);
    whole_frame(&folder)?;
    edge(&folder)?;
    materials(&folder)?;
    errors(&folder)
}

/// A cuboid of these sides.
fn cuboid([x, y, z]: [f64; 3], material: Material) -> Mesh {
    let sign = |corner: u32, bit: u32| if corner >> bit & 1 == 1 { 0.5 } else { -0.5 };
    let vertices = (0..8).map(|c| Point3::new(x * sign(c, 0), y * sign(c, 1), z * sign(c, 2))).collect();
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangle = |corners| Triangle { corners, material };
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [triangle([a, b, c]), triangle([a, c, d])]).collect();
    Mesh { vertices, triangles }
}

fn body(role: Role, mesh: Mesh, place: [f64; 3], turn_deg: [f64; 3]) -> Body {
    let [x, y, z] = turn_deg.map(f64::to_radians);
    let rotation = UnitQuaternion::from_euler_angles(x, y, z);
    let at = Isometry3::from_parts(Translation3::from(Vector3::from(place)), rotation);
    Body { role, mesh: Arc::new(mesh), motion: Arc::new(Still(at)) }
}

fn room() -> Body {
    body(Role::Room, cuboid([5.0, 2.4, 6.0], Material::Matt), [0.0, -0.3, 0.5], [0.0; 3])
}

/// A box bus with two panels.
fn target(place: [f64; 3]) -> Body {
    let mut mesh = cuboid([0.7, 0.5, 0.5], Material::Matt);
    for side in [-1.0, 1.0] {
        mesh.add(&cuboid([0.5, 0.4, 0.02], Material::Matt), &Isometry3::translation(side * 0.65, 0.0, 0.0));
    }
    body(Role::Target, mesh, place, [20.0, 35.0, 10.0])
}

fn frame(parameters: KinectParameters, world: &World, index: u64) -> Result<Frame, Box<dyn Error>> {
    let kinect = KinectModel::new("picture", &Intrinsics::default(), Isometry3::identity(), parameters)?.with_truth();
    Ok(kinect.frame(world, RigNs(3_600_000_000_000), index, 1))
}

/// From blue (0) over white to red (1).
fn two_sided(share: f64) -> [u8; 3] {
    let away = (2.0 * share.clamp(0.0, 1.0) - 1.0).abs();
    let faded = (255.0 * (1.0 - away)) as u8;
    if share < 0.5 { [faded, faded, 255] } else { [255, faded, faded] }
}

/// Near: yellow; far: dark blue; no data: black.
fn depth_colour(frame: &Frame, [nearest, farthest]: [f64; 2], u: usize, v: usize) -> [u8; 3] {
    let Some(code) = frame.raw.at(u, v).filter(|code| *code != RawDisparity::NO_DATA) else { return [0; 3] };
    let metres = DepthLaw::default().metres(f64::from(code.0));
    let near = ((farthest - metres) / (farthest - nearest)).clamp(0.0, 1.0);
    [40.0 + 215.0 * near, 60.0 + 170.0 * near, 160.0 - 110.0 * near].map(|x| x as u8)
}

/// A part of the image, every pixel as a square of `zoom` pixels.
fn write(
    file: &Path,
    [left, top, width, height]: [usize; 4],
    zoom: usize,
    colour: impl Fn(usize, usize) -> [u8; 3],
) -> Result<(), Box<dyn Error>> {
    let (across, down) = (width * zoom, height * zoom);
    let mut encoder = png::Encoder::new(File::create(file)?, across as u32, down as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::High);
    let pixels = (0..down).flat_map(|y| (0..across).map(move |x| (left + x / zoom, top + y / zoom)));
    let bytes: Vec<u8> = pixels.flat_map(|(u, v)| colour(u, v)).collect();
    encoder.write_header()?.write_image_data(&bytes)?;
    Ok(())
}

/// The target in a room.
fn whole_frame(folder: &Path) -> Result<(), Box<dyn Error>> {
    let frame = frame(KinectParameters::default(), &World::new(vec![target([0.0, 0.05, 1.8]), room()]), 0)?;
    write(&folder.join("kinect-frame.png"), [0, 0, 640, 480], 1, |u, v| depth_colour(&frame, [1.2, 3.6], u, v))
}

/// Left end of a plate 1.2 m away before a wall at 2.4 m.
fn edge(folder: &Path) -> Result<(), Box<dyn Error>> {
    let plate = body(Role::Target, cuboid([0.5, 0.4, 0.02], Material::Matt), [0.0, 0.0, 1.21], [0.0; 3]);
    let wall = body(Role::Room, cuboid([9.0, 9.0, 0.1], Material::Matt), [0.0, 0.0, 2.45], [0.0; 3]);
    let frame = frame(KinectParameters::default(), &World::new(vec![plate, wall]), 0)?;
    write(&folder.join("kinect-edge.png"), [150, 110, 160, 120], 4, |u, v| depth_colour(&frame, [1.1, 2.6], u, v))
}

/// Rows: matt, dark, foil; columns: 0, 30, 50, 65, 75, 82 degrees between the plate's normal and the ray to its middle.
fn materials(folder: &Path) -> Result<(), Box<dyn Error>> {
    let mut bodies = Vec::new();
    for (material, y) in [(Material::Matt, -0.5), (Material::Dark, 0.0), (Material::Foil, 0.5)] {
        for (column, deg) in [0.0, 30.0, 50.0, 65.0, 75.0, 82.0_f64].into_iter().enumerate() {
            let place = Vector3::new(0.32 * column as f64 - 0.8, y, 1.9);
            let facing = UnitQuaternion::rotation_between(&Vector3::z(), &place).ok_or("in front of the camera")?;
            let turned = facing * UnitQuaternion::new(Vector3::x() * deg.to_radians());
            let at = Isometry3::from_parts(Translation3::from(place), turned);
            let mesh = Arc::new(cuboid([0.24, 0.4, 0.001], material));
            bodies.push(Body { role: Role::Target, mesh, motion: Arc::new(Still(at)) });
        }
    }
    let frame = frame(KinectParameters::default(), &World::new(bodies), 0)?;
    write(&folder.join("kinect-materials.png"), [0, 0, 640, 480], 1, |u, v| depth_colour(&frame, [1.6, 2.2], u, v))
}

/// A wall at 2 m: the error of one frame's disparities (± 1.5 steps), and of the mean depth of 100 frames (± 6 mm).
fn errors(folder: &Path) -> Result<(), Box<dyn Error>> {
    let wall = body(Role::Room, cuboid([9.0, 9.0, 0.1], Material::Matt), [0.0, 0.0, 2.05], [6.0, 9.0, 0.0]);
    let world = World::new(vec![wall]);
    let law = DepthLaw::default();
    let error = |frame: &Frame, u: usize, v: usize| {
        let code = frame.raw.at(u, v).filter(|code| *code != RawDisparity::NO_DATA)?;
        let true_m = f64::from(frame.truth.as_ref()?.depth.at(u, v)?);
        Some((f64::from(code.0), true_m))
    };
    let straight = frame(KinectParameters { warp_m: 0.0, ..KinectParameters::default() }, &world, 0)?;
    write(&folder.join("kinect-noise.png"), [200, 150, 160, 120], 4, |u, v| {
        error(&straight, u, v).map_or([0; 3], |(code, metres)| two_sided(0.5 + (code - law.disparity(metres)) / 3.0))
    })?;
    let mut sums = vec![(0.0, 0.0); 640 * 480];
    for index in 0..100 {
        let frame = frame(KinectParameters::default(), &world, index)?;
        for (at, sum) in sums.iter_mut().enumerate() {
            if let Some((code, metres)) = error(&frame, at % 640, at / 640) {
                *sum = (sum.0 + law.metres(code) - metres, sum.1 + 1.0);
            }
        }
    }
    // Blocks of four pixels, so that the picture stays small.
    write(&folder.join("kinect-warp.png"), [0, 0, 160, 120], 4, |u, v| {
        let block = (0..16).filter_map(|i| sums.get((4 * v + i / 4) * 640 + 4 * u + i % 4));
        let (sum, count) = block.fold((0.0, 0.0), |(a, b), (sum, count)| (a + sum, b + count));
        if count == 0.0 { [0; 3] } else { two_sided(0.5 + sum / count / 0.012) }
    })
}
