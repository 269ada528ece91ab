//! What a game may write, and what it is told.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, grid};

use super::world::{Body, app, store};

fn two_sheets(app: &mut App, gap: f32) -> [Entity; 2] {
    [0.0, gap].map(|y| {
        let mesh: Mesh = grid(4, 4, 1.0, 1.0, Diagonals::Uniform);
        let thickness = vec![0.05; mesh.positions.len()];
        Body { mesh, thickness, transform: Transform::from_xyz(0.0, y, 0.0) }.spawn(app, ())
    })
}

fn status(app: &App, entity: Entity) -> SurfaceStatus {
    app.world().get::<SurfaceStatus>(entity).expect("a surface").clone()
}

#[test]
fn a_thickness_that_cannot_be_used_quarantines_its_surface_until_it_is_mended() {
    let mut app = app();
    let [sheet, other] = two_sheets(&mut app, 0.08);
    app.update();
    assert!(store(&app).touching_count() > 0);
    let count = 25;
    let with = |vertex: usize, value: f32| {
        let mut values = vec![0.05; count];
        values[vertex] = value;
        VertexThickness::new(values)
    };
    let of_vertex =
        |vertex: u32, thickness: f32| QuarantineReason::VertexThickness { vertex: VertexId(vertex), thickness };
    let wrong = [
        (VertexThickness::new([0.1; 3]), QuarantineReason::VertexThicknessCount { expected: count, found: 3 }),
        (VertexThickness::new([]), QuarantineReason::VertexThicknessCount { expected: count, found: 0 }),
        (with(7, -0.01), of_vertex(7, -0.01)),
        (with(3, f32::INFINITY), of_vertex(3, f32::INFINITY)),
    ];
    for (thickness, reason) in wrong {
        app.world_mut().entity_mut(sheet).insert(thickness);
        app.update();
        assert_eq!(status(&app, sheet), SurfaceStatus::Quarantined(reason));
        assert_eq!(status(&app, other), SurfaceStatus::Active);
        assert_eq!(store(&app).touching_count(), 0);
        app.world_mut().entity_mut(sheet).insert(with(0, 0.05));
        app.update();
        assert_eq!(status(&app, sheet), SurfaceStatus::Active);
        assert!(store(&app).touching_count() > 0);
    }
    app.world_mut().entity_mut(sheet).insert(with(9, f32::NAN));
    app.update();
    let SurfaceStatus::Quarantined(reason) = status(&app, sheet) else { panic!("NaN is no thickness") };
    assert_eq!(reason.to_string(), "the thickness NaN of vertex 9 is negative or not finite");
}

#[test]
fn a_changed_thickness_counts_at_once_also_if_nothing_moves() {
    let mut app = app();
    let [sheet, _] = two_sheets(&mut app, 0.12);
    app.update();
    assert_eq!(store(&app).touching_count(), 0);
    // Thick in one corner.
    let mut values = vec![0.05; 25];
    values[0] = 0.1;
    app.world_mut().entity_mut(sheet).insert(VertexThickness::new(values.clone()));
    app.update();
    let some = store(&app).touching_count();
    assert!(some > 0);
    // Thick everywhere but there. The largest is the same.
    let values: Vec<f32> = values.iter().map(|value| 0.15 - value).collect();
    app.world_mut().entity_mut(sheet).insert(VertexThickness::new(values));
    app.update();
    assert!(store(&app).touching_count() > some);
    app.world_mut().entity_mut(sheet).remove::<VertexThickness>().insert(SurfaceThickness::World(0.05));
    app.update();
    assert_eq!(store(&app).touching_count(), 0);
}

#[test]
fn thickness_scales_with_its_surface() {
    let mut app = app();
    let [sheet, other] = two_sheets(&mut app, 0.18);
    app.update();
    assert_eq!(store(&app).touching_count(), 0);
    let mut values = vec![0.05; 25];
    values[12] = 0.06;
    for entity in [sheet, other] {
        let mut entity = app.world_mut().entity_mut(entity);
        entity.insert(VertexThickness::new(values.clone()));
        entity.get_mut::<Transform>().expect("it has a transform").scale *= 2.0;
    }
    app.update();
    // 0.2 and more, of which 0.18 is between them.
    assert!(store(&app).touching_count() > 0);
}
