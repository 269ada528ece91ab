//! ASCII files of Gmsh, version 4.1 or 2. Only the sections `$MeshFormat`, `$Nodes`, and `$Elements` are read.
//!
//! Both versions name nodes by tags, which need not be consecutive. Here, vertices are numbered by their place in the
//! file.

use std::{collections::HashMap, path::Path};

use super::{
    TetrahedralMesh, TetrahedralMeshError,
    lines::{Line, Lines, Words},
};

/// Gmsh's number of a tetrahedron with four nodes.
const TETRAHEDRON: u32 = 4;

/// Gmsh's numbers of tetrahedra with 10, 20, 35, and 56 nodes, and of the incomplete ones.
const CURVED_TETRAHEDRA: [u32; 7] = [11, 29, 30, 31, 32, 71, 137];

const NO_FORMAT: &str = "is not a Gmsh file: it does not begin with the section $MeshFormat";

/// Some editors put it in front of a text.
const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

#[derive(Clone, Copy, PartialEq)]
enum Version {
    Two,
    FourOne,
}

/// A tetrahedron whose nodes are still tags.
struct Element {
    tags: [u64; 4],
    tag: u64,
    line: usize,
}

#[derive(Default)]
struct Contents {
    positions: Vec<[f32; 3]>,
    vertex_of: HashMap<u64, u32>,
    tetrahedra: Vec<Element>,
    elements: usize,
}

/// Reads one Gmsh mesh.
pub(super) fn decode(bytes: &[u8], name: &Path) -> Result<TetrahedralMesh, TetrahedralMeshError> {
    let mut lines = Lines::new(bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes), name, None);
    let mut version = None;
    let mut contents = Contents::default();
    let (mut has_nodes, mut has_elements) = (false, false);
    while let Some(line) = lines.next() {
        let Some(section) = line.text().strip_prefix(b"$") else {
            if version.is_none() {
                return Err(TetrahedralMeshError::unsupported(name, NO_FORMAT));
            }
            return Err(line.error(format!("a section was expected, but `{}` was found", line.quote())));
        };
        let known = version.ok_or_else(|| line.error("the section $MeshFormat must come first"));
        match section {
            b"MeshFormat" => version = Some(read_version(&mut lines, name)?),
            b"Nodes" if std::mem::replace(&mut has_nodes, true) => return Err(line.error("a second section $Nodes")),
            b"Nodes" => contents.read_nodes(&mut lines, known?)?,
            b"Elements" if std::mem::replace(&mut has_elements, true) => {
                return Err(line.error("a second section $Elements"));
            }
            b"Elements" => contents.read_elements(&mut lines, known?)?,
            _ => _ = known?,
        }
        let end = [b"$End", section].concat();
        let is_read = matches!(section, b"MeshFormat" | b"Nodes" | b"Elements");
        loop {
            let line = lines.expect(&String::from_utf8_lossy(&end))?;
            if line.text() == end {
                break;
            }
            if is_read {
                let end = String::from_utf8_lossy(&end);
                return Err(line.error(format!("{end} was expected, but `{}` was found", line.quote())));
            }
        }
    }
    if version.is_none() {
        return Err(TetrahedralMeshError::unsupported(name, NO_FORMAT));
    }
    contents.finish(name)
}

fn read_version(lines: &mut Lines, name: &Path) -> Result<Version, TetrahedralMeshError> {
    let line = lines.expect("the version")?;
    let mut words = line.words();
    let version: f64 = words.number("the version")?;
    let file_type: u32 = words.number("the file type")?;
    if file_type != 0 {
        return Err(TetrahedralMeshError::unsupported(name, "is a binary Gmsh file: save it as ASCII"));
    }
    match version {
        4.1 => Ok(Version::FourOne),
        2.0..3.0 => Ok(Version::Two),
        _ => Err(TetrahedralMeshError::unsupported(
            name,
            format!("is a Gmsh file of version {version}: save it as version 4.1 or 2.2"),
        )),
    }
}

impl Contents {
    fn read_nodes(&mut self, lines: &mut Lines, version: Version) -> Result<(), TetrahedralMeshError> {
        let header = lines.expect("the number of nodes")?;
        let mut words = header.words();
        if version == Version::Two {
            let count: u64 = words.number("the number of nodes")?;
            self.positions.reserve(lines.capacity(count));
            for _ in 0..count {
                let line = lines.expect("a node")?;
                let mut words = line.words();
                let tag = words.number("the number of a node")?;
                self.add_tag(tag, self.positions.len(), &line)?;
                self.positions.push(words.position()?);
            }
            return Ok(());
        }
        let blocks: u64 = words.number("the number of blocks")?;
        let count: u64 = words.number("the number of nodes")?;
        self.positions.reserve(lines.capacity(count));
        for _ in 0..blocks {
            let line = lines.expect("a block of nodes")?;
            let mut words = line.words();
            for wanted in ["a dimension", "the tag of an entity", "0 or 1 (parametric)"] {
                words.number::<i64>(wanted)?;
            }
            let in_block: u64 = words.number("the number of nodes")?;
            for node in 0..in_block {
                let line = lines.expect("the tag of a node")?;
                let mut words = line.words();
                let tag = words.number("the tag of a node")?;
                if words.count() > 0 {
                    return Err(line.error(format!("the tag of a node was expected, but more follows after {tag}")));
                }
                let vertex = self.positions.len().saturating_add(usize::try_from(node).unwrap_or(usize::MAX));
                self.add_tag(tag, vertex, &line)?;
            }
            for _ in 0..in_block {
                // Parameters of the node on its entity may follow.
                let position = lines.expect("the coordinates of a node")?.words().position()?;
                self.positions.push(position);
            }
        }
        check_count(&header, "nodes", count, self.positions.len())
    }

    fn add_tag(&mut self, tag: u64, vertex: usize, line: &Line) -> Result<(), TetrahedralMeshError> {
        let vertex = u32::try_from(vertex).map_err(|_| line.error("more than 4294967295 nodes"))?;
        match self.vertex_of.insert(tag, vertex) {
            None => Ok(()),
            Some(_) => Err(line.error(format!("node {tag} occurs twice"))),
        }
    }

    fn read_elements(&mut self, lines: &mut Lines, version: Version) -> Result<(), TetrahedralMeshError> {
        let header = lines.expect("the number of elements")?;
        let mut words = header.words();
        if version == Version::Two {
            let count: u64 = words.number("the number of elements")?;
            for _ in 0..count {
                let line = lines.expect("an element")?;
                let mut words = line.words();
                let tag = words.number("the number of an element")?;
                let kind: u32 = words.number("the type of an element")?;
                let labels: usize = words.number("the number of tags")?;
                if labels > words.count() {
                    return Err(line.error(format!("element {tag} has fewer than {labels} tags")));
                }
                for _ in 0..labels {
                    words.number::<i64>("a tag")?;
                }
                self.add_element(tag, kind, words, &line)?;
            }
            return Ok(());
        }
        let blocks: u64 = words.number("the number of blocks")?;
        let count: u64 = words.number("the number of elements")?;
        for _ in 0..blocks {
            let line = lines.expect("a block of elements")?;
            let mut words = line.words();
            words.number::<i64>("a dimension")?;
            words.number::<i64>("the tag of an entity")?;
            let kind: u32 = words.number("the type of the elements")?;
            let in_block: u64 = words.number("the number of elements")?;
            for _ in 0..in_block {
                let line = lines.expect("an element")?;
                let mut words = line.words();
                let tag = words.number("the tag of an element")?;
                self.add_element(tag, kind, words, &line)?;
            }
        }
        check_count(&header, "elements", count, self.elements)
    }

    /// Adds an element if it is a tetrahedron. `words` are its nodes.
    fn add_element(&mut self, tag: u64, kind: u32, mut words: Words, line: &Line) -> Result<(), TetrahedralMeshError> {
        self.elements += 1;
        if CURVED_TETRAHEDRA.contains(&kind) {
            return Err(line.error(format!(
                "element {tag} is a tetrahedron of higher order (type {kind}): save the mesh with linear elements"
            )));
        }
        if kind != TETRAHEDRON {
            return Ok(());
        }
        let mut tags = [0; 4];
        for node in &mut tags {
            *node = words.number(&format!("a node of tetrahedron {tag}"))?;
        }
        if words.count() > 0 {
            return Err(line.error(format!("tetrahedron {tag} has more than 4 nodes")));
        }
        self.tetrahedra.push(Element { tags, tag, line: line.number });
        Ok(())
    }

    fn finish(self, name: &Path) -> Result<TetrahedralMesh, TetrahedralMeshError> {
        if self.tetrahedra.is_empty() {
            return Err(TetrahedralMeshError::NoTetrahedra {
                file: name.to_path_buf(),
                vertices: self.positions.len(),
                elements: self.elements,
            });
        }
        let vertices = |element: &Element| {
            let mut corners = [0; 4];
            for (corner, node) in corners.iter_mut().zip(element.tags) {
                *corner = *self.vertex_of.get(&node).ok_or_else(|| {
                    let detail = format!("tetrahedron {} names node {node}, which does not exist", element.tag);
                    TetrahedralMeshError::line(name, element.line, detail)
                })?;
            }
            Ok(corners)
        };
        let tetrahedra = self.tetrahedra.iter().map(vertices).collect::<Result<_, TetrahedralMeshError>>()?;
        Ok(TetrahedralMesh { positions: self.positions, tetrahedra })
    }
}

fn check_count(header: &Line, what: &str, announced: u64, found: usize) -> Result<(), TetrahedralMeshError> {
    if announced == found as u64 {
        return Ok(());
    }
    Err(header.error(format!("{announced} {what} are announced, but the blocks have {found}")))
}
