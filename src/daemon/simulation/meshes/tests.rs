use super::*;
use proptest::prelude::*;
use std::fs;

/// A file of this name and content, read.
fn read_as(name: &str, content: impl AsRef<[u8]>) -> Result<Brought, GeometryError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(name);
    fs::write(&path, content).expect("writes");
    read(&path)
}

fn problem(name: &str, content: impl AsRef<[u8]>) -> String {
    read_as(name, content).expect_err("no mesh").to_string()
}

/// Corners of every triangle, in order.
fn triangles(mesh: &Mesh) -> Vec<[Point3<f64>; 3]> {
    mesh.triangles.iter().map(|triangle| mesh.corners(triangle).expect("its corners")).collect()
}

fn area(mesh: &Mesh) -> f64 {
    triangles(mesh).into_iter().map(|[a, b, c]| (b - a).cross(&(c - a)).norm() / 2.0).sum()
}

/// Triangles by their corners' places.
type Indexed = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// 4 to 40 vertices in general position within ±100, 1 to 60 triangles of three different ones.
fn mesh() -> impl Strategy<Value = Indexed> {
    let vertices = prop::collection::vec([-100.0f32..100.0, -100.0f32..100.0, -100.0f32..100.0], 4..40);
    (vertices, prop::collection::vec(any::<[u32; 3]>(), 1..60)).prop_map(|(vertices, faces)| {
        let n = vertices.len() as u32;
        let different = |[a, b, c]: [u32; 3]| {
            let a = a % n;
            let b = (a + 1 + b % (n - 1)) % n;
            let c = (0..n).cycle().skip((c % n) as usize).find(|c| *c != a && *c != b).unwrap_or_default();
            [a, b, c]
        };
        (vertices, faces.into_iter().map(different).collect())
    })
}

/// What is to come back.
fn expected((vertices, faces): &Indexed) -> Vec<[Point3<f64>; 3]> {
    let place = |corner: u32| Point3::from(vertices[corner as usize].map(f64::from));
    let all = faces.iter().map(|face| face.map(place));
    all.filter(|[a, b, c]| has_area([a, b, c])).collect()
}

fn as_obj((vertices, faces): &Indexed) -> String {
    let mut text = "# made by a test\nmtllib nothing.mtl\no thing\n".to_owned();
    // As decimals of the doubles: this format's numbers have no width.
    let mut vertex = |[x, y, z]: [f64; 3]| text.push_str(&format!("v {x:?} {y:?} {z:?}\n"));
    vertices.iter().for_each(|place| vertex(place.map(f64::from)));
    text.push_str("vt 0 0\nvn 0 0 1\nusemtl none\n");
    for (n, face) in faces.iter().enumerate() {
        // Counted from 1, with places that mean nothing here, or back from the end.
        let [a, b, c] = face.map(|corner| corner + 1);
        let [d, e, f] = face.map(|corner| i64::from(corner) - vertices.len() as i64);
        text.push_str(&if n % 2 == 0 { format!("f {a}/1/1 {b}//9 {c}\n") } else { format!("f {d} {e} {f}\n") });
    }
    text
}

fn as_text_stl((vertices, faces): &Indexed) -> String {
    let mut text = "solid\n".to_owned();
    for face in faces {
        text.push_str("facet normal 0 0 0\n outer loop\n");
        face.iter().for_each(|corner| {
            let [x, y, z] = vertices[*corner as usize];
            text.push_str(&format!("  vertex {x:?} {y:e} {z:?}\n"));
        });
        text.push_str(" endloop\nendfacet\n");
    }
    text + "endsolid\n"
}

fn as_binary_stl((vertices, faces): &Indexed) -> Vec<u8> {
    let mut bytes = b"solid, says the header of a binary file".to_vec();
    bytes.resize(80, b' ');
    bytes.extend((faces.len() as u32).to_le_bytes());
    for face in faces {
        bytes.extend([0; 12]);
        let corners = face.iter().flat_map(|corner| vertices[*corner as usize]);
        corners.for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ply_header((vertices, faces): &Indexed, format: &str, index: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment made by a test\nelement vertex {}\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nelement face {}\nproperty list uchar int {index}\nend_header\n",
        vertices.len(),
        faces.len()
    )
}

fn as_text_ply(mesh: &Indexed) -> String {
    let mut text = ply_header(mesh, "ascii", "vertex_indices");
    mesh.0.iter().for_each(|[x, y, z]| text.push_str(&format!("{x:?} {y:?} {z:?} 255\n")));
    mesh.1.iter().for_each(|[a, b, c]| text.push_str(&format!("3 {a} {b} {c}\n")));
    text
}

fn as_binary_ply(mesh: &Indexed, big: bool) -> Vec<u8> {
    let format = if big { "binary_big_endian" } else { "binary_little_endian" };
    let mut bytes = ply_header(mesh, format, "vertex_index").into_bytes();
    for vertex in &mesh.0 {
        vertex.iter().for_each(|x| bytes.extend(if big { x.to_be_bytes() } else { x.to_le_bytes() }));
        bytes.push(7);
    }
    for face in &mesh.1 {
        bytes.push(3);
        face.iter().for_each(|n| bytes.extend(if big { n.to_be_bytes() } else { n.to_le_bytes() }));
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn a_mesh_comes_back_from_every_format(mesh in mesh()) {
        let files = [
            ("m.obj", as_obj(&mesh).into_bytes()),
            ("m.stl", as_text_stl(&mesh).into_bytes()),
            ("M.STL", as_binary_stl(&mesh)),
            ("m.ply", as_text_ply(&mesh).into_bytes()),
            ("m.ply", as_binary_ply(&mesh, false)),
            ("m.ply", as_binary_ply(&mesh, true)),
        ];
        let expected = expected(&mesh);
        for (name, content) in files {
            match read_as(name, content) {
                Ok(brought) => {
                    prop_assert_eq!(triangles(&brought.mesh), expected.clone(), "{}", name);
                    prop_assert_eq!(brought.without_area, mesh.1.len() - expected.len());
                }
                Err(error) => prop_assert!(expected.is_empty(), "{}", error),
            }
        }
    }

    #[test]
    fn garbage_is_an_error_or_a_mesh_of_finite_triangles(
        bytes in prop::collection::vec(any::<u8>(), 0..400),
        words in prop::collection::vec("(v|f|facet|solid|endsolid|vertex|outer loop|ply|element face|[-+]?[0-9]{1,20}(\\.[0-9]e[0-9]{1,3})?|nan|inf|/|\\\\|\n| |property list uchar int x|end_header)", 0..60),
        begin in prop::sample::select(vec!["", "solid x\n", "ply\nformat ascii 1.0\n", "ply\nformat binary_little_endian 1.0\n", "v 1 2 3\nv 1 2 4\nv 0 0 0\n"]),
    ) {
        let text = format!("{begin}{}", words.join(" "));
        let both = [begin.as_bytes(), &bytes].concat();
        for parse in [obj::parse, stl::parse, ply::parse] {
            for content in [text.as_bytes(), &bytes, &both] {
                if let Ok(brought) = parse(content).and_then(surface) {
                    prop_assert!(brought.mesh.vertices.iter().all(|vertex| vertex.iter().all(|x| x.is_finite())));
                }
            }
        }
    }

    #[test]
    fn a_file_that_was_damaged_is_an_error_or_a_mesh(
        mesh in mesh(), at in any::<prop::sample::Index>(), byte in any::<u8>(), cut in any::<prop::sample::Index>(),
    ) {
        for (parse, mut content) in [
            (obj::parse as fn(&[u8]) -> Result<Polygons, Wrong>, as_obj(&mesh).into_bytes()),
            (stl::parse, as_text_stl(&mesh).into_bytes()),
            (stl::parse, as_binary_stl(&mesh)),
            (ply::parse, as_text_ply(&mesh).into_bytes()),
            (ply::parse, as_binary_ply(&mesh, true)),
        ] {
            let place = at.index(content.len());
            content[place] = byte;
            let cut = cut.index(content.len());
            for content in [&content[..], &content[..cut]] {
                if let Ok(brought) = parse(content).and_then(surface) {
                    prop_assert!(!brought.mesh.triangles.is_empty());
                }
            }
        }
    }
}

const CORNERS: &str = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv 2 1 0\n";

#[test]
fn polygons_become_triangles_of_the_same_area() {
    let square = read_as("m.obj", format!("{CORNERS}f 1 2 3 4\n")).expect("a mesh");
    assert_eq!((square.mesh.triangles.len(), area(&square.mesh)), (2, 16.0));
    // With a dent from the side 0–4 up to (2, 1): 16 less a triangle of 4 · 1 / 2. A fan from the first corner would
    // fold over it.
    let dented = read_as("m.obj", format!("{CORNERS}f 1 5 2 3 4\n")).expect("a mesh");
    assert_eq!((dented.mesh.triangles.len(), area(&dented.mesh)), (3, 14.0));
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
        element face 1\nproperty list uchar uint vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
    assert_eq!(area(&read_as("m.ply", ply).expect("a mesh").mesh), 1.0);
}

#[test]
fn triangles_without_area_and_vertices_of_none_are_left_out() {
    let text = format!("{CORNERS}v 2 2 0\nf 1 2 3\nf 1 6 3\nf 1 1 2\nf 1 2\n");
    let brought = read_as("m.obj", text).expect("a mesh");
    // (0,0), (2,2), (4,4) lie on a line; 1 1 2 has two corners; `f 1 2` is a line.
    assert_eq!((brought.mesh.triangles.len(), brought.mesh.vertices.len(), brought.without_area), (1, 3, 2));
}

#[test]
fn two_solids_in_one_text_and_capital_letters_are_read() {
    let one = as_text_stl(&(vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]));
    let brought = read_as("m.stl", format!("{}\n{}", one.to_uppercase(), one)).expect("a mesh");
    assert_eq!((brought.mesh.triangles.len(), area(&brought.mesh)), (2, 1.0));
}

#[test]
fn errors_say_the_file_the_line_and_what_was_expected() {
    let error = problem("m.obj", "v 0 0 0\n\nv 1 x 0\n");
    assert!(error.contains("m.obj:3") && error.contains("three numbers"), "{error}");
    let error = problem("m.obj", format!("{CORNERS}f 1 2 three\nf 1 2 3\n"));
    assert!(error.contains("m.obj:6"), "{error}");
    let error = problem("m.obj", format!("{CORNERS}f 1 2 9\n"));
    assert!(error.contains("not there"), "{error}");
    let error = problem("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 nan\nf 1 2 3\n");
    assert!(error.contains("vertex 3") && error.contains("NaN"), "{error}");
    let error = problem("m.obj", CORNERS);
    assert!(error.contains("no faces"), "{error}");
    let error = problem("m.stl", "solid x\nfacet normal 0 0 0\nouter loop\nvertex 0 0\n");
    assert!(error.contains("m.stl:4"), "{error}");
    let error = problem("m.stl", [b'x'; 134 + 1]);
    assert!(error.contains("135 bytes") && error.contains("solid"), "{error}");
    let header =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let error = problem("m.ply", format!("{header}0 0 zero\n"));
    assert!(error.contains("m.ply:8"), "{error}");
    let error = problem("m.ply", format!("{header}0 0 0\n"));
    assert!(error.contains("no faces"), "{error}");
    let error = problem("m.ply", header.replace("vertex 1", "vertex 99999999999"));
    assert!(error.contains("99999999999"), "{error}");
    let error = problem("m.step", "");
    assert!(error.contains(".obj, .stl or .ply"), "{error}");
    let error = read(Path::new("nowhere/m.obj")).expect_err("no file").to_string();
    assert!(error.contains("cannot be read"), "{error}");
}

#[test]
fn a_mesh_of_too_many_triangles_is_refused() {
    let faces = vec![vec![0, 1, 2]; MOST_TRIANGLES + 1];
    let polygons = Polygons { vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], faces };
    let wrong = surface(polygons).expect_err("too many");
    assert!(wrong.problem.contains("1000001"), "{}", wrong.problem);
}
