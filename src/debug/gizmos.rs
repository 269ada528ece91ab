//! Draws every tick by `bevy_gizmos`: the layers of a recording, as lines in the game's own window.
//!
//! It only reads the state of the tick, after detection and before the response.

use std::{collections::BTreeSet, f32::consts::TAU};

use bevy_app::prelude::*;
use bevy_color::{Color, Srgba};
use bevy_ecs::{prelude::*, schedule::InternedScheduleLabel};
use bevy_gizmos::{
    AppGizmoBuilder, GizmoPlugin,
    config::{GizmoConfigGroup, GizmoConfigStore},
    gizmos::{GizmoBuffer, Gizmos},
};
use bevy_reflect::prelude::*;
use glam::{Affine3A, DVec3, Quat, Vec3};

use super::{
    LevelOfDetail,
    bodies::{Body, Caps, RIM_CORNERS},
    colors,
    contacts::NormalLengths,
    pairs::{Placed, by_fate, line},
    patches::{outline, smooth, triangles, weights},
    tick::{Detected, Scene, Touch, Touches, has_passed},
    wires::wires,
};
use crate::{
    kernel::{pair_fate::PairFate, pose::Pose},
    schedule::{DeformableSystems, add_to_host_schedule, run_detection},
    surface::DeformableSurface,
};

/// Half the size of the cross at a contact point, relative to the length of its normal.
const CROSS: f32 = 0.2;

/// Triangles with colors of their own are drawn smaller by this factor, so that neighbors do not cover each other.
const SHRUNK: f32 = 0.85;

/// Number of lines from the center of a sphere to the rim of its cone.
const SPOKES: usize = 4;

/// Number of lines of each circle of a sphere.
const SPHERE_CORNERS: u32 = 24;

/// The layers that [`DeformableGizmosPlugin`] draws. They have the content and the colors of the layers of a
/// [recording](crate::debug). A layer is empty if the contact method does not compute its content: curvature, recipe ages,
/// offset spheres, and cones exist for pairs tested by `Circumsphere`.
///
/// It is a group of gizmos: `GizmoConfigStore::config_mut` returns it together with the `GizmoConfig` that sets the width
/// of the lines and switches all of them. Changes take effect in the next tick.
#[derive(Clone, Debug, PartialEq, Eq, Reflect, GizmoConfigGroup)]
#[reflect(Clone, Debug, Default, PartialEq)]
pub struct DeformableGizmos {
    /// The edges of surfaces, colored where a triangle touches. Default `All`.
    pub meshes: LevelOfDetail,
    /// Rigid shapes, as wireframes. Default true.
    pub shapes: bool,
    /// A cross at the point of each contact on its first side, and its normal. Default true.
    pub contacts: bool,
    /// Lines between the two points of contacts whose sides have passed each other, and crosses where an edge pierces a
    /// face. Default true.
    pub penetrations: bool,
    /// The curved patches of smooth surfaces, over the outlines of their flat triangles. Default `NearContacts`.
    pub patches: LevelOfDetail,
    /// Pairs of triangles whose boxes overlap, by the step that dropped them. Default `Off`.
    pub pairs: LevelOfDetail,
    /// Offset spheres or enclosing balls. Default `Off`.
    pub spheres: LevelOfDetail,
    /// Safety cones. Default `Off`.
    pub cones: LevelOfDetail,
    /// Triangles colored by curvature. Default `Off`.
    pub curvature: LevelOfDetail,
    /// Triangles colored by the age of their sphere's recipe. Default `Off`.
    pub recipe_age: LevelOfDetail,
    /// Number of levels of each surface's tree, from the root, if the tree is up to date in the tick. Default 0.
    pub tree_levels: u32,
}

impl Default for DeformableGizmos {
    fn default() -> Self {
        Self {
            meshes: LevelOfDetail::All,
            shapes: true,
            contacts: true,
            penetrations: true,
            patches: LevelOfDetail::NearContacts,
            pairs: LevelOfDetail::Off,
            spheres: LevelOfDetail::Off,
            cones: LevelOfDetail::Off,
            curvature: LevelOfDetail::Off,
            recipe_age: LevelOfDetail::Off,
            tree_levels: 0,
        }
    }
}

/// Draws what detection found in the game's own window, by `bevy_gizmos`. [`DeformableGizmos`] selects the layers.
/// Contacts are the same with and without it.
///
/// The app needs [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins), and Bevy's `GizmoPlugin`, which is one
/// of the `DefaultPlugins`. While the group is disabled (`GizmoConfig::enabled`), nothing is computed.
///
/// # Panics
/// When the app is finished, without one of these plugins.
pub struct DeformableGizmosPlugin;

impl Plugin for DeformableGizmosPlugin {
    fn build(&self, app: &mut App) {
        app.init_gizmo_group::<DeformableGizmos>();
        add_to_host_schedule::<Self>(app, false, add_systems);
    }

    fn finish(&self, app: &mut App) {
        add_to_host_schedule::<Self>(app, true, add_systems);
        assert!(
            app.is_plugin_added::<GizmoPlugin>(),
            "DeformableGizmosPlugin draws by gizmos: add Bevy's DefaultPlugins, or GizmoPlugin"
        );
    }
}

fn add_systems(app: &mut App, schedule: InternedScheduleLabel) {
    app.add_systems(
        schedule,
        draw.in_set(DeformableSystems::Detect)
            .after(run_detection)
            .run_if(|store: Res<GizmoConfigStore>| store.config::<DeformableGizmos>().0.enabled),
    );
}

/// Draws in world space.
struct Pen<'a>(&'a mut GizmoBuffer<DeformableGizmos, ()>);

impl Pen<'_> {
    fn line(&mut self, ends: [Vec3; 2], color: Color) {
        self.0.line(ends[0], ends[1], color);
    }

    fn cross(&mut self, center: Vec3, half_size: f32, color: Color) {
        for axis in Vec3::AXES {
            self.line([center - axis * half_size, center + axis * half_size], color);
        }
    }

    fn strip(&mut self, points: impl IntoIterator<Item = Vec3>, color: Color) {
        let mut points = points.into_iter();
        let Some(mut last) = points.next() else { return };
        for point in points {
            self.line([last, point], color);
            last = point;
        }
    }
}

fn gizmo_color(color: colors::Color) -> Color {
    let [red, green, blue, opacity] = color.0;
    // Gizmos are linear. Otherwise every line would convert its color.
    Color::LinearRgba(Srgba::rgba_u8(red, green, blue, opacity).into())
}

fn place(pose: &Pose, point: Vec3) -> Vec3 {
    pose.transform_point(point.as_dvec3()).as_vec3()
}

fn draw(
    mut gizmos: Gizmos<DeformableGizmos>,
    detected: Detected,
    surfaces: Query<&DeformableSurface>,
    mut scene: Local<Option<Scene>>,
) {
    let layers = gizmos.config_ext;
    let touches = Touches::new(&detected);
    let mut pen = Pen(&mut gizmos);
    draw_meshes(&mut pen, &detected, layers.meshes, &touches);
    *scene = scene.or_else(|| Scene::of(&detected.active));
    if layers.shapes {
        draw_shapes(&mut pen, &detected, *scene);
    }
    draw_contacts(&mut pen, &detected, layers, &surfaces);
    draw_patches(&mut pen, &detected, layers.patches, &touches);
    draw_pairs(&mut pen, &detected, layers.pairs, &touches);
    for body in &Body::all(&detected) {
        let pose = &body.surface.pose;
        draw_spheres(&mut pen, body, layers, &touches);
        let threshold = detected.settings.recipe().curvature_threshold;
        draw_faces(&mut pen, body, layers.curvature, &touches, |caps, kept| {
            kept.iter().map(|&triangle| caps.curvature_color(triangle, threshold)).collect()
        });
        draw_faces(&mut pen, body, layers.recipe_age, &touches, |caps, kept| {
            caps.recipe_ages(kept).into_iter().map(colors::age).collect()
        });
        if let Some(tree) = body.tree.filter(|_| layers.tree_levels > 0) {
            let to_world = pose.to_affine();
            tree.for_each_node(|level, bounds| {
                if level < layers.tree_levels {
                    let color = gizmo_color(colors::LEVELS[level as usize % colors::LEVELS.len()]);
                    let (center, size) = ((bounds.min + bounds.max) * 0.5, bounds.max - bounds.min);
                    let unit = Affine3A::from_scale_rotation_translation(size, Quat::IDENTITY, center);
                    pen.0.cube(to_world.as_affine3a() * unit, color);
                }
            });
        }
    }
}

fn draw_meshes(pen: &mut Pen, detected: &Detected, level: LevelOfDetail, touches: &Touches) {
    if level == LevelOfDetail::Off {
        return;
    }
    for (number, surface) in detected.active.surfaces.iter().enumerate() {
        let Some((positions, _)) = detected.surface(surface) else { continue };
        let topology = &surface.topology;
        let mut edges: Vec<Option<(Touch, [u32; 2])>> = vec![None; topology.edges().len()];
        for triangle in touches.triangles(level, number) {
            let touch = touches.triangles[number][triangle as usize];
            let [a, b, c] = topology.triangles()[triangle as usize];
            for (ends, edge) in [[a, b], [b, c], [c, a]].into_iter().zip(topology.triangle_edges()[triangle as usize]) {
                let edge = &mut edges[edge as usize];
                if edge.is_none_or(|(before, _)| before < touch) {
                    *edge = Some((touch, ends));
                }
            }
        }
        let by_touch =
            [Touch::None, Touch::Touching, Touch::Penetrating].map(|touch| gizmo_color(colors::touch(number, touch)));
        for (touch, ends) in edges.into_iter().flatten() {
            pen.line(ends.map(|end| place(&surface.pose, positions[end as usize])), by_touch[touch as usize]);
        }
    }
}

fn draw_shapes(pen: &mut Pen, detected: &Detected, scene: Option<Scene>) {
    let color = gizmo_color(colors::SHAPES);
    for shape in &detected.active.shapes {
        let Ok(rigid) = detected.shapes.get(shape.entity) else { continue };
        let scene = Scene::of_shape(scene, &shape.pose);
        for wire in wires(&rigid.0, scene.center, scene.reach) {
            pen.strip(wire.into_iter().map(|point| place(&shape.pose, point.into())), color);
        }
    }
}

fn draw_contacts(pen: &mut Pen, detected: &Detected, layers: &DeformableGizmos, surfaces: &Query<&DeformableSurface>) {
    if !layers.contacts && !layers.penetrations {
        return;
    }
    let [normals, penetrations, crossings] = [colors::NORMALS, colors::PENETRATING, colors::CROSSINGS].map(gizmo_color);
    let lengths = NormalLengths::new(detected, surfaces);
    for (pair, contacts) in detected.contacts.by_pair() {
        let length = lengths.of(pair);
        for contact in contacts {
            let (first, second) = contact.points();
            if layers.contacts {
                pen.cross(first, CROSS * length, gizmo_color(colors::contact(&contact)));
                pen.line([first, first + contact.normal() * length], normals);
            }
            if layers.penetrations && contact.is_crossing() {
                pen.cross(first, CROSS * length, crossings);
            } else if layers.penetrations && has_passed(&contact) {
                pen.line([first, second], penetrations);
            }
        }
    }
}

fn draw_patches(pen: &mut Pen, detected: &Detected, level: LevelOfDetail, touches: &Touches) {
    let [patch_color, outline_color] = [colors::PATCHES, colors::OUTLINES].map(gizmo_color);
    let edges: BTreeSet<[u32; 2]> = triangles()
        .flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[start, end]| [start.min(end), start.max(end)])
        .collect();
    for (surface, state, wanted) in smooth(detected, level, touches) {
        for patch in state.patches(&surface.topology, &wanted).unwrap_or_default() {
            let to_world = |point: DVec3| surface.pose.transform_point(point).as_vec3();
            let points: Vec<Vec3> = weights().map(|weights| to_world(patch.point(&weights))).collect();
            for ends in &edges {
                pen.line(ends.map(|end| points[end as usize]), patch_color);
            }
            pen.strip(outline(&patch).map(|corner| to_world(corner.as_dvec3())), outline_color);
        }
    }
}

fn draw_pairs(pen: &mut Pen, detected: &Detected, level: LevelOfDetail, touches: &Touches) {
    let drawn = by_fate(detected, level, touches);
    if drawn.is_empty() {
        return;
    }
    let placed = Placed::all(detected);
    for pairs in &drawn {
        for (fate, triangles) in PairFate::ALL.into_iter().zip(&pairs.by_fate) {
            let color = gizmo_color(colors::fate(fate));
            for &pair in triangles {
                pen.strip(line(&placed, pairs.pair, pair), color);
            }
        }
    }
}

fn draw_spheres(pen: &mut Pen, body: &Body, layers: &DeformableGizmos, touches: &Touches) {
    let pose = &body.surface.pose;
    let [sphere_color, cone_color] = [colors::SPHERES, colors::CONES].map(gizmo_color);
    for (_, ball) in body.spheres(layers.spheres, touches) {
        let radius = ball.radius * pose.scale() as f32;
        pen.0.sphere(place(pose, ball.center), radius, sphere_color).resolution(SPHERE_CORNERS);
    }
    for (_, cap) in body.cones(layers.cones, touches) {
        let sine = (1.0 - cap.cosine * cap.cosine).max(0.0).sqrt();
        let (u, v) = cap.axis.any_orthonormal_pair();
        let rim = |corner: usize| {
            let (y, x) = bevy_math::ops::sin_cos(TAU * corner as f32 / RIM_CORNERS as f32);
            place(pose, cap.center + (cap.axis * cap.cosine + (u * x + v * y) * sine) * cap.radius)
        };
        pen.strip((0..=RIM_CORNERS).map(rim), cone_color);
        for spoke in 0..SPOKES {
            pen.line([place(pose, cap.center), rim(spoke * RIM_CORNERS / SPOKES)], cone_color);
        }
    }
}

/// Draws triangles, each in its own color. `faces` returns the colors of the given triangles.
fn draw_faces(
    pen: &mut Pen,
    body: &Body,
    level: LevelOfDetail,
    touches: &Touches,
    faces: impl Fn(Caps, &[u32]) -> Vec<colors::Color>,
) {
    let Some(caps) = body.caps else { return };
    let kept = body.triangles(level, touches);
    if kept.is_empty() {
        return;
    }
    for (&triangle, color) in kept.iter().zip(faces(caps, &kept)) {
        let corners = body.corners(triangle);
        let center = corners.iter().sum::<Vec3>() / 3.0;
        let [a, b, c] = corners.map(|corner| place(&body.surface.pose, center + (corner - center) * SHRUNK));
        pen.strip([a, b, c, a], gizmo_color(color));
    }
}
