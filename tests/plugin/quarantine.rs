//! Bad input at run time: the affected body is quarantined with a reason, and the others behave as if it were absent.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    geometry::{PoseError, ShapeError},
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use glam::Vec3;
use parry3d::{
    bounding_volume::{Aabb, BoundingSphere},
    mass_properties::MassProperties,
    query::{PointProjection, PointQuery, Ray, RayCast, RayIntersection},
    shape::{Ball, FeatureId, Shape, ShapeType, TypedShape},
};

use crate::world::{
    Announcement::{self, Quarantined},
    By, Called, THIN, all, announced, app, at, ball, between, fingerprint, fixed_app, insert, keep_journal, messages,
    of, points, sheet, spawn, status, store, surface, write_positions,
};

/// A sheet and a ball in contact. Their contacts are compared with those of a world without the victim.
fn healthy(app: &mut App) {
    spawn(app, &sheet(), (THIN, Called("sheet"), ContactEventsEnabled));
    spawn(app, &ball(), (THIN, Called("ball"), at(0.1, 0.53, 0.2), ContactEventsEnabled));
}

/// A place where the victim touches the sheet, away from the ball but near it.
fn victims_place() -> Transform {
    at(-0.9, 0.53, 0.2)
}

struct Fault {
    name: &'static str,
    inflict: fn(&mut App, Entity),
    reason: fn(&QuarantineReason) -> bool,
}

fn with_positions(app: &mut App, entity: Entity, change: impl Fn(&mut Vec<Vec3>)) {
    change(&mut app.world_mut().get_mut::<SurfacePositions>(entity).expect("the entity is a surface").0);
}

fn with_transform(app: &mut App, entity: Entity, change: impl Fn(&mut Transform)) {
    change(&mut app.world_mut().get_mut::<Transform>(entity).expect("the entity has a transform"));
}

fn surface_faults() -> Vec<Fault> {
    use QuarantineReason::{MissingTransform, NonFinitePosition, Pose, PositionCount, Thickness};
    let fault = |name, inflict, reason| Fault { name, inflict, reason };
    vec![
        fault(
            "NaN",
            |app, entity| with_positions(app, entity, |positions| positions[7].y = f32::NAN),
            |reason| *reason == NonFinitePosition(VertexId(7)),
        ),
        fault(
            "NaN everywhere",
            |app, entity| with_positions(app, entity, |positions| positions.fill(Vec3::NAN)),
            |reason| *reason == NonFinitePosition(VertexId(0)),
        ),
        fault(
            "infinity at the last vertex",
            |app, entity| with_positions(app, entity, |positions| positions[161].x = f32::NEG_INFINITY),
            |reason| *reason == NonFinitePosition(VertexId(161)),
        ),
        fault(
            "one position too few",
            |app, entity| with_positions(app, entity, |positions| positions.truncate(161)),
            |reason| *reason == PositionCount { expected: 162, found: 161 },
        ),
        fault(
            "one position too many",
            |app, entity| with_positions(app, entity, |positions| positions.push(Vec3::ZERO)),
            |reason| *reason == PositionCount { expected: 162, found: 163 },
        ),
        fault(
            "non-uniform scale",
            |app, entity| with_transform(app, entity, |transform| transform.scale = Vec3::new(1.0, 2.0, 1.0)),
            |reason| *reason == Pose(PoseError::NonUniformScale),
        ),
        fault(
            "flat",
            |app, entity| with_transform(app, entity, |transform| transform.scale.y = 0.0),
            |reason| *reason == Pose(PoseError::NonUniformScale),
        ),
        fault(
            "no scale",
            |app, entity| with_transform(app, entity, |transform| transform.scale = Vec3::ZERO),
            |reason| *reason == Pose(PoseError::ZeroScale),
        ),
        fault(
            "NaN translation",
            |app, entity| with_transform(app, entity, |transform| transform.translation.z = f32::NAN),
            |reason| *reason == Pose(PoseError::NonFinite),
        ),
        fault(
            "NaN rotation",
            |app, entity| {
                with_transform(app, entity, |transform| transform.rotation.x = f32::NAN);
            },
            |reason| *reason == Pose(PoseError::NonFinite),
        ),
        fault(
            "infinite scale",
            |app, entity| with_transform(app, entity, |transform| transform.scale = Vec3::INFINITY),
            |reason| *reason == Pose(PoseError::NonFinite),
        ),
        fault(
            "parent with a non-uniform scale",
            |app, entity| {
                let stretched = Transform::from_scale(Vec3::new(1.0, 1.0, 3.0));
                let parent = app.world_mut().spawn(stretched).id();
                insert(app, entity, ChildOf(parent));
            },
            |reason| *reason == Pose(PoseError::NonUniformScale),
        ),
        fault(
            "negative thickness",
            |app, entity| insert(app, entity, SurfaceThickness::World(-0.01)),
            |reason| *reason == Thickness(-0.01),
        ),
        fault(
            "NaN thickness",
            |app, entity| insert(app, entity, SurfaceThickness::World(f32::NAN)),
            |reason| matches!(reason, Thickness(thickness) if thickness.is_nan()),
        ),
        fault(
            "infinite thickness",
            |app, entity| insert(app, entity, SurfaceThickness::MeanEdges(f32::INFINITY)),
            |reason| *reason == Thickness(f32::INFINITY),
        ),
        fault(
            "no transform",
            |app, entity| {
                app.world_mut().entity_mut(entity).remove::<Transform>();
            },
            |reason| *reason == MissingTransform,
        ),
        fault(
            "parent without a transform",
            |app, entity| {
                let parent = app.world_mut().spawn_empty().id();
                insert(app, entity, ChildOf(parent));
            },
            |reason| *reason == MissingTransform,
        ),
    ]
}

fn repair(app: &mut App, entity: Entity) {
    app.world_mut().entity_mut(entity).remove::<ChildOf>();
    insert(app, entity, (SurfacePositions(points(&ball())), THIN, victims_place()));
}

/// The messages about quarantines since the last call.
fn quarantines(app: &mut App) -> Vec<Announcement> {
    messages(app).into_iter().filter(|message| matches!(message, Quarantined(..))).collect()
}

#[test]
fn a_surface_that_cannot_be_used_is_set_aside_and_taken_back_without_touching_others() {
    let mut alone = app();
    healthy(&mut alone);
    alone.update();
    let without = fingerprint(&alone);
    assert_eq!(without.len(), 1);

    for method in [ContactMethod::Exact, ContactMethod::Circumsphere] {
        for fault in surface_faults() {
            let mut app = app();
            keep_journal(&mut app, Update);
            let victim = spawn(&mut app, &ball(), (THIN, Called("victim"), victims_place(), method, SelfCollision));
            healthy(&mut app);
            app.update();
            let whole = fingerprint(&app);
            assert!(whole.len() >= 2 && !of(&mut app, victim).is_empty(), "the victim touches the sheet");
            announced(&mut app);

            (fault.inflict)(&mut app, victim);
            for tick in 0..3 {
                app.update();
                let SurfaceStatus::Quarantined(reason) = status(&app, victim) else {
                    panic!("{}: {:?}", fault.name, status(&app, victim))
                };
                assert!((fault.reason)(&reason), "{}: {reason:?}", fault.name);
                assert!(!reason.to_string().is_empty());
                // It is announced once, in the tick of the fault, as a message and as an entity event.
                let heard: Vec<By> = announced(&mut app)
                    .into_iter()
                    .filter(|(.., announcement)| {
                        matches!(announcement, Quarantined(entity, why) if *entity == victim && (fault.reason)(why))
                    })
                    .map(|(_, by, _)| by)
                    .collect();
                let expected: &[By] = if tick == 0 { &[By::Observer, By::Message] } else { &[] };
                assert_eq!(heard, expected, "{} in tick {tick}", fault.name);
                assert_eq!(fingerprint(&app), without, "{}: other bodies are affected", fault.name);
                assert_eq!(of(&mut app, victim), [], "{}", fault.name);
            }

            repair(&mut app, victim);
            app.update();
            assert_eq!(status(&app, victim), SurfaceStatus::Active, "{}", fault.name);
            assert_eq!(fingerprint(&app), whole, "{}: the contacts differ after the repair", fault.name);

            // A second fault is announced again.
            (fault.inflict)(&mut app, victim);
            announced(&mut app);
            app.update();
            assert_eq!(quarantines(&mut app).len(), 1, "{}", fault.name);
        }
    }
}

#[test]
fn a_fault_that_moves_on_within_the_surface_is_the_same_quarantine() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let victim = spawn(&mut app, &ball(), THIN);
    for vertex in [3, 4, 5] {
        let mut positions = points(&ball());
        positions[vertex].z = f32::NAN;
        write_positions(&mut app, victim, &positions);
        app.update();
        let reason = QuarantineReason::NonFinitePosition(VertexId(vertex as u32));
        assert_eq!(status(&app, victim), SurfaceStatus::Quarantined(reason), "the status gives the latest reason");
    }
    assert_eq!(messages(&mut app), [Quarantined(victim, QuarantineReason::NonFinitePosition(VertexId(3)))]);
}

#[test]
fn a_surface_without_positions_waits_and_is_no_quarantine() {
    let mut app = app();
    keep_journal(&mut app, Update);
    healthy(&mut app);
    let (waiting, positions) = surface(&ball());
    let waiting = app.world_mut().spawn((waiting, THIN, Called("waiting"), victims_place())).id();
    for _ in 0..2 {
        app.update();
        assert_eq!(status(&app, waiting), SurfaceStatus::Waiting);
        assert_eq!(of(&mut app, waiting), []);
    }
    insert(&mut app, waiting, positions);
    app.update();
    assert_eq!(status(&app, waiting), SurfaceStatus::Active);
    assert!(!of(&mut app, waiting).is_empty());
    write_positions(&mut app, waiting, &[]);
    app.update();
    assert_eq!(status(&app, waiting), SurfaceStatus::Waiting);
    assert_eq!(quarantines(&mut app), []);
}

#[test]
fn a_disabled_surface_is_not_looked_at() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let victim = spawn(&mut app, &ball(), (THIN, SurfaceDisabled));
    with_positions(&mut app, victim, |positions| positions[0] = Vec3::NAN);
    app.update();
    assert_eq!((status(&app, victim), announced(&mut app)), (SurfaceStatus::Disabled, vec![]));
}

#[test]
fn a_world_frame_needs_no_transform() {
    let mut app = app();
    healthy(&mut app);
    let free = spawn(&mut app, &ball().translate([-0.9, 0.53, 0.2]), (THIN, Called("free"), SurfaceFrame::World));
    app.world_mut().entity_mut(free).remove::<Transform>();
    app.update();
    assert_eq!(status(&app, free), SurfaceStatus::Active);
    assert!(!of(&mut app, free).is_empty());
}

#[test]
fn a_shape_that_cannot_be_used_is_set_aside_and_taken_back() {
    let nan = f32::NAN;
    let faults: Vec<(&str, SharedShape)> = vec![
        ("ball", SharedShape::ball(nan)),
        ("infinite ball", SharedShape::ball(f32::INFINITY)),
        ("cuboid", SharedShape::cuboid(nan, 1.0, 1.0)),
        ("capsule", SharedShape::capsule(Vec3::ZERO, Vec3::splat(nan), 0.5)),
        ("half-space", SharedShape::halfspace(Vec3::new(0.0, nan, 0.0))),
        ("cylinder", SharedShape::cylinder(nan, 0.5)),
        ("infinite cylinder", SharedShape::cylinder(f32::INFINITY, 0.5)),
        ("cone", SharedShape::cone(0.5, nan)),
        ("rounded cuboid", SharedShape::round_cuboid(0.5, 0.5, 0.5, nan)),
        ("negative border", SharedShape::round_cylinder(0.5, 0.5, -0.1)),
        ("negative ball", SharedShape::ball(-0.5)),
    ];
    let mut alone = app();
    healthy(&mut alone);
    alone.update();
    let without = fingerprint(&alone);
    for (name, shape) in faults {
        let mut app = app();
        keep_journal(&mut app, Update);
        healthy(&mut app);
        let victim = app.world_mut().spawn((RigidShape(shape), Called("shape"), victims_place())).id();
        for tick in 0..3 {
            app.update();
            let error = if name.starts_with("negative") { ShapeError::Negative } else { ShapeError::NonFinite };
            let reason = QuarantineReason::Shape(error);
            assert_eq!(status(&app, victim), SurfaceStatus::Quarantined(reason.clone()), "{name}");
            let expected = if tick == 0 { vec![Quarantined(victim, reason)] } else { vec![] };
            assert_eq!(quarantines(&mut app), expected, "{name}");
            assert_eq!(fingerprint(&app), without, "{name}");
        }
        insert(&mut app, victim, RigidShape(SharedShape::ball(0.5)));
        app.update();
        assert_eq!(status(&app, victim), SurfaceStatus::Active, "{name}");
        assert!(!of(&mut app, victim).is_empty(), "{name}: the ball pierces the sheet");

        // The pose of a shape follows the same rules.
        with_transform(&mut app, victim, |transform| transform.scale.x = 2.0);
        app.update();
        let uneven = QuarantineReason::Pose(PoseError::NonUniformScale);
        assert_eq!(status(&app, victim), SurfaceStatus::Quarantined(uneven.clone()), "{name}");
        assert_eq!(quarantines(&mut app), [Quarantined(victim, uneven)], "{name}");
        assert_eq!(fingerprint(&app), without, "{name}");
    }
}

#[test]
fn a_shape_without_size_is_a_point_and_has_no_inside() {
    for (name, shape) in [
        ("ball", SharedShape::ball(0.0)),
        ("cuboid", SharedShape::cuboid(0.0, 0.0, 0.0)),
        ("rod", SharedShape::cuboid(0.25, 0.0, 0.0)),
        ("plate", SharedShape::cuboid(0.25, 0.0, 0.25)),
    ] {
        let mut app = app();
        let sheet = spawn(&mut app, &sheet(), THIN);
        let point = app.world_mut().spawn((RigidShape(shape), at(0.1, 0.02, 0.2))).id();
        app.update();
        let contacts = between(&mut app, sheet, point);
        assert!(!contacts.is_empty(), "{name}: 0.02 is within the thickness of 0.05");
        for contact in &contacts {
            // A feature pair is never closer than the two bodies.
            assert!(contact.distance.is_finite() && contact.distance >= 0.019_999, "{name}: {contact:?}");
            assert!(contact.normal.is_finite() && contact.points.1.is_finite(), "{name}: {contact:?}");
        }
    }
}

/// Positions that become invalid only after `Prepare` has checked them.
fn corrupt_late(change: fn(&mut Vec<Vec3>)) -> impl Fn(Query<(&Called, &mut SurfacePositions)>) + Send + Sync {
    move |mut surfaces| {
        for (called, mut positions) in &mut surfaces {
            if called.0 == "victim" {
                change(&mut positions.0);
            }
        }
    }
}

#[test]
fn what_a_prediction_spoils_harms_no_one_else() {
    let mut alone = app();
    healthy(&mut alone);
    alone.update();
    let without = fingerprint(&alone);
    let changes: [fn(&mut Vec<Vec3>); 4] = [
        |positions| positions.truncate(10),
        Vec::clear,
        |positions| positions.fill(Vec3::NAN),
        |positions| positions[5] = Vec3::INFINITY,
    ];
    for change in changes {
        let mut app = app();
        spawn(&mut app, &ball(), (THIN, Called("victim"), victims_place(), SelfCollision));
        healthy(&mut app);
        app.add_systems(Update, corrupt_late(change).in_set(DeformableSystems::Predict));
        for _ in 0..2 {
            app.update();
            assert_eq!(fingerprint(&app), without);
        }
    }
}

#[test]
fn finite_numbers_however_large_harm_no_one_else() {
    let mut alone = app();
    healthy(&mut alone);
    alone.update();
    let without = fingerprint(&alone);
    for (scale, translation) in [(f32::MAX, 0.0), (1.0e30, 1.0e30), (1.0e-38, 1.0e20), (1.0, f32::MAX)] {
        for method in [ContactMethod::Exact, ContactMethod::Circumsphere, ContactMethod::BoundingSphere] {
            let mut app = app();
            let victim = spawn(
                &mut app,
                &ball(),
                (THIN, Called("victim"), method, SelfCollision, SurfaceLayers { memberships: 0b10, filters: 0b10 }),
            );
            healthy(&mut app);
            with_positions(&mut app, victim, |positions| {
                for position in positions {
                    *position *= scale;
                }
            });
            insert(&mut app, victim, at(translation, translation, 0.0));
            app.update();
            let others: Vec<_> = fingerprint(&app).into_iter().filter(|(a, ..)| *a != "victim").collect();
            assert_eq!(others, without, "{scale} {translation} {method:?}");
            for contact in all(&mut app) {
                assert!(!contact.distance.is_nan() && !contact.normal.is_nan(), "{contact:?}");
            }
        }
    }
}

#[test]
fn settings_out_of_range_are_replaced() {
    let mut alone = app();
    healthy(&mut alone);
    alone.update();
    let without = fingerprint(&alone);
    for margin in [f32::NAN, -1.0, f32::NEG_INFINITY, f32::INFINITY] {
        alone.insert_resource(CircumsphereSettings {
            margin,
            sphere_offset: f32::NAN,
            refit_threshold: -1.0,
            ..Default::default()
        });
        alone.update();
        assert_eq!(fingerprint(&alone), without, "margin {margin}");
    }
    alone.insert_resource(CircumsphereSettings { margin: f32::MAX, ..Default::default() });
    alone.update();
    assert_eq!(store(&alone).touching_count(), {
        alone.insert_resource(CircumsphereSettings::default());
        alone.update();
        store(&alone).touching_count()
    });
}

#[test]
fn a_quarantine_in_a_fixed_schedule_is_announced_once_whatever_the_ticks_a_frame() {
    let mut app = fixed_app(3);
    keep_journal(&mut app, FixedPostUpdate);
    let victim = spawn(&mut app, &ball(), THIN);
    with_positions(&mut app, victim, |positions| positions[2] = Vec3::NAN);
    app.update();
    app.update();
    let reason = QuarantineReason::NonFinitePosition(VertexId(2));
    assert_eq!(
        announced(&mut app),
        [(1, By::Observer, Quarantined(victim, reason.clone())), (1, By::Message, Quarantined(victim, reason))]
    );
}

/// A ball that parry does not recognize as a ball, nor as any other shape.
#[derive(Clone)]
struct Unknown(Ball);

impl RayCast for Unknown {
    fn cast_local_ray_and_get_normal(&self, ray: &Ray, reach: f32, solid: bool) -> Option<RayIntersection> {
        self.0.cast_local_ray_and_get_normal(ray, reach, solid)
    }
}

impl PointQuery for Unknown {
    fn project_local_point(&self, point: Vec3, solid: bool) -> PointProjection {
        self.0.project_local_point(point, solid)
    }

    fn project_local_point_and_get_feature(&self, point: Vec3) -> (PointProjection, FeatureId) {
        self.0.project_local_point_and_get_feature(point)
    }
}

impl Shape for Unknown {
    fn compute_local_aabb(&self) -> Aabb {
        self.0.local_aabb()
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        self.0.local_bounding_sphere()
    }

    fn clone_dyn(&self) -> Box<dyn Shape> {
        Box::new(self.clone())
    }

    fn scale_dyn(&self, _scale: Vec3, _subdivisions: u32) -> Option<Box<dyn Shape>> {
        None
    }

    fn mass_properties(&self, density: f32) -> MassProperties {
        self.0.mass_properties(density)
    }

    fn shape_type(&self) -> ShapeType {
        ShapeType::Custom
    }

    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::Custom(self)
    }

    fn ccd_thickness(&self) -> f32 {
        self.0.radius
    }

    fn ccd_angular_thickness(&self) -> f32 {
        std::f32::consts::PI
    }
}

#[test]
fn a_shape_that_parry_cannot_test_is_set_aside() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let sheet = spawn(&mut app, &sheet(), THIN);
    let unknown = RigidShape(SharedShape::new(Unknown(Ball::new(0.5))));
    let victim = app.world_mut().spawn((unknown, at(0.1, 0.52, 0.2))).id();
    for tick in 0..3 {
        app.update();
        let reason = QuarantineReason::Shape(ShapeError::Unsupported);
        assert_eq!(status(&app, victim), SurfaceStatus::Quarantined(reason.clone()));
        assert_eq!(quarantines(&mut app).len(), usize::from(tick == 0));
        assert_eq!(of(&mut app, sheet), []);
    }
    insert(&mut app, victim, RigidShape(SharedShape::ball(0.5)));
    app.update();
    assert!(!between(&mut app, sheet, victim).is_empty());
}

#[test]
fn what_was_written_while_a_surface_could_not_be_seen_is_looked_at_when_it_is_back() {
    let mut app = app();
    healthy(&mut app);
    let victim = spawn(&mut app, &ball(), (THIN, victims_place()));
    app.update();
    assert_eq!(status(&app, victim), SurfaceStatus::Active);
    app.world_mut().entity_mut(victim).remove::<SurfaceThickness>();
    app.update();
    with_positions(&mut app, victim, |positions| positions[7].y = f32::NAN);
    app.update();
    insert(&mut app, victim, THIN);
    app.update();
    let reason = QuarantineReason::NonFinitePosition(VertexId(7));
    assert_eq!(status(&app, victim), SurfaceStatus::Quarantined(reason));
}
