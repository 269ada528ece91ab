//! The patches of smooth surfaces in the recording lie on the body that the surface stands for.

use bevy_circumsphere::{
    debug::{LevelOfDetail, RerunSettings},
    prelude::*,
};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::icosphere;
use glam::Vec3;

use crate::world::{Recorded, THIN, everything, near_contacts, nothing, sheet, spawn};

const RADIUS: f32 = 0.5;

/// A coarse smooth ball that rests on a flat sheet, both recorded.
fn ball_on_sheet(settings: RerunSettings) -> (Recorded, bevy_ecs::entity::Entity) {
    let mut recorded = Recorded::new(settings);
    let pose = Transform::from_xyz(0.1, RADIUS, 0.2);
    let ball = spawn(&mut recorded.app, "ball", &icosphere(2, RADIUS), (THIN, SurfaceShape::Smooth, pose));
    spawn(&mut recorded.app, "sheet", &sheet(4), THIN);
    recorded.tick();
    (recorded, ball)
}

#[test]
fn patches_cover_the_ball() {
    let (recorded, _) = ball_on_sheet(RerunSettings { patches: LevelOfDetail::All, ..nothing() });
    assert_eq!(recorded.viewer.below(&["patches"]).len(), 1, "the sheet is flat");
    let shown = recorded.viewer.of(&["patches", "ball"]).expect("the ball is smooth");
    let points: Vec<Vec3> = shown.vectors::<3>("Mesh3D:vertex_positions").into_iter().map(Vec3::from).collect();
    let normals: Vec<Vec3> = shown.vectors::<3>("Mesh3D:vertex_normals").into_iter().map(Vec3::from).collect();
    let triangles = shown.triples("Mesh3D:triangle_indices");
    // The flat triangles are up to 0.02 inside.
    for (point, normal) in points.iter().zip(&normals) {
        assert!((point.length() - RADIUS).abs() < 1.0e-3, "{point}");
        assert!(normal.dot(point.normalize()) > 0.999, "{point} {normal}");
    }
    let areas = triangles.iter().map(|corners| {
        let [a, b, c] = corners.map(|corner| points[corner as usize]);
        let area = (b - a).cross(c - a) / 2.0;
        assert!(area.dot(a + b + c) > 0.0, "a triangle is turned over");
        area.length()
    });
    let (area, sphere) = (areas.sum::<f32>(), 4.0 * std::f32::consts::PI * RADIUS * RADIUS);
    assert!((area / sphere - 1.0).abs() < 0.01, "the patches cover {area} of {sphere}");
    // Each outline is that of the flat triangle.
    let outlines = shown.strips();
    assert_eq!(outlines.len(), icosphere(2, RADIUS).triangles.len());
    assert!(outlines.iter().all(|outline| outline.len() == 4 && outline[0] == outline[3]));
}

#[test]
fn near_contacts_only_patches_near_contacts_are_drawn() {
    let settings = RerunSettings { patches: LevelOfDetail::NearContacts, ..nothing() };
    let (mut recorded, ball) = ball_on_sheet(settings);
    let near: Vec<u32> = near_contacts(&mut recorded.app, ball).into_iter().collect();
    let shown = recorded.viewer.of(&["patches", "ball"]).expect("the ball touches the sheet");
    assert_eq!(shown.wholes("triangle"), near);
    assert!(!near.is_empty() && near.len() < 160);
}

#[test]
fn patches_leave_with_the_shape() {
    let (mut recorded, ball) = ball_on_sheet(everything());
    assert!(recorded.viewer.of(&["patches", "ball"]).is_some());
    recorded.app.world_mut().entity_mut(ball).insert(SurfaceShape::Flat);
    recorded.tick();
    assert!(recorded.viewer.of(&["patches", "ball"]).is_none());
}
