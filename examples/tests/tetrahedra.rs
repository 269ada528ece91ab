//! The program `tetrahedra` as users call it: its files, its table, and the errors it reports.

use std::{fmt::Write, fs};

use circumsphere_support::{
    programs::{self, Folder},
    recording::recordings_folder,
    tetrahedra::{TetrahedralMesh, read_tetrahedral_mesh, tetrahedral_ball, tetrahedral_box},
};
use glam::DVec3;

const HEADER: &str = "vertex_body,vertex,tetrahedron,barycentric_0,barycentric_1,barycentric_2,barycentric_3,depth,\
                      direction_x,direction_y,direction_z";

fn succeed(arguments: &[&str]) -> String {
    programs::succeed("tetrahedra", arguments)
}

/// The program must exit with code 2 and a message that contains all of `parts`.
fn refuse(arguments: &[&str], parts: &[&str]) {
    programs::refuse("tetrahedra", arguments, parts);
}

/// Writes a body into a folder and returns its path: Gmsh of version 4.1, with tags from 1.
fn written(folder: &Folder, name: &str, mesh: &TetrahedralMesh) -> String {
    let (vertices, elements) = (mesh.positions.len(), mesh.tetrahedra.len());
    let mut text =
        format!("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 {vertices} 1 {vertices}\n3 0 0 {vertices}\n");
    for tag in 1..=vertices {
        writeln!(text, "{tag}").expect("a string takes it");
    }
    for [x, y, z] in &mesh.positions {
        writeln!(text, "{x} {y} {z}").expect("a string takes it");
    }
    writeln!(text, "$EndNodes\n$Elements\n1 {elements} 1 {elements}\n3 0 4 {elements}").expect("a string takes it");
    for (tag, corners) in (1..).zip(&mesh.tetrahedra) {
        let [a, b, c, d] = corners.map(|corner| corner + 1);
        writeln!(text, "{tag} {a} {b} {c} {d}").expect("a string takes it");
    }
    text.push_str("$EndElements\n");
    folder.with(name, &text)
}

struct Row {
    /// Body, vertex, and tetrahedron.
    numbers: [usize; 3],
    weights: [f64; 4],
    depth: f64,
    direction: DVec3,
}

fn rows(path: &str) -> Vec<Row> {
    let text = fs::read_to_string(path).expect("the file was written");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some(HEADER));
    lines
        .map(|line| {
            let words: Vec<f64> = line.split(',').map(|word| word.parse().expect("a number")).collect();
            assert_eq!(words.len(), 11);
            let number = |place: usize| line.split(',').nth(place).expect("a word").parse().expect("a whole number");
            Row {
                numbers: [number(0), number(1), number(2)],
                weights: [words[3], words[4], words[5], words[6]],
                depth: words[7],
                direction: DVec3::new(words[8], words[9], words[10]),
            }
        })
        .collect()
}

fn points(mesh: &TetrahedralMesh, by: [f32; 3]) -> Vec<DVec3> {
    let moved = |p: &[f32; 3]| DVec3::from_array([p[0] + by[0], p[1] + by[1], p[2] + by[2]].map(f64::from));
    mesh.positions.iter().map(moved).collect()
}

/// Checks what every row claims, without looking for what is missing.
fn check_rows(rows: &[Row], meshes: [&TetrahedralMesh; 2], by: [f32; 3]) {
    let places = [points(meshes[0], [0.0; 3]), points(meshes[1], by)];
    assert!(rows.is_sorted_by_key(|row| [row.numbers[0], row.numbers[1]]));
    for Row { numbers: [body, vertex, tetrahedron], weights, depth, direction } in rows {
        let (point, other) = (places[*body][*vertex], 1 - body);
        let corners = meshes[other].tetrahedra[*tetrahedron].map(|corner| places[other][corner as usize]);
        let at: DVec3 = corners.iter().zip(weights).map(|(&corner, &weight)| corner * weight).sum();
        let size = corners.iter().map(|corner| corner.distance(corners[0])).fold(0.0, f64::max);
        assert!(at.distance(point) <= 1.0e-9 * size, "{vertex} in {tetrahedron}: {at} {point}");
        assert!(weights.iter().all(|&weight| weight >= 0.0));
        assert!(*depth >= 0.0 && (direction.length() - 1.0).abs() < 1.0e-12);
    }
}

#[test]
fn the_file_holds_every_vertex_in_the_other_body_once() {
    let folder = Folder::new();
    let (large, small) = (tetrahedral_box([4; 3], [1.0; 3]), tetrahedral_ball(4, 0.5));
    let by = [0.25, -0.125, 0.0];
    let (first, second, file) =
        (written(&folder, "a.msh", &large), written(&folder, "b.msh", &small), folder.path("c.csv"));
    let table = succeed(&[&first, &second, "--translate", "0.25,-0.125,0", "--containments", &file]);
    let rows = rows(&file);
    check_rows(&rows, [&large, &small], by);
    // The ball is all inside the box, and the vertices of the box within the ball are a few of its lattice.
    let of_ball = rows.iter().filter(|row| row.numbers[0] == 1).count();
    assert_eq!(of_ball, small.positions.len());
    let ball_in = rows.len() - of_ball;
    assert!((1..=4).contains(&ball_in), "{ball_in}");
    for (row, point) in rows.iter().filter(|row| row.numbers[0] == 1).zip(points(&small, by)) {
        let room = (DVec3::ONE - point.abs()).min_element();
        assert!((row.depth - room).abs() < 1.0e-12, "{point}");
        // Along the way out, the vertex ends on a side of the box.
        let end = point + row.direction * row.depth;
        assert!((end.abs().max_element() - 1.0).abs() < 1.0e-12, "{point} {end}");
    }
    assert!(table.contains("tetrahedra") && table.contains(&rows.len().to_string()), "{table}");
}

#[test]
fn bodies_apart_give_a_file_with_a_header_only() {
    let folder = Folder::new();
    let body = written(&folder, "a.msh", &tetrahedral_box([2; 3], [1.0; 3]));
    let file = folder.path("c.csv");
    succeed(&[&body, &body, "--translate", "-3,0,0", "--containments", &file]);
    assert!(rows(&file).is_empty());
    // Without a translation they are at the same place.
    succeed(&[&body, &body, "--containments", &file]);
    assert_eq!(rows(&file).len(), 2 * 27);
}

#[test]
fn the_embedded_scene_comes_to_rest_without_an_inverted_tetrahedron() {
    let folder = Folder::new();
    let file = folder.path("c.csv");
    let table = succeed(&["--containments", &file]);
    assert!(rows(&file).is_empty(), "at the end, nothing is inside");
    let lines: Vec<Vec<f64>> = table
        .lines()
        .map(|line| line.split_whitespace().map_while(|word| word.parse().ok()).collect())
        .filter(|words: &Vec<f64>| words.len() == 6)
        .collect();
    assert!(lines.len() > 10 && lines.last().is_some_and(|words| words[0] == 179.0), "{table}");
    // They are pressed, corners down to the least volume that contacts leave, and never turned inside out.
    let least = lines.iter().map(|words| words[4]).fold(f64::INFINITY, f64::min);
    assert!((0.049..0.95).contains(&least), "{table}");
    assert!(table.contains("median"), "{table}");
}

#[test]
fn given_bodies_give_valid_rows() {
    let Some(data) = recordings_folder() else { return };
    let path = |name: &str| data.join("tetrahedra").join(name).with_extension("msh");
    let folder = Folder::new();
    let file = folder.path("c.csv");
    let mut count = 0;
    for (first, second, by, text) in [
        ("torus", "bar-186", [0.5, 0.0, 0.0], "0.5,0,0"),
        ("sphere1K", "cow_head", [0.1, 0.1, 0.0], "0.1,0.1,0"),
        ("mat20x20", "mat20x20", [0.01, 0.005, 0.01], "0.01,0.005,0.01"),
    ] {
        let paths = [path(first), path(second)];
        let [a, b] = paths.each_ref().map(|path| path.to_str().expect("the folder has a plain name"));
        succeed(&[a, b, "--translate", text, "--containments", &file]);
        let rows = rows(&file);
        let [a, b] = paths.each_ref().map(|path| read_tetrahedral_mesh(path).expect("valid"));
        check_rows(&rows, [&a, &b], by);
        count += rows.len();
    }
    println!("{count} rows");
    assert!(count > 100, "{count} rows");
}

#[test]
fn bad_input_exits_with_2_and_names_the_place() {
    let folder = Folder::new();
    let good = written(&folder, "a.msh", &tetrahedral_box([1; 3], [1.0; 3]));
    let text = fs::read_to_string(&good).expect("it was written");
    let bad = folder.with("bad.msh", text.replacen("1 1 2 4 8", "1 1 2 4 80", 1));
    refuse(&[&good, &bad], &["bad.msh", "line 27", "tetrahedron 1", "node 80"]);
    let truncated = folder.with("short.msh", &text[..text.len() / 2]);
    refuse(&[&truncated, &good], &["short.msh", "line"]);
    refuse(&[&good, &folder.path("none.msh")], &["none.msh"]);
    refuse(&[&good], &["SECOND"]);
    refuse(&["--translate", "1,2,3"], &["FIRST"]);
    for translation in ["1,2", "1,2,3,4", "1,2,x", "inf,0,0", ""] {
        refuse(&[&good, &good, "--translate", translation], &["--translate"]);
    }
    refuse(&[&good, &good, "--translate", "3.4e38,0,0"], &["a.msh"]);
    refuse(&[&good, &good, "--containments", &folder.path("none/c.csv")], &["c.csv"]);
    refuse(&[&good, &good, "--containments", &good], &["a.msh", "overwritten"]);
    assert_eq!(fs::read_to_string(&good).expect("it was written"), text);
    let other = folder.with("other.msh", "solid cube\n");
    refuse(&[&other, &good], &["other.msh", "not a Gmsh file"]);
    let flat = written(
        &folder,
        "flat.msh",
        &TetrahedralMesh { positions: vec![[0.0; 3]; 4], tetrahedra: vec![[0, 1, 2, 3]; 2] },
    );
    refuse(&[&flat, &good], &["flat.msh", "no surface"]);
    #[cfg(not(feature = "rerun"))]
    refuse(&[&good, &good, "--rerun", "x.rrd"], &["--features rerun"]);
}
