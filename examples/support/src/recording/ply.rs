//! PLY files, ASCII and binary, through `ply-rs-bw`.
//!
//! The crate reads one element type after the other into our own types, so that unused elements and properties take no
//! memory. It reserves at most 65536 elements at once, but it would count up to any number that a header claims. So the
//! counts are compared with the size of the file first.

use std::io::ErrorKind;
use std::path::Path;

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use super::{PolygonMesh, RecordingError, check_positions, push_fan};

/// The two common names of the corner list of a face.
const CORNER_LISTS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Longest part of a parser message that is passed on. Such messages quote lines of the file, which may have any
/// length.
const LONGEST_DETAIL: usize = 300;

/// Reads one PLY mesh. `frame` is only used in messages.
pub(super) fn decode(bytes: &[u8], name: &Path, frame: usize) -> Result<PolygonMesh, RecordingError> {
    if bytes.is_empty() {
        return Err(RecordingError::Empty { file: name.to_path_buf() });
    }
    let failed = |error: ParseError| describe(&error, name);
    let mut reader = Reader::new(bytes);
    let header = Parser::<Ignored>::new().read_header(&mut reader).map_err(failed)?;
    check_properties(&header, name)?;
    check_counts(&header, reader.get_ref().len(), name)?;

    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for element in header.elements.values() {
        match element.name.as_str() {
            "vertex" => vertices = read_elements(&mut reader, element, &header).map_err(failed)?,
            "face" => faces = read_elements(&mut reader, element, &header).map_err(failed)?,
            _ => {
                read_elements::<Ignored>(&mut reader, element, &header).map_err(failed)?;
            }
        }
    }
    check_rest(&header, reader.into_inner(), bytes.len(), name)?;

    let positions: Vec<[f32; 3]> = vertices.into_iter().map(|vertex: Vertex| vertex.position).collect();
    check_positions(&positions, faces.len(), name, frame)?;
    let triangles = triangulate(&faces, positions.len(), name)?;
    Ok(PolygonMesh { positions, triangles })
}

fn read_elements<E: PropertyAccess>(
    reader: &mut Reader<&[u8]>,
    element: &ElementDef,
    header: &Header,
) -> Result<Vec<E>, ParseError> {
    Parser::<E>::new().read_payload_for_element(reader, element, header)
}

fn describe(error: &ParseError, name: &Path) -> RecordingError {
    let message = error.to_string();
    let words: Vec<&str> = message.split_whitespace().collect();
    let mut detail = words.join(" ");
    if let Some((end, _)) = detail.char_indices().nth(LONGEST_DETAIL) {
        detail.truncate(end);
        detail.push('…');
    }
    if error.kind() == ErrorKind::UnexpectedEof {
        RecordingError::EndsEarly { file: name.to_path_buf(), detail }
    } else {
        RecordingError::malformed(name, "PLY", detail)
    }
}

/// Checks that vertices have coordinates and faces have corners, with readable types.
fn check_properties(header: &Header, name: &Path) -> Result<(), RecordingError> {
    let element = |wanted: &'static str| {
        header
            .elements
            .get(wanted)
            .ok_or_else(|| RecordingError::MissingElement { file: name.to_path_buf(), element: wanted })
    };
    let missing = |element, property| RecordingError::MissingProperty { file: name.to_path_buf(), element, property };

    let vertex = element("vertex")?;
    for (axis, property) in [
        ("x", "property `x` of type float or double"),
        ("y", "property `y` of type float or double"),
        ("z", "property `z` of type float or double"),
    ] {
        let is_real = vertex.properties.get(axis).is_some_and(|definition| {
            matches!(definition.data_type, PropertyType::Scalar(ScalarType::Float | ScalarType::Double))
        });
        if !is_real {
            return Err(missing("vertex", property));
        }
    }

    let face = element("face")?;
    let corner_lists = CORNER_LISTS
        .iter()
        .filter_map(|list| face.properties.get(*list))
        .filter(|definition| {
            matches!(&definition.data_type, PropertyType::List(count, corner)
                if is_integer(count) && is_integer(corner))
        })
        .count();
    // If both names are present, it is ambiguous which one to use.
    if corner_lists != 1 {
        return Err(missing("face", "single integer list `vertex_indices` or `vertex_index`"));
    }
    Ok(())
}

fn is_integer(scalar: &ScalarType) -> bool {
    !matches!(scalar, ScalarType::Float | ScalarType::Double)
}

/// Checks that the announced elements can fit into the `bytes` after the header.
fn check_counts(header: &Header, bytes: usize, name: &Path) -> Result<(), RecordingError> {
    let mut needed: u128 = 0;
    for element in header.elements.values() {
        let smallest: u64 = match header.encoding {
            // A line of text has a digit and a separator per property. The last separator may be missing.
            Encoding::Ascii => (2 * element.properties.len() as u64).max(1),
            Encoding::BinaryBigEndian | Encoding::BinaryLittleEndian => {
                let scalars = element.properties.values().map(|property| match &property.data_type {
                    PropertyType::Scalar(scalar) => scalar_bytes(scalar),
                    PropertyType::List(count, _) => scalar_bytes(count),
                });
                // An element without properties takes no bytes, but would still be counted through.
                scalars.sum::<u64>().max(1)
            }
        };
        needed += element.count as u128 * u128::from(smallest);
        if needed > bytes as u128 + 1 {
            return Err(RecordingError::TooManyElements {
                file: name.to_path_buf(),
                element: element.name.clone(),
                count: element.count as u64,
                bytes: bytes as u64,
            });
        }
    }
    Ok(())
}

fn scalar_bytes(scalar: &ScalarType) -> u64 {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Checks that the last element is followed by nothing, or only by white space in text.
///
/// Otherwise a header with too small a count would go unnoticed.
fn check_rest(header: &Header, rest: &[u8], bytes: usize, name: &Path) -> Result<(), RecordingError> {
    let is_clean = match header.encoding {
        Encoding::Ascii => rest.trim_ascii().is_empty(),
        Encoding::BinaryBigEndian | Encoding::BinaryLittleEndian => rest.is_empty(),
    };
    if is_clean {
        return Ok(());
    }
    Err(RecordingError::TrailingBytes {
        file: name.to_path_buf(),
        expected: (bytes - rest.len()) as u128,
        found: bytes as u64,
    })
}

fn triangulate(faces: &[Face], vertices: usize, name: &Path) -> Result<Vec<[u32; 3]>, RecordingError> {
    let mut triangles = Vec::with_capacity(faces.len());
    let mut corners = Vec::new();
    for (number, face) in faces.iter().enumerate() {
        if face.corners.len() < 3 {
            return Err(RecordingError::TooFewCorners {
                file: name.to_path_buf(),
                face: number,
                corners: face.corners.len(),
            });
        }
        corners.clear();
        for &index in &face.corners {
            let corner = u32::try_from(index).ok().filter(|&corner| (corner as usize) < vertices);
            corners.push(corner.ok_or_else(|| RecordingError::IndexOutOfRange {
                file: name.to_path_buf(),
                face: number,
                index,
                vertices,
            })?);
        }
        push_fan(&corners, &mut triangles);
    }
    Ok(triangles)
}

/// The part of an element `vertex` that is kept.
struct Vertex {
    position: [f32; 3],
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: [0.0; 3] }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        let Some(coordinate) = property.to_f32_lossy() else {
            return PropertyAccessResult::UnsupportedType;
        };
        self.position[axis] = coordinate;
        PropertyAccessResult::Set
    }
}

/// The part of an element `face` that is kept.
struct Face {
    corners: Vec<i64>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self { corners: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !CORNER_LISTS.contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        self.corners = match property {
            Property::ListChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListInt(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUInt(list) => list.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An element that a mesh does not need.
struct Ignored;

impl PropertyAccess for Ignored {
    fn new() -> Self {
        Self
    }
}
