//! `Prepare`, the first step of a tick: reads what the game wrote, quarantines what cannot be used, and gathers the
//! rest into [`ActiveSurfaces`].

use std::sync::Arc;

use bevy_app::prelude::*;
use bevy_ecs::{
    entity_disabling::Disabled,
    prelude::*,
    query::QueryData,
    schedule::{InternedScheduleLabel, ScheduleLabel},
    system::SystemParam,
};
use bevy_transform::components::Transform;
use glam::{DAffine3, DMat3, Vec3};

use super::{
    active::{ActiveShape, ActiveSurface, ActiveSurfaces, SideOrder},
    checked::{CheckedPositions, NextRegistration, Registration},
    components::{
        ContactEventHold, ContactEventsEnabled, ContactMethod, DeformableSurface, SelfCollision, Sidedness,
        SurfaceDisabled, SurfaceFrame, SurfaceLayers, SurfaceOrder, SurfacePositions, SurfaceShape, SurfaceStatus,
        SurfaceThickness, Teleported,
    },
    named::Named,
    quarantine::{QuarantineReason, SurfaceQuarantined},
    query_only::QueryOnly,
    rest_contacts::RestContactsIgnored,
    rigid_shape::{PreparedShape, RigidMesh, RigidShape, Solid},
    triangle_layers::TriangleLayers,
    vertex_thickness::{ThicknessList, VertexThickness},
};
use crate::{
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{
        mesh::{bounds::Aabb, topology::SurfaceTopology},
        pose::Pose,
    },
    schedule::DeformableSystems,
};

/// Less than a quarter of the largest f32. Differences of world coordinates up to this, and the lengths of those, are
/// finite.
const LARGEST: f64 = 8.0e37;

/// In a frame of this scale, everything within 1e7 world units is within [`LARGEST`].
const LEAST_SCALE: f64 = 1.0e-30;

/// Gathers surfaces and shapes into [`ActiveSurfaces`].
pub struct SurfacePlugin {
    schedule: InternedScheduleLabel,
}

impl SurfacePlugin {
    /// Gathers them in `schedule`.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Plugin for SurfacePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<ActiveSurfaces>()
            .init_resource::<NextRegistration>()
            .init_resource::<PendingQuarantines>()
            .init_resource::<DetectionDiagnostics>();
        let systems = (gather_surfaces, gather_shapes, note_disabled, end_teleports).chain();
        app.add_systems(self.schedule, systems.in_set(GatherSurfaces).in_set(DeformableSystems::Prepare));
    }
}

/// The systems that write [`ActiveSurfaces`].
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct GatherSurfaces;

/// The quarantines of this tick. Sent in `Events`.
#[derive(Resource, Default)]
pub(crate) struct PendingQuarantines(pub(crate) Vec<SurfaceQuarantined>);

#[derive(QueryData)]
#[query_data(mutable)]
struct SurfaceItem {
    entity: Entity,
    name: Option<&'static Name>,
    surface: Ref<'static, DeformableSurface>,
    positions: Ref<'static, SurfacePositions>,
    checked: &'static mut CheckedPositions,
    status: &'static mut SurfaceStatus,
    thickness: &'static SurfaceThickness,
    method: &'static ContactMethod,
    layers: &'static SurfaceLayers,
    sidedness: &'static Sidedness,
    shape: &'static SurfaceShape,
    frame: Ref<'static, SurfaceFrame>,
    registration: &'static Registration,
    order: Option<&'static SurfaceOrder>,
    self_collision: Has<SelfCollision>,
    query_only: Has<QueryOnly>,
    disabled: Has<SurfaceDisabled>,
    events: Has<ContactEventsEnabled>,
    event_hold: Option<&'static ContactEventHold>,
    rest_contacts: Option<&'static RestContactsIgnored>,
    triangle_layers: Option<&'static TriangleLayers>,
    vertex_thickness: Option<&'static VertexThickness>,
}

fn order(rigid: bool, order: Option<&SurfaceOrder>, registration: Registration, entity: Entity) -> SideOrder {
    (rigid, order.map_or(0, |order| order.0), registration.0, entity.index_u32())
}

fn held(hold: Option<&ContactEventHold>) -> u32 {
    hold.map_or(0, |hold| hold.0)
}

/// The transforms of entities and their parents.
#[derive(SystemParam)]
pub(crate) struct Transforms<'w, 's> {
    own: Query<'w, 's, &'static Transform>,
    parents: Query<'w, 's, &'static ChildOf>,
}

impl Transforms<'_, '_> {
    /// Computes the pose from transforms. In a fixed schedule, the propagated transform is that of the last frame. Uses
    /// f64, so that the children of a parent far from the origin are placed relative to each other as precisely as near
    /// it.
    fn pose(&self, entity: Entity, frame: SurfaceFrame) -> Result<Pose, QuarantineReason> {
        let pose = Pose::from_double_affine(&self.affine(entity, frame)?)?;
        if pose.scale() < LEAST_SCALE { Err(QuarantineReason::TinyScale) } else { Ok(pose) }
    }

    /// The same, without restrictions on the scale.
    pub(crate) fn affine(&self, entity: Entity, frame: SurfaceFrame) -> Result<DAffine3, QuarantineReason> {
        match frame {
            SurfaceFrame::Local => self.global_affine(entity),
            SurfaceFrame::Unscaled => Ok(without_scale(&self.global_affine(entity)?)),
            SurfaceFrame::World => Ok(DAffine3::IDENTITY),
        }
    }

    /// Whether an entity or one of its parents was teleported.
    fn has_jumped(&self, entity: Entity, teleported: &TeleportedEntities) -> bool {
        let has_jumped = |entity| teleported.contains(entity);
        !teleported.is_empty() && (has_jumped(entity) || self.parents.iter_ancestors(entity).any(has_jumped))
    }

    /// The transform of an entity and its parents.
    pub(crate) fn global_affine(&self, entity: Entity) -> Result<DAffine3, QuarantineReason> {
        let affine = |entity: Entity| {
            let transform = self.own.get(entity).map_err(|_| QuarantineReason::MissingTransform)?;
            Ok::<DAffine3, QuarantineReason>(DAffine3::from_scale_rotation_translation(
                transform.scale.as_dvec3(),
                transform.rotation.as_dquat().normalize(),
                transform.translation.as_dvec3(),
            ))
        };
        let mut global = affine(entity)?;
        for ancestor in self.parents.iter_ancestors(entity) {
            global = affine(ancestor)? * global;
        }
        Ok(global)
    }
}

/// Rotation and translation alone. What is mirrored counts as scaled by −1 along x, as in glam and so in Bevy. Axes that
/// are sheared are made perpendicular.
fn without_scale(affine: &DAffine3) -> DAffine3 {
    let DAffine3 { matrix3: linear, translation } = *affine;
    let x = (linear.x_axis * linear.determinant().signum()).normalize_or_zero();
    let z = x.cross(linear.y_axis).normalize_or_zero();
    DAffine3 { matrix3: DMat3::from_cols(x, z.cross(x), z), translation }
}

/// Sets the status, and queues a message if a quarantine is new. Another reason for the same quarantine is not new.
fn update_status(
    (entity, name): (Entity, Option<&Name>),
    status: &mut Mut<SurfaceStatus>,
    next: SurfaceStatus,
    quarantines: &mut PendingQuarantines,
) {
    let was_quarantined = matches!(**status, SurfaceStatus::Quarantined(_));
    status.set_if_neq(next);
    if !was_quarantined && let SurfaceStatus::Quarantined(reason) = &**status {
        log::warn!("surface or shape {} is quarantined: {reason}", Named(entity, name));
        quarantines.0.push(SurfaceQuarantined { entity, reason: reason.clone() });
    }
}

/// What the game has teleported.
type TeleportedEntities<'w, 's> = Query<'w, 's, Entity, With<Teleported>>;

fn gather_surfaces(
    mut active: ResMut<ActiveSurfaces>,
    mut quarantines: ResMut<PendingQuarantines>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut surfaces: Query<SurfaceItem>,
    teleported: TeleportedEntities,
    transforms: Transforms,
) {
    diagnostics.begin_tick();
    let watch = StageWatch::start("prepare");
    quarantines.0.clear();
    active.surfaces.clear();
    for mut item in &mut surfaces {
        let was_active = *item.status == SurfaceStatus::Active;
        let next = if item.disabled {
            SurfaceStatus::Disabled
        } else if item.positions.0.is_empty() {
            SurfaceStatus::Waiting
        } else {
            match validate(&mut item, &transforms) {
                Ok((pose, (thickness, vertex_thickness))) => {
                    let topology = Arc::clone(item.surface.topology());
                    let one_sided = item.sidedness.has_inside(&topology);
                    active.surfaces.push(ActiveSurface {
                        entity: item.entity,
                        topology,
                        pose,
                        thickness,
                        vertex_thickness,
                        method: *item.method,
                        layers: contact_layers(*item.layers, item.query_only),
                        query_layers: *item.layers,
                        self_collision: item.self_collision && !item.query_only,
                        one_sided,
                        shape: *item.shape,
                        rigid: false,
                        events: item.events,
                        event_hold: held(item.event_hold),
                        fresh: transforms.has_jumped(item.entity, &teleported)
                            || item.surface.is_changed()
                            || item.frame.is_changed()
                            || !was_active,
                        solver_margins: [0.0; 2],
                        own_margin: 0.0,
                        margin: 0.0,
                        world_bounds: Aabb::EMPTY,
                        triangle_layers: item.triangle_layers.map(TriangleLayers::shared),
                        rest_pairs: item.rest_contacts.map(RestContactsIgnored::shared),
                        order: order(false, item.order, *item.registration, item.entity),
                    });
                    SurfaceStatus::Active
                }
                Err(reason) => SurfaceStatus::Quarantined(reason),
            }
        };
        update_status((item.entity, item.name), &mut item.status, next, &mut quarantines);
    }
    diagnostics.finish(watch, 0, 0);
}

/// The layers that decide what a surface or shape touches. Belongs to no group, and meets none, if it is only queried.
fn contact_layers(layers: SurfaceLayers, query_only: bool) -> SurfaceLayers {
    if query_only { SurfaceLayers { memberships: 0, filters: 0 } } else { layers }
}

fn validate(
    item: &mut SurfaceItemItem<'_, '_>,
    transforms: &Transforms,
) -> Result<(Pose, Thickness), QuarantineReason> {
    let (expected, found) = (item.surface.topology().vertex_count(), item.positions.0.len());
    if expected != found {
        return Err(QuarantineReason::PositionCount { expected, found });
    }
    let at_most = item.checked.check(&item.positions)?;
    let pose = transforms.pose(item.entity, *item.frame)?;
    check_reach(&item.positions.0, at_most, &pose)?;
    let thickness = thickness(item, &pose)?;
    check_triangle_layers(item.triangle_layers, item.surface.topology())?;
    if item.rest_contacts.is_some_and(|contacts| !contacts.is_of(item.surface.topology())) {
        return Err(QuarantineReason::RestContacts);
    }
    Ok((pose, thickness))
}

/// The largest thickness in world units, and the thickness at each vertex if it varies.
type Thickness = (f32, Option<Arc<ThicknessList>>);

fn thickness(item: &SurfaceItemItem<'_, '_>, pose: &Pose) -> Result<Thickness, QuarantineReason> {
    let list = item.vertex_thickness.map(|thickness| thickness.checked(item.surface.topology())).transpose()?;
    let largest = match (&list, *item.thickness) {
        (Some(list), _) => list.largest * pose.scale() as f32,
        (None, SurfaceThickness::World(thickness)) => thickness,
        (None, SurfaceThickness::MeanEdges(edges)) => edges * item.surface.mean_edge() * pose.scale() as f32,
    };
    if !largest.is_finite() || largest < 0.0 {
        return Err(QuarantineReason::Thickness(largest));
    }
    Ok((largest, list.filter(|list| list.least < list.largest)))
}

fn check_triangle_layers(layers: Option<&TriangleLayers>, topology: &SurfaceTopology) -> Result<(), QuarantineReason> {
    let expected = topology.triangles().len();
    let found = layers.map_or(expected, |layers| layers.layers().len());
    if expected == found { Ok(()) } else { Err(QuarantineReason::TriangleLayers { expected, found }) }
}

/// Checks whether the whole surface is in range in the world. `at_most` is an upper bound of the magnitude of its
/// coordinates.
fn check_reach(positions: &[Vec3], at_most: f32, pose: &Pose) -> Result<(), QuarantineReason> {
    // Sufficient for most surfaces.
    if is_in_range(at_most, pose) {
        return Ok(());
    }
    let largest = positions.iter().fold(Vec3::ZERO, |largest, position| largest.max(position.abs()));
    is_in_range(largest.max_element(), pose).then_some(()).ok_or(QuarantineReason::OutOfRange)
}

fn largest_coordinate(bounds: &Aabb) -> f32 {
    bounds.min.abs().max(bounds.max.abs()).max_element()
}

/// Whether points with coordinates of at most this magnitude in their own frame are in range in the world.
fn is_in_range(largest: f32, pose: &Pose) -> bool {
    // The distance to the corner of a cube.
    let reach = 3.0_f64.sqrt() * f64::from(largest) * pose.scale();
    reach + pose.to_affine().translation.abs().max_element() <= LARGEST
}

#[derive(QueryData)]
#[query_data(mutable)]
struct ShapeItem {
    entity: Entity,
    name: Option<&'static Name>,
    shape: Ref<'static, PreparedShape>,
    mesh: Option<(&'static RigidMesh, Ref<'static, SurfacePositions>, &'static mut CheckedPositions)>,
    status: &'static mut SurfaceStatus,
    layers: &'static SurfaceLayers,
    frame: Ref<'static, SurfaceFrame>,
    sidedness: Option<&'static Sidedness>,
    surface_shape: Option<&'static SurfaceShape>,
    triangle_layers: Option<&'static TriangleLayers>,
    registration: &'static Registration,
    order: Option<&'static SurfaceOrder>,
    query_only: Has<QueryOnly>,
    disabled: Has<SurfaceDisabled>,
    events: Has<ContactEventsEnabled>,
    event_hold: Option<&'static ContactEventHold>,
}

fn gather_shapes(
    mut active: ResMut<ActiveSurfaces>,
    mut quarantines: ResMut<PendingQuarantines>,
    mut shapes: Query<ShapeItem, (With<RigidShape>, Without<DeformableSurface>)>,
    teleported: TeleportedEntities,
    transforms: Transforms,
) {
    active.shapes.clear();
    for mut item in &mut shapes {
        let was_active = *item.status == SurfaceStatus::Active;
        let has_jumped = transforms.has_jumped(item.entity, &teleported);
        let fresh = has_jumped || item.shape.is_changed() || item.frame.is_changed() || !was_active;
        let next = if item.disabled {
            SurfaceStatus::Disabled
        } else {
            match add_shape(&mut item, fresh, &transforms, &mut active) {
                Ok(()) => SurfaceStatus::Active,
                Err(reason) => SurfaceStatus::Quarantined(reason),
            }
        };
        update_status((item.entity, item.name), &mut item.status, next, &mut quarantines);
    }
    active.surfaces.sort_unstable_by_key(|surface| surface.order);
    active.shapes.sort_unstable_by_key(|shape| shape.order);
}

/// Entities that are disabled as a whole, as in a pool, are like surfaces and shapes with [`SurfaceDisabled`].
fn note_disabled(mut disabled: Query<&mut SurfaceStatus, With<Disabled>>) {
    for mut status in &mut disabled {
        status.set_if_neq(SurfaceStatus::Disabled);
    }
}

/// A jump takes one tick.
fn end_teleports(mut commands: Commands, teleported: TeleportedEntities) {
    for entity in &teleported {
        commands.entity(entity).try_remove::<Teleported>();
    }
}

fn add_shape(
    item: &mut ShapeItemItem<'_, '_>,
    fresh: bool,
    transforms: &Transforms,
    active: &mut ActiveSurfaces,
) -> Result<(), QuarantineReason> {
    let pose = transforms.pose(item.entity, *item.frame)?;
    let solid = item.shape.0.clone()?;
    let order = order(true, item.order, *item.registration, item.entity);
    let (entity, query_layers, events) = (item.entity, *item.layers, item.events);
    let event_hold = held(item.event_hold);
    let layers = contact_layers(query_layers, item.query_only);
    if let Some(Solid { geometry, parts }) = solid {
        // A half-space is unbounded, so only its pose has to be in range.
        if !is_in_range(geometry.bounds().map_or(0.0, |bounds| largest_coordinate(&bounds)), &pose) {
            return Err(QuarantineReason::OutOfRange);
        }
        active.shapes.push(ActiveShape {
            entity,
            geometry,
            parts,
            pose,
            target: None,
            solver_margin: 0.0,
            margin: 0.0,
            layers,
            query_layers,
            fresh,
            events,
            event_hold,
            order,
        });
        return Ok(());
    }
    let Some((RigidMesh { topology }, positions, checked)) = &mut item.mesh else { return Ok(()) };
    let (expected, found) = (topology.vertex_count(), positions.0.len());
    if expected != found {
        return Err(QuarantineReason::PositionCount { expected, found });
    }
    let at_most = checked.check(positions)?;
    check_reach(&positions.0, at_most, &pose)?;
    check_triangle_layers(item.triangle_layers, topology)?;
    active.surfaces.push(ActiveSurface {
        entity,
        topology: Arc::clone(topology),
        pose,
        thickness: 0.0,
        vertex_thickness: None,
        method: ContactMethod::Exact,
        layers,
        query_layers,
        self_collision: false,
        one_sided: item.sidedness.copied().unwrap_or_default().has_inside(topology),
        shape: item.surface_shape.copied().unwrap_or_default(),
        rigid: true,
        events,
        event_hold,
        fresh,
        solver_margins: [0.0; 2],
        own_margin: 0.0,
        margin: 0.0,
        world_bounds: Aabb::EMPTY,
        triangle_layers: item.triangle_layers.map(TriangleLayers::shared),
        rest_pairs: None,
        order,
    });
    Ok(())
}
