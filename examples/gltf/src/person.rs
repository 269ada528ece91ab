//! Writes a person in a cape as a binary glTF file.

use circumsphere_support::scenes::{PERSON_JOINTS, PERSON_PERIOD, person, person_walk};
use glam::{Mat4, Vec3};
use serde_json::{Value, json};

use crate::buffer::{Buffer, UNSIGNED_BYTE, animation};

/// Key frames of the walk, with straight lines in between.
const KEYS: usize = 32;

/// The joint that the cape hangs from.
const SPINE: usize = 1;

/// The node of the hips. The other joints follow it.
const HIPS: usize = 1;

/// A person with the meshes `Body` and `Cape`, both skinned, and the animations `Stand` and `Walk`, on the spot. The same bytes
/// on every platform.
#[must_use]
pub fn person_file() -> Vec<u8> {
    let person = person();
    let mut buffer = Buffer::default();
    let (joints, weights): (Vec<[u8; 4]>, Vec<[f32; 4]>) = person.influences.iter().copied().unzip();
    let attributes = json!({
        "JOINTS_0": buffer.add(joints.as_flattened(), UNSIGNED_BYTE, "VEC4", joints.len()),
        "WEIGHTS_0": buffer.add_floats(&weights, "VEC4"),
        "COLOR_0": buffer.add_floats(&person.colors, "VEC4"),
    });
    let mut body = buffer.add_mesh("Body", &person.skin, attributes);
    let count = person.cape.positions.len();
    let joints = vec![[SPINE as u8, 0, 0, 0]; count];
    let attributes = json!({
        "JOINTS_0": buffer.add(joints.as_flattened(), UNSIGNED_BYTE, "VEC4", count),
        "WEIGHTS_0": buffer.add_floats(&vec![[1.0, 0.0, 0.0, 0.0]; count], "VEC4"),
    });
    let mut cape = buffer.add_mesh("Cape", &person.cape, attributes);
    body["primitives"][0]["material"] = json!(0);
    cape["primitives"][0]["material"] = json!(1);

    let places = PERSON_JOINTS.map(|joint| joint.place);
    let bind_poses = places.map(|place| Mat4::from_translation(-Vec3::from(place.map(|at| at as f32))).to_cols_array());
    let bind_poses = buffer.add_floats(&bind_poses, "MAT4");
    let joint_nodes = PERSON_JOINTS.iter().enumerate().map(|(number, joint)| {
        let children: Vec<usize> =
            (0..PERSON_JOINTS.len()).filter(|&child| PERSON_JOINTS[child].parent == Some(number)).collect();
        let origin = joint.parent.map_or([0.0; 3], |parent| places[parent]);
        let offset: [f64; 3] = std::array::from_fn(|axis| joint.place[axis] - origin[axis]);
        let mut node = json!({ "name": joint.name, "translation": offset.map(|at| at as f32) });
        if !children.is_empty() {
            node["children"] = children.iter().map(|child| HIPS + child).collect();
        }
        node
    });
    let after = HIPS + PERSON_JOINTS.len();
    let mut nodes = vec![json!({ "name": "Person", "children": [HIPS, after, after + 1] })];
    nodes.extend(joint_nodes);
    nodes.push(json!({ "name": "Body", "mesh": 0, "skin": 0 }));
    nodes.push(json!({ "name": "Cape", "mesh": 1, "skin": 0 }));

    let walk: Vec<f64> = (0..=KEYS).map(|key| key as f64 / KEYS as f64).collect();
    let animations = [add_animation(&mut buffer, "Stand", None), add_animation(&mut buffer, "Walk", Some(&walk))];
    let joints: Vec<usize> = (HIPS..after).collect();
    buffer.into_file(json!({
        "asset": { "version": "2.0", "generator": "bevy_circumsphere" },
        "scene": 0,
        "scenes": [{ "name": "Person", "nodes": [0] }],
        "nodes": nodes,
        "meshes": [body, cape],
        "materials": [material([1.0, 1.0, 1.0], false), material([0.42, 0.02, 0.025], true)],
        "skins": [{ "joints": joints, "inverseBindMatrices": bind_poses }],
        "animations": animations,
    }))
}

/// A rough material of a color in linear red, green, and blue.
fn material(color: [f64; 3], double_sided: bool) -> Value {
    let [red, green, blue] = color;
    json!({
        "pbrMetallicRoughness": {
            "baseColorFactor": [red, green, blue, 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": 0.75,
        },
        "doubleSided": double_sided,
    })
}

/// An animation of all joints through shares of the walk, or of one second of standing.
fn add_animation(buffer: &mut Buffer, name: &str, walk: Option<&[f64]>) -> Value {
    let (times, poses): (Vec<[f32; 1]>, Vec<_>) = match walk {
        Some(shares) => {
            shares.iter().map(|&share| ([(share * PERSON_PERIOD) as f32], Some(person_walk(share)))).unzip()
        }
        None => (vec![[0.0], [1.0]], vec![None, None]),
    };
    let input = buffer.add_floats(&times, "SCALAR");
    let hips: Vec<[f32; 3]> = poses
        .iter()
        .map(|pose| pose.as_ref().map_or(PERSON_JOINTS[0].place, |pose| pose.hips).map(|at| at as f32))
        .collect();
    let mut outputs = vec![(buffer.add_floats(&hips, "VEC3"), HIPS, "translation")];
    for joint in 0..PERSON_JOINTS.len() {
        let rotations: Vec<[f32; 4]> = poses
            .iter()
            .map(|pose| {
                pose.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |pose| pose.rotations[joint].map(|part| part as f32))
            })
            .collect();
        outputs.push((buffer.add_floats(&rotations, "VEC4"), HIPS + joint, "rotation"));
    }
    animation(name, input, &outputs)
}
