use super::*;
use proptest::prelude::*;
use std::fs;
use std::path::PathBuf;

fn written(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(name);
    fs::write(&path, bytes).expect("writes");
    (folder, path)
}

fn of(name: &str, bytes: &[u8]) -> Result<ReadCloud, GeometryError> {
    let (_folder, path) = written(name, bytes);
    read(&path)
}

const POINTS: [[f32; 3]; 3] = [[1.0, -2.0, 3.5], [0.25, 0.5, 4.0], [-1.0, 0.0, 2.0]];

fn header(format: &str, number: &str, count: usize) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment made by hand\nelement vertex {count}\nproperty {number} x\nproperty {number} y\n\
        property {number} z\nproperty uchar ring\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

#[test]
fn text_and_binary_floats_and_doubles_with_more_properties_are_one_cloud() {
    let text: String = POINTS.iter().map(|[x, y, z]| format!("{x} {y} {z} 7\n")).collect();
    let binary = |bytes: fn(f32, bool) -> Vec<u8>, big: bool| -> Vec<u8> {
        let point = |point: &[f32; 3]| point.iter().flat_map(|n| bytes(*n, big)).chain([7]).collect::<Vec<u8>>();
        POINTS.iter().flat_map(point).collect()
    };
    let float = |n: f32, big| if big { n.to_be_bytes().to_vec() } else { n.to_le_bytes().to_vec() };
    let double = |n: f32, big| if big { f64::from(n).to_be_bytes() } else { f64::from(n).to_le_bytes() }.to_vec();
    let expected = ReadCloud { points: POINTS.map(Point3::from).to_vec(), not_finite: 0 };
    for (format, number, body) in [
        ("ascii", "float", text.clone().into_bytes()),
        ("ascii", "double", text.into_bytes()),
        ("binary_little_endian", "float", binary(float, false)),
        ("binary_little_endian", "double", binary(double, false)),
        ("binary_big_endian", "float32", binary(float, true)),
        ("binary_big_endian", "float64", binary(double, true)),
    ] {
        let bytes = [header(format, number, 3).into_bytes(), body].concat();
        assert_eq!(of("cloud.ply", &bytes).expect("a cloud"), expected, "{format} {number}");
    }
}

#[test]
fn points_that_are_not_finite_are_left_out_and_counted() {
    let body = "1 2 3 0\nnan NaN -nan 0\n4 5 -inf 0\n7 8 9 0\n";
    let cloud = of("cloud.ply", format!("{}{body}", header("ascii", "float", 4)).as_bytes()).expect("a cloud");
    assert_eq!((cloud.points.len(), cloud.not_finite), (2, 2));
}

#[test]
fn a_pts_file_is_the_first_three_numbers_of_its_records() {
    let record =
        |[x, y, z]: [f32; 3]| [x.to_le_bytes(), y.to_le_bytes(), z.to_le_bytes(), [1; 4], [2; 4], [3; 4]].concat();
    let bytes: Vec<u8> = POINTS.into_iter().flat_map(record).collect();
    assert_eq!(of("cloud.pts", &bytes).expect("a cloud").points, POINTS.map(Point3::from).to_vec());
    let error = of("cloud.pts", &bytes[..70]).expect_err("cut off").to_string();
    assert!(error.contains("70 bytes, a multiple of 24 expected"), "{error}");
}

#[test]
fn what_is_no_cloud_is_told_with_file_finding_and_expectation() {
    let error = |name: &str, text: &str| of(name, text.as_bytes()).expect_err("no cloud").to_string();
    assert!(error("cloud.xyz", "1 2 3").contains("ends in .ply or .pts"));
    assert!(error("cloud.ply", "solid").contains("cloud.ply:1"));
    let no_z = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n";
    assert!(error("cloud.ply", no_z).contains("no property `z`"));
    let no_vertex = "ply\nformat ascii 1.0\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n";
    assert!(error("cloud.ply", no_vertex).contains("no element `vertex`"));
    assert!(error("cloud.ply", &header("ascii", "float", 3)).contains("cloud.ply"));
    let many = header("binary_little_endian", "float", 4_000_000_000);
    assert!(error("cloud.ply", &many).contains("4000000000 elements `vertex`"));
    assert!(read(Path::new("/no/such/cloud.ply")).expect_err("no file").to_string().contains("cannot be read"));
}

proptest! {
    #[test]
    fn no_bytes_make_it_fail_otherwise_than_by_saying_so(
        bytes in prop::collection::vec(any::<u8>(), 0..400), format in 0..3usize, count in 0..40usize,
    ) {
        let format = ["ascii", "binary_little_endian", "binary_big_endian"][format];
        let whole = [header(format, "float", count).into_bytes(), bytes.clone()].concat();
        for (parsed, least) in [(ply::parse(&whole), count), (ply::parse(&bytes), 0), (pts::parse(&bytes), bytes.len() / 24)] {
            if let Ok(points) = parsed {
                prop_assert_eq!(points.len(), least);
            }
        }
    }
}
