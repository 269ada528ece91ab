//! The buffer of a binary glTF file.

use std::borrow::Cow;

use bevy_gltf::gltf::binary::{Glb, Header};
use circumsphere_support::scenes::Mesh;
use glam::Vec3;
use serde_json::{Value, json};

/// Component types of glTF 2.0, section 3.6.2.2.
pub(crate) const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
pub(crate) const FLOAT: u32 = 5126;

/// The buffer of a file, and what it says about it.
#[derive(Default)]
pub(crate) struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Adds numbers, and returns the index of their accessor. `kind` is its `type`.
    pub(crate) fn add(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }));
        let view = self.views.len() - 1;
        self.accessors.push(json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }));
        self.accessors.len() - 1
    }

    pub(crate) fn add_floats<const N: usize>(&mut self, values: &[[f32; N]], kind: &str) -> usize {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
        let accessor = self.add(&bytes, FLOAT, kind, values.len());
        // Positions and times need their bounds.
        let bound = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..N).map(|axis| values.iter().map(|value| value[axis]).reduce(pick).unwrap_or_default()).collect()
        };
        self.accessors[accessor]["min"] = json!(bound(f32::min));
        self.accessors[accessor]["max"] = json!(bound(f32::max));
        accessor
    }

    /// Adds a mesh of one primitive, with the attributes that are given beside positions and normals.
    pub(crate) fn add_mesh(&mut self, name: &str, mesh: &Mesh, mut attributes: Value) -> Value {
        attributes["POSITION"] = json!(self.add_floats(&mesh.positions, "VEC3"));
        attributes["NORMAL"] = json!(self.add_floats(&normals(mesh), "VEC3"));
        let corners = mesh.triangles.as_flattened();
        let bytes: Vec<u8> = corners.iter().flat_map(|&corner| (corner as u16).to_le_bytes()).collect();
        let indices = self.add(&bytes, UNSIGNED_SHORT, "SCALAR", corners.len());
        json!({ "name": name, "primitives": [{ "attributes": attributes, "indices": indices }] })
    }

    /// The file, with what `root` says beside the buffer.
    pub(crate) fn into_file(self, mut root: Value) -> Vec<u8> {
        root["accessors"] = Value::Array(self.accessors);
        root["bufferViews"] = Value::Array(self.views);
        root["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        // The container computes its own length.
        let header = Header { magic: *b"glTF", version: 2, length: 0 };
        let json = Cow::Owned(root.to_string().into_bytes());
        let file = Glb { header, json, bin: Some(Cow::Owned(self.bytes)) };
        file.to_vec().expect("a file of less than 4 gigabytes can be written into memory")
    }
}

/// The area-weighted normals of a mesh.
fn normals(mesh: &Mesh) -> Vec<[f32; 3]> {
    let mut normals = vec![Vec3::ZERO; mesh.positions.len()];
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|corner| Vec3::from(mesh.positions[corner as usize]));
        let area = (b - a).cross(c - a);
        for &corner in corners {
            normals[corner as usize] += area;
        }
    }
    normals.into_iter().map(|normal| normal.normalize_or(Vec3::Y).to_array()).collect()
}

/// An animation at the times of an accessor: of each accessor of values, the node and the property that it moves.
pub(crate) fn animation(name: &str, times: usize, outputs: &[(usize, usize, &str)]) -> Value {
    let samplers: Vec<Value> =
        outputs.iter().map(|&(output, ..)| json!({ "input": times, "output": output })).collect();
    let channels: Vec<Value> = outputs
        .iter()
        .enumerate()
        .map(|(sampler, &(_, node, path))| json!({ "sampler": sampler, "target": { "node": node, "path": path } }))
        .collect();
    json!({ "name": name, "channels": channels, "samplers": samplers })
}
