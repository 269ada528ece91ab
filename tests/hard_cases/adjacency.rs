//! Adjacency of triangles: shared vertices and edges, T-junctions, pages of a book, rims, and inconsistent winding.

use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, cylinder_side, grid, icosphere};
use glam::Vec3;

use crate::harness::{Body, Case, Stated, Tally, at, turned};

const THIN: f32 = 0.02;

/// Two triangles that share an edge, folded until their free corners are `gap` apart.
fn hinge(gap: f32) -> Mesh {
    Mesh {
        positions: vec![[0.0, 0.0, -0.5], [0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [1.0, gap, 0.0]],
        triangles: vec![[0, 1, 2], [1, 0, 3]],
    }
}

/// Two triangles that share a vertex and otherwise lie on each other.
fn fan() -> Mesh {
    Mesh {
        positions: vec![[0.0; 3], [1.0, 0.0, -0.5], [1.0, 0.0, 0.5], [1.0, 0.01, -0.4], [1.0, 0.01, 0.6]],
        triangles: vec![[0, 1, 2], [0, 3, 4]],
    }
}

#[test]
fn triangles_of_a_surface_that_share_a_vertex_or_an_edge_are_no_pair() {
    let nothing =
        Stated { touching: 0, false_by_balls: 0, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 0 };
    for mesh in [hinge(0.0), hinge(1.0e-3), hinge(0.1), fan()] {
        Case::new([Body::new(&mesh, THIN).meeting_itself()]).judge("folded").assert_as(nothing);
    }
}

/// Folds lie face to face, so the cones reject nothing. False pairs have caps that bulge beyond the rims.
const FOLDED: Stated =
    Stated { touching: 778, false_by_balls: 78, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 78 };

/// A sheet folded back and forth. Adjacent folds share vertices, folds two apart do not.
#[test]
fn the_folds_of_a_sheet_touch_beyond_what_they_share() {
    let mut sheet = grid(12, 4, 6.0, 1.0, Diagonals::Alternating);
    for (vertex, position) in sheet.positions.iter_mut().enumerate() {
        let column = vertex % 13;
        position[0] = if column % 2 == 0 { 0.0 } else { 0.5 };
        position[1] = 0.015 * column as f32;
    }
    Case::new([Body::new(&sheet, THIN).meeting_itself()]).judge("folds").assert_as(FOLDED);
}

/// The halves meet rim to rim, side by side, so the line between two sphere centers runs along both surfaces. Cones as
/// narrow as in the source paper miss all 332 pairs. Cones widened at rims miss none.
const HALVES: Stated =
    Stated { touching: 332, false_by_balls: 0, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 0 };

#[test]
fn two_surfaces_that_share_positions_touch_there() {
    let ball = icosphere(2, 0.5);
    let height = |corners: &[u32; 3]| corners.iter().map(|&corner| ball.positions[corner as usize][1]).sum::<f32>();
    let (upper, lower): (Vec<[u32; 3]>, Vec<[u32; 3]>) =
        ball.triangles.iter().partition(|corners| height(corners) > 0.01);
    let halves = [upper, lower].map(|triangles| Mesh { positions: ball.positions.clone(), triangles });
    // Only points of contact: with a thickness of 0, only pairs at distance 0 remain.
    let mut tally = Tally::default();
    for thickness in [0.0, THIN] {
        tally += Case::new(halves.each_ref().map(|half| Body::new(half, thickness))).judge("halves");
    }
    tally.assert_as(HALVES);
}

/// The junction is in one plane. Its pairs are side by side and are found by cones widened at rims.
const T_JUNCTION: Stated =
    Stated { touching: 50, false_by_balls: 20, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 7 };

/// A large triangle whose edge is split into eight on the other side, where the triangle has no vertices.
#[test]
fn a_t_junction_is_a_contact_of_the_edge_with_the_vertices_on_it() {
    let mut mesh =
        Mesh { positions: vec![[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.5]], triangles: vec![[0, 1, 2]] };
    mesh.positions.extend((1..8).map(|part| [part as f32 / 4.0 - 1.0, 0.0, 0.0]));
    mesh.positions.extend((0..8).map(|part| [part as f32 / 4.0 - 0.875, 0.0, -0.3]));
    let on_edge = |part: u32| match part {
        0 => 0,
        8 => 1,
        _ => part + 2,
    };
    mesh.triangles.extend((0..8).map(|part| [on_edge(part + 1), on_edge(part), 10 + part]));
    let ball = Body::new(&icosphere(2, 0.3), THIN).at(at(0.13, 0.32, 0.01));
    let mut tally = Tally::default();
    for thickness in [0.0, THIN] {
        let surface = Body::new(&mesh, thickness).meeting_itself();
        tally += Case::new([surface, ball.clone()]).judge("T-junction");
    }
    tally.assert_as(T_JUNCTION);
}

/// Pages that share one spine, `cells` long along z, fanned out around it.
fn book(pages: u32, cells: u32) -> Mesh {
    let mut mesh = Mesh::default();
    mesh.positions.extend((0..=cells).map(|row| [0.0, 0.0, row as f32 / cells as f32 - 0.5]));
    for page in 0..pages {
        let direction = turned(Vec3::Z, 0.3 + 0.25 * f64::from(page)) * Vec3::X;
        let start = mesh.positions.len() as u32;
        mesh.positions
            .extend((0..=cells).map(|row| (direction * 0.6 + Vec3::Z * (row as f32 / cells as f32 - 0.5)).to_array()));
        for row in 0..cells {
            mesh.triangles.push([row, row + 1, start + row]);
            mesh.triangles.push([start + row, row + 1, start + row + 1]);
        }
    }
    mesh
}

/// Near the spine, pages cross the cones of others at an angle, and caps on both sides bulge through the next page.
const BOOK: Stated =
    Stated { touching: 1033, false_by_balls: 2968, missed_by_caps: 347, bodies_missed_by_caps: 0, false_by_caps: 355 };

#[test]
fn the_pages_at_a_non_manifold_edge_touch_like_any_others() {
    let ball = |x: f32, y: f32| Body::new(&icosphere(2, 0.1), THIN).at(at(x, y, 0.03));
    let bodies = [Body::new(&book(5, 6), THIN).meeting_itself(), ball(-0.11, 0.0), ball(0.3, 0.28)];
    Case::new(bodies).judge("book").assert_as(BOOK);
}

/// A rim meets a face edge on: the normals of its triangles are perpendicular to the direction of the face. Cones are
/// widened there.
const RIMS: Stated =
    Stated { touching: 140, false_by_balls: 262, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 89 };

#[test]
fn an_open_boundary_touches_by_its_rim() {
    let tube = cylinder_side(0.3, 0.8, 16, 4);
    let sheet = grid(6, 6, 2.0, 2.0, Diagonals::Uniform);
    let mut tally = Tally::default();
    // Standing on its rim, leaning on it, and beside the sheet's own rim.
    for (place, turn) in
        [(at(0.1, 0.43, 0.2), 0.0), (at(0.0, 0.47, 0.1), 0.2), (at(1.32, 0.0, 0.1), 0.0), (at(1.2, 0.3, 0.1), 1.3)]
    {
        let tube = Body::new(&tube, THIN).at(place.with_rotation(turned(Vec3::new(1.0, 0.0, 0.2), turn)));
        let block = Body::new(&cuboid([0.2; 3], 2), THIN).at(at(-1.23, 0.05, 0.1));
        tally += Case::new([Body::new(&sheet, THIN), tube, block]).judge("rims");
    }
    tally.assert_as(RIMS);
}

/// A flipped triangle of a closed body has its cap inside the body. Its other triangles still find part of the pairs.
/// False pairs have caps that bulge beyond their triangles.
const FLIPPED: Stated =
    Stated { touching: 216, false_by_balls: 228, missed_by_caps: 108, bodies_missed_by_caps: 0, false_by_caps: 26 };

#[test]
fn the_winding_decides_nothing_about_what_touches() {
    let sheet = grid(6, 6, 2.0, 2.0, Diagonals::Uniform);
    let ball = icosphere(2, 0.5);
    let judge = |flips: &dyn Fn(usize) -> bool| {
        let flipped = |mesh: &Mesh| {
            let mut mesh = mesh.clone();
            let flipped = mesh.triangles.iter_mut().enumerate().filter(|(number, _)| flips(*number));
            flipped.for_each(|(_, corners)| corners.swap(1, 2));
            mesh
        };
        let bodies = [Body::new(&flipped(&sheet), THIN), Body::new(&flipped(&ball), THIN).at(at(0.1, 0.51, 0.2))];
        Case::new(bodies).judge("flipped")
    };
    let upright = judge(&|_| false);
    let mut tally = Tally::default();
    for flips in [&(|_| true) as &dyn Fn(usize) -> bool, &|number| number % 3 == 0, &|number| number % 2 == 0] {
        let flipped = judge(flips);
        assert_eq!(flipped.refined.touching, upright.refined.touching);
        assert_eq!(flipped.balls, upright.balls, "balls have no sides");
        tally += flipped;
    }
    tally.assert_as(FLIPPED);
}
