//! Procedural meshes, with the same bits on every run and every machine, and without files.
//!
//! Angles go through `libm`, because the sine of the standard library differs between platforms. In a simulation of
//! colliding cloth, a difference in the last bit leads to a different recording.

mod beam_on_mattress;
mod bodies;
mod character;
mod cloth;
mod cloth_fall;
mod corrupted;
mod crumpled_sheet;
mod figure;
mod instrument;
mod level;
mod moving;
mod panel;
mod person;
mod pile;
mod points;
mod revolution;
mod shapes;
mod tray;

pub use beam_on_mattress::beam_on_mattress;
pub use bodies::{cad_box, capsule, closed_target, lobed_ball, needle, organ, rounded_cuboid};
pub use character::{
    CHARACTER_CIRCLE, CHARACTER_EASE, CHARACTER_LEG, CHARACTER_SKIRT_LENGTH, CHARACTER_SPEEDS, CHARACTER_TIP_SPEED,
    CHARACTER_TORSO, CHARACTER_WAIST_GAP, Character, CharacterFineness, character_skirt, character_waist_vertices,
};
pub use cloth::{cloth, cloth_corners, cloth_layers};
pub use cloth_fall::{
    BALL_CENTER, BALL_RADIUS, BALL_TRIANGLES, BALL_VERTICES, CLOTH_EDGE, CLOTH_FALL_BODIES, CLOTH_SIDE_VERTICES,
    CLOTH_TRIANGLES, CLOTH_VERTICES, FRAMES, FRAMES_PER_SECOND, TORUS_TRIANGLES, TORUS_VERTICES, cloth_fall,
    cloth_fall_start,
};
pub use corrupted::{duplicate_vertices, ragged_slivers, triangle_soup};
pub use crumpled_sheet::crumpled_sheet;
pub use figure::{
    FIGURE_EASE, FIGURE_HEIGHT, FIGURE_LIMBS, FIGURE_STEP, SKIRT_HEM, SKIRT_WAIST, pelvis_offset, skirt,
    skirt_waist_vertices, walking_figure,
};
pub use instrument::{
    INSTRUMENT_CLEARANCE, INSTRUMENT_DEPTH, INSTRUMENT_END, INSTRUMENT_HALF_LENGTH, INSTRUMENT_RADIUS,
    INSTRUMENT_SLIDE_END, INSTRUMENT_SLIDE_START, instrument, instrument_pose,
};
pub use level::{
    LEVEL_CELLS, LEVEL_HALF_WIDTH, level_ball, level_ferry, level_ground, level_height, level_heights, level_lift,
};
pub use moving::{Fineness, MOVING_SCENES, MovingBody, MovingScene, growing_sheets, moving_scene};
pub use panel::{Panel, panel};
pub use person::{PERSON_JOINTS, PERSON_PERIOD, PERSON_SPEED, Person, PersonJoint, PersonPose, person, person_walk};
pub use pile::{PILE_BODIES, PILE_BODY_REACH, PILE_TRAY_SIZE, pile_body, pile_start, pile_tray, soft_shapes};
pub use shapes::{Diagonals, cuboid, cylinder_side, grid, icosphere, saddle, sheet_stack, torus, twisted_rod};
pub use tray::{RIB_HEIGHT, RIB_TOP, RIB_WIDTH, TRAY_THICKNESS, ribbed_tray};

/// A triangle mesh. Triangles are counter-clockwise as seen from outside, or from the side that the shape's
/// documentation names.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<[f32; 3]>,
    /// Three vertex indices per triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Translates the mesh by `offset`.
    #[must_use]
    pub fn translate(self, offset: [f32; 3]) -> Self {
        self.map(|position| std::array::from_fn(|axis| position[axis] + offset[axis]))
    }

    /// Rotates the mesh about the line through the origin along `axis`, by `angle` radians, counter-clockwise as seen
    /// against the axis.
    ///
    /// `axis` may have any length except zero.
    #[must_use]
    pub fn rotate(self, axis: [f32; 3], angle: f32) -> Self {
        let length = axis.iter().map(|coordinate| coordinate * coordinate).sum::<f32>().sqrt();
        let [x, y, z] = axis.map(|coordinate| coordinate / length);
        let sine = libm::sinf(angle);
        let cosine = libm::cosf(angle);
        let rest = 1.0 - cosine;
        let rows = [
            [x * x * rest + cosine, x * y * rest - z * sine, x * z * rest + y * sine],
            [y * x * rest + z * sine, y * y * rest + cosine, y * z * rest - x * sine],
            [z * x * rest - y * sine, z * y * rest + x * sine, z * z * rest + cosine],
        ];
        self.map(|position| rows.map(|row| row[0] * position[0] + row[1] * position[1] + row[2] * position[2]))
    }

    /// Scales the mesh about the origin by a positive `factor`.
    #[must_use]
    pub fn scale(self, factor: f32) -> Self {
        self.map(|position| position.map(|coordinate| coordinate * factor))
    }

    fn map(mut self, change: impl Fn([f32; 3]) -> [f32; 3]) -> Self {
        for position in &mut self.positions {
            *position = change(*position);
        }
        self
    }

    /// Appends the two triangles of the quadrilateral `a b c d`, split from `a` to `c`.
    fn push_quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangles.push([a, b, c]);
        self.triangles.push([a, c, d]);
    }
}

/// Merges `meshes` into one, with their vertices and triangles in order.
///
/// # Panics
///
/// If the total number of vertices does not fit into a `u32`.
pub fn merge(meshes: &[Mesh]) -> Mesh {
    let mut merged = Mesh::default();
    for mesh in meshes {
        let start = index(merged.positions.len());
        merged.positions.extend_from_slice(&mesh.positions);
        merged.triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|corner| corner + start)));
    }
    index(merged.positions.len());
    merged
}

/// A vertex index as the `u32` that triangles store.
fn index(vertex: usize) -> u32 {
    u32::try_from(vertex).expect("a mesh has fewer than 2^32 vertices")
}
