//! The files of TetGen: `.node` with the vertices, and `.ele` with the tetrahedra. Both count either from 0 or from 1,
//! as the first vertex tells.

use std::path::Path;

use super::{
    TetrahedralMesh, TetrahedralMeshError,
    lines::{Line, Lines},
};

/// Begins a comment.
const COMMENT: Option<u8> = Some(b'#');

/// Reads the mesh of two files.
pub(super) fn decode(
    (node, node_name): (&[u8], &Path),
    (ele, ele_name): (&[u8], &Path),
) -> Result<TetrahedralMesh, TetrahedralMeshError> {
    let (positions, first) = read_nodes(&mut Lines::new(node, node_name, COMMENT))?;
    let tetrahedra = read_elements(&mut Lines::new(ele, ele_name, COMMENT), positions.len(), first)?;
    if tetrahedra.is_empty() {
        let (file, vertices) = (ele_name.to_path_buf(), positions.len());
        return Err(TetrahedralMeshError::NoTetrahedra { file, vertices, elements: 0 });
    }
    Ok(TetrahedralMesh { positions, tetrahedra })
}

/// The vertices, and the number of the first one.
fn read_nodes(lines: &mut Lines) -> Result<(Vec<[f32; 3]>, u64), TetrahedralMeshError> {
    let header = lines.expect("the number of points")?;
    let mut words = header.words();
    let count: u64 = words.number("the number of points")?;
    let dimension: u32 = words.number("the dimension")?;
    if dimension != 3 {
        return Err(header.error(format!("the dimension is {dimension}, but must be 3")));
    }
    let mut positions = Vec::with_capacity(lines.capacity(count));
    let mut first = 0;
    for point in 0..count {
        let line = lines.expect("a point")?;
        let mut words = line.words();
        let number: u64 = words.number("the number of a point")?;
        if point == 0 {
            first = number;
        }
        check_number(&line, "point", number, point, first)?;
        positions.push(words.position()?);
    }
    expect_end(lines, "point", count)?;
    Ok((positions, first))
}

fn read_elements(lines: &mut Lines, vertices: usize, first: u64) -> Result<Vec<[u32; 4]>, TetrahedralMeshError> {
    let header = lines.expect("the number of tetrahedra")?;
    let mut words = header.words();
    let count: u64 = words.number("the number of tetrahedra")?;
    let corners: u32 = words.number("the number of points of a tetrahedron")?;
    if corners != 4 {
        return Err(header.error(format!(
            "tetrahedra have {corners} points, but must have 4: make the mesh without TetGen's option -o2"
        )));
    }
    let mut tetrahedra = Vec::with_capacity(lines.capacity(count));
    for element in 0..count {
        let line = lines.expect("a tetrahedron")?;
        let mut words = line.words();
        let number: u64 = words.number("the number of a tetrahedron")?;
        check_number(&line, "tetrahedron", number, element, first)?;
        let mut tetrahedron = [0; 4];
        for corner in &mut tetrahedron {
            let point: u64 = words.number(&format!("a point of tetrahedron {number}"))?;
            let vertex = point.checked_sub(first).filter(|&vertex| vertex < vertices as u64);
            *corner = vertex.and_then(|vertex| u32::try_from(vertex).ok()).ok_or_else(|| {
                line.error(format!("tetrahedron {number} names point {point}, but there are {vertices} points"))
            })?;
        }
        tetrahedra.push(tetrahedron);
    }
    expect_end(lines, "tetrahedron", count)?;
    Ok(tetrahedra)
}

/// Checks that elements are numbered one by one from 0 or 1.
fn check_number(line: &Line, what: &str, number: u64, place: u64, first: u64) -> Result<(), TetrahedralMeshError> {
    if first > 1 {
        return Err(line.error(format!("the first {what} has number {first}, but must have 0 or 1")));
    }
    if number == first + place {
        return Ok(());
    }
    Err(line.error(format!("{what} {} was expected, but {number} was found", first + place)))
}

fn expect_end(lines: &mut Lines, what: &str, count: u64) -> Result<(), TetrahedralMeshError> {
    match lines.next() {
        None => Ok(()),
        Some(line) => Err(line.error(format!("continues after the last {what} of {count}"))),
    }
}
