//! The judge of cloths at the end of a scene must find what is wrong, and nothing else. The expected counts are closed
//! forms of placements that are known to be right or wrong.

use circumsphere_examples::scenes::{Extent, cloth_drop::BALL_RADIUS};
use circumsphere_reports::{cloth_scenes::ClothScene, cloth_truth::Crossings};

/// Least distance of a face of the ball's mesh from the center, as a share of the radius. Edges of an icosahedron that is
/// split twice are seen from the center under at most 18.7°, and its faces are the closer the longer their edges.
const FACE_DISTANCE: f32 = 0.98;

fn scenes() -> [ClothScene; 3] {
    [ClothScene::on_ball, ClothScene::on_ball_mesh, ClothScene::on_hills].map(|scene| scene(Extent::Small))
}

/// The cloth of a scene at another height.
fn lifted(scene: &ClothScene, by: f32) -> Vec<[f32; 3]> {
    scene.cloth.clone().translate([0.0, by, 0.0]).positions
}

fn closer_than(positions: &[[f32; 3]], radius: f32) -> usize {
    positions.iter().filter(|[x, y, z]| x * x + y * y + z * z < radius * radius).count()
}

#[test]
fn a_cloth_above_its_obstacle_crosses_nothing() {
    for scene in scenes() {
        let crossings = Crossings::of(&scene, &scene.cloth.positions);
        assert!(crossings.is_none(), "{}: {crossings:?}", scene.name);
    }
}

#[test]
fn vertices_and_triangles_inside_a_ball_are_counted() {
    let [ball, mesh, _] = scenes();
    // The cloth cuts the ball slightly above its center.
    let positions = lifted(&ball, 0.05 - BALL_RADIUS);
    let [surely, at_most] = [FACE_DISTANCE, 1.0].map(|share| closer_than(&positions, share * BALL_RADIUS));
    assert!(surely > 10, "the cloth is not inside: {surely}");
    let crossings = Crossings::of(&ball, &positions);
    assert_eq!((crossings.vertices_inside, crossings.with_itself), (at_most, 0), "{crossings:?}");
    // Each vertex inside is a corner of a triangle, and a triangle has three.
    assert!(3 * crossings.with_obstacle > at_most, "{crossings:?}");
    let crossings = Crossings::of(&mesh, &positions);
    assert!((surely..=at_most).contains(&crossings.vertices_inside), "{crossings:?}, {surely} to {at_most}");
    assert!(crossings.with_obstacle > 0 && crossings.with_itself == 0, "{crossings:?}");
}

#[test]
fn vertices_below_ground_are_counted() {
    let [_, _, hills] = scenes();
    // Below the deepest valley, everything is below and nothing crosses.
    let positions = lifted(&hills, -0.5);
    let expected = Crossings { vertices_inside: positions.len(), ..Crossings::default() };
    assert_eq!(Crossings::of(&hills, &positions), expected);
    // At mean height, the cloth passes through slopes.
    let crossings = Crossings::of(&hills, &lifted(&hills, -0.1));
    assert!(crossings.with_obstacle > 0 && crossings.with_itself == 0, "{crossings:?}");
    assert!((1..positions.len()).contains(&crossings.vertices_inside), "{crossings:?}");
}

#[test]
fn a_corner_pulled_across_its_cloth_crosses_it() {
    for scene in scenes() {
        let mut positions = scene.cloth.positions.clone();
        positions[0] = positions[positions.len() / 2];
        let crossings = Crossings::of(&scene, &positions);
        assert!(crossings.with_itself > 0, "{}: {crossings:?}", scene.name);
        assert_eq!(Crossings { with_itself: 0, ..crossings }, Crossings::default(), "{}", scene.name);
    }
}

#[test]
fn vertices_that_are_not_finite_count_as_inside() {
    for scene in scenes() {
        let mut positions = scene.cloth.positions.clone();
        positions[3] = [f32::NAN; 3];
        let expected = Crossings { vertices_inside: 1, ..Crossings::default() };
        assert_eq!(Crossings::of(&scene, &positions), expected, "{}", scene.name);
    }
}
