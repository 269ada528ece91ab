//! Reading tetrahedral meshes: each format, and what damaged files say.

use std::path::Path;

use circumsphere_support::tetrahedra::{TetrahedralMesh, TetrahedralMeshError, read_tetrahedral_mesh};

/// Two tetrahedra and a vertex that none of them uses. Tags have gaps, and one element is a triangle.
const MSH_4: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1\nanything\n$EndEntities\n\
    $Nodes\n2 6 10 90\n3 1 0 4\n10\n20\n30\n40\n0 0 0\n1 0 0\n0 1 0\n0 0 1e0\n2 1 1 2\n90\n80\n1 1 1 0.5 0.5\n9 9 9 0 0\n$EndNodes\n\
    $Elements\n2 3 1 3\n2 1 2 1\n1 10 20 30\n3 1 4 2\n2 10 20 30 40\n3 90 20 30 40\n$EndElements\n";

const MSH_2: &str = "$MeshFormat\r\n2.2 0 8\r\n$EndMeshFormat\r\n$Nodes\r\n6\r\n10 0 0 0\r\n20 1 0 0\r\n30 0 1 0\r\n40 0 0 1\r\n\
    90 1 1 1\r\n80 9 9 9\r\n$EndNodes\r\n$Elements\r\n3\r\n1 2 2 0 1 10 20 30\r\n2 4 2 0 1 10 20 30 40\r\n3 4 0 90 20 30 40\r\n\
    $EndElements\r\n$Surface\r\nwhatever\r\n$EndSurface\r\n";

const NODE: &str =
    "# A comment.\n6 3 1 0\n0 0 0 0 7 # attribute\n1 1 0 0 7\n2 0 1 0 7\n\n3 0 0 1 7\n4 1 1 1 7\n5 9 9 9 7\n# end\n";
const ELE: &str = "2 4 0\n0 0 1 2 3\n1 4 1 2 3\n";
const NODE_FROM_1: &str = "6 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n6 9 9 9\n";
const ELE_FROM_1: &str = "2 4 0\n1 1 2 3 4\n2 5 2 3 4\n";

fn expected() -> TetrahedralMesh {
    TetrahedralMesh {
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3], [9.0; 3]],
        tetrahedra: vec![[0, 1, 2, 3], [4, 1, 2, 3]],
    }
}

fn msh(text: &str) -> Result<TetrahedralMesh, TetrahedralMeshError> {
    TetrahedralMesh::from_msh_bytes(text.as_bytes(), Path::new("body.msh"))
}

fn tetgen(node: &str, ele: &str) -> Result<TetrahedralMesh, TetrahedralMeshError> {
    let (node_name, ele_name) = (Path::new("body.node"), Path::new("body.ele"));
    TetrahedralMesh::from_tetgen_bytes((node.as_bytes(), node_name), (ele.as_bytes(), ele_name))
}

#[test]
fn every_format_gives_the_same_mesh() {
    assert_eq!(msh(MSH_4).expect("version 4.1"), expected());
    assert_eq!(msh(MSH_2).expect("version 2.2"), expected());
    assert_eq!(tetgen(NODE, ELE).expect("from 0"), expected());
    assert_eq!(tetgen(NODE_FROM_1, ELE_FROM_1).expect("from 1"), expected());
}

#[test]
fn files_are_found_by_their_extension() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = |name: &str| folder.path().join(name);
    for (name, text) in [("body.node", NODE), ("body.ele", ELE), ("body.msh", MSH_4)] {
        std::fs::write(path(name), text).expect("a temporary file can be written");
    }
    for name in ["body.node", "body.ele", "body.msh"] {
        assert_eq!(read_tetrahedral_mesh(&path(name)).expect("valid"), expected(), "{name}");
    }
    let message = |name: &str| read_tetrahedral_mesh(&path(name)).expect_err("there is none").to_string();
    assert!(message("none.msh").contains("none.msh"));
    assert!(message("none.ele").contains("none.node"), "the vertices are read first");
    assert!(read_tetrahedral_mesh(folder.path()).expect_err("a folder").to_string().contains("not a regular file"));
}

/// Replaces a text that occurs once.
fn damaged(text: &str, from: &str, to: &str) -> String {
    assert_eq!(text.matches(from).count(), 1, "{from:?}");
    text.replacen(from, to, 1)
}

#[test]
fn damaged_gmsh_files_name_the_place() {
    for (from, to, parts) in [
        ("4.1 0 8", "4.1 1 8", &["binary"][..]),
        ("4.1 0 8", "4 0 8", &["version 4", "4.1 or 2.2"]),
        ("4.1 0 8", "four", &["line 2", "`four`"]),
        ("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n", "", &["line 1", "$MeshFormat"]),
        ("\n20\n", "\ntwenty\n", &["line 12", "`twenty`"]),
        ("\n20\n", "\n10\n", &["line 12", "node 10 occurs twice"]),
        ("0 1 0\n", "0 one 0\n", &["line 17", "`one`"]),
        ("0 1 0\n", "0 1\n", &["line 17", "the line ends"]),
        ("0 1 0\n", "0 nan 0\n", &["line 17", "not finite"]),
        ("0 1 0\n", "0 1e39 0\n", &["line 17", "not finite"]),
        ("2 6 10 90", "2 7 10 90", &["line 9", "7 nodes are announced", "6"]),
        ("2 6 10 90", "9 6 10 90", &["line 24", "a dimension", "`$EndNodes`"]),
        ("3 1 0 4", "3 1 0 99999999999999", &["line 15", "the tag of a node"]),
        ("3 1 0 4", "3 1 0 -4", &["line 10", "`-4`"]),
        ("2 3 1 3\n", "2 4 1 3\n", &["line 26", "4 elements are announced", "3"]),
        ("3 90 20 30 40", "3 91 20 30 40", &["line 31", "tetrahedron 3", "node 91"]),
        ("3 90 20 30 40", "3 90 20 30", &["line 31", "tetrahedron 3", "the line ends"]),
        ("3 90 20 30 40", "3 90 20 30 40 50", &["line 31", "more than 4 nodes"]),
        ("3 1 4 2", "3 1 11 2", &["line 30", "higher order", "linear"]),
        (
            "3 1 4 2\n2 10 20 30 40\n3 90 20 30 40\n",
            "2 1 2 2\n2 10 20 30\n3 10 20 30\n",
            &["no tetrahedra", "6 vertices", "3 elements"],
        ),
        ("$EndElements\n", "", &["ends early", "line 32", "$EndElements"]),
        ("$EndElements\n", "$EndElements\n$Nodes\n", &["line 33", "a second section"]),
        ("$EndElements\n", "1 2 3\n$EndElements\n", &["line 32", "$EndElements was expected"]),
        ("$EndElements\n", "$EndElements\nstray\n", &["line 33", "`stray`"]),
    ] {
        let message = msh(&damaged(MSH_4, from, to)).expect_err("the file is damaged").to_string();
        for part in ["body.msh"].iter().chain(parts) {
            assert!(message.contains(part), "{to:?} does not name {part:?}: {message}");
        }
    }
    for (from, to, parts) in [
        ("1 2 2 0 1 10", "1 2 99 0 1 10", &["line 15", "99 tags"][..]),
        ("\r\n6\r\n10", "\r\n99999999999999\r\n10", &["line 12", "`$EndNodes`"]),
    ] {
        let message = msh(&damaged(MSH_2, from, to)).expect_err("the file is damaged").to_string();
        for part in parts {
            assert!(message.contains(part), "{to:?} does not name {part:?}: {message}");
        }
    }
    for text in ["", "solid cube\n"] {
        assert!(msh(text).expect_err("no Gmsh file").to_string().contains("is not a Gmsh file"));
    }
    let marked = format!("\u{feff}{MSH_4}");
    assert_eq!(msh(&marked).expect("some editors begin a text so"), msh(MSH_4).expect("valid"));
    let _ = TetrahedralMesh::from_msh_bytes(&[0xff, 0xfe, b'\n', b'$'], Path::new("x")).expect_err("no text");
}

#[test]
fn damaged_tetgen_files_name_the_place() {
    for (node, ele, parts) in [
        (damaged(NODE, "6 3 1 0", "6 2 1 0"), ELE.to_owned(), &["body.node", "line 2", "dimension is 2"][..]),
        (damaged(NODE, "1 1 0 0 7", "3 1 0 0 7"), ELE.to_owned(), &["body.node", "line 4", "point 1 was expected"]),
        (damaged(NODE, "6 3 1 0", "9 3 1 0"), ELE.to_owned(), &["body.node", "ends early", "a point"]),
        (damaged(NODE, "6 3 1 0", "5 3 1 0"), ELE.to_owned(), &["body.node", "line 9", "last point of 5"]),
        (damaged(NODE, "0 0 0 0 7", "5 0 0 0 7"), ELE.to_owned(), &["body.node", "line 3", "must have 0 or 1"]),
        (NODE.to_owned(), damaged(ELE, "2 4 0", "2 10 0"), &["body.ele", "line 1", "10 points", "-o2"]),
        (NODE.to_owned(), damaged(ELE, "1 4 1 2 3", "1 6 1 2 3"), &["body.ele", "line 3", "tetrahedron 1", "point 6"]),
        (NODE.to_owned(), damaged(ELE, "1 4 1 2 3", "1 -4 1 2 3"), &["body.ele", "line 3", "`-4`"]),
        (NODE_FROM_1.to_owned(), damaged(ELE_FROM_1, "2 5 2", "2 0 2"), &["body.ele", "line 3", "point 0"]),
        (NODE.to_owned(), "0 4 0\n".to_owned(), &["body.ele", "no tetrahedra"]),
        (NODE.to_owned(), ELE_FROM_1.to_owned(), &["body.ele", "line 2", "tetrahedron 0 was expected"]),
    ] {
        let message = tetgen(&node, &ele).expect_err("the files are damaged").to_string();
        for part in parts {
            assert!(message.contains(part), "{part:?} is not in {message}");
        }
    }
}

#[test]
fn every_truncation_is_an_error_or_a_mesh_and_never_a_panic() {
    for text in [MSH_4, MSH_2] {
        for length in 0..text.len() {
            let _ = msh(&text[..length]);
        }
    }
    for length in 0..NODE.len() {
        let _ = tetgen(&NODE[..length], ELE);
    }
    for length in 0..ELE.len() {
        let _ = tetgen(NODE, &ELE[..length]);
    }
    // Every byte replaced by a digit, a sign, or a byte that is no text.
    for place in 0..MSH_4.len() {
        for byte in [b'9', b'-', b'$', b'\n', 0xff] {
            let mut bytes = MSH_4.as_bytes().to_vec();
            bytes[place] = byte;
            let _ = TetrahedralMesh::from_msh_bytes(&bytes, Path::new("body.msh"));
        }
    }
}
