//! Draws per-triangle data of surfaces: spheres, cones, curvature, recipe ages, and trees.
//!
//! Everything is drawn in the surface's own frame, as the stages store it, together with the pose.

use std::f32::consts::TAU;

use glam::{Quat, Vec3};
use rerun::{AnyValues, AsComponents, Boxes3D, Ellipsoids3D, FillMode, InstancePoses3D, Mesh3D};

use super::{
    colors::{self, Color},
    names::{Names, transform},
    recorder::{Layer, TickWriter, path, row_bytes},
    settings::RerunSettings,
    values,
};
use crate::{
    debug::{
        LevelOfDetail,
        bodies::{Body, Caps, RIM_CORNERS},
        tick::{Detected, Touches},
    },
    kernel::{
        mesh::bounds::Aabb,
        spheres::{circumsphere::Ball, cone::Cap},
    },
};

/// What this module draws.
struct Shown<'a> {
    names: &'a Names,
    touches: &'a Touches,
    bodies: Vec<Body<'a>>,
}

/// Draws all layers of this module.
pub(super) fn draw(
    writer: &mut TickWriter,
    detected: &Detected,
    settings: &RerunSettings,
    names: &Names,
    touches: &Touches,
) {
    let shown = Shown { names, touches, bodies: Body::all(detected) };
    draw_spheres(writer, settings.spheres, &shown);
    draw_cones(writer, settings.cones, &shown);
    let threshold = detected.settings.recipe().curvature_threshold;
    draw_faces(writer, Layer::Curvature, settings.curvature, &shown, |caps, kept| {
        let curvatures: Vec<f32> = kept.iter().map(|&triangle| caps.curvature.curvatures[triangle as usize]).collect();
        let face_colors = kept.iter().map(|&triangle| caps.curvature_color(triangle, threshold)).collect();
        (face_colors, values::number(values::triangles(kept), "curvature", &curvatures))
    });
    draw_faces(writer, Layer::RecipeAge, settings.recipe_age, &shown, |caps, kept| {
        let ages = caps.recipe_ages(kept);
        let face_colors = ages.iter().copied().map(colors::age).collect();
        (face_colors, values::whole(values::triangles(kept), "recipe_age", &ages))
    });
    draw_trees(writer, settings.tree_levels, &shown);
}

fn draw_spheres(writer: &mut TickWriter, level: LevelOfDetail, shown: &Shown) {
    let spheres: Vec<Vec<(u32, Ball)>> = shown.bodies.iter().map(|body| body.spheres(level, shown.touches)).collect();
    let count = spheres.iter().map(Vec::len).sum();
    let filled = spheres.iter().filter(|spheres| !spheres.is_empty()).count();
    let mut share = writer.share(Layer::Spheres, count, 12 + 12 + 4, filled, row_bytes(8));
    for (body, spheres) in shown.bodies.iter().zip(spheres) {
        let kept: Vec<(u32, Ball)> = share.places(spheres.len()).into_iter().map(|place| spheres[place]).collect();
        if kept.is_empty() {
            continue;
        }
        let ellipsoids = Ellipsoids3D::from_centers_and_radii(
            kept.iter().map(|(_, ball)| ball.center.to_array()),
            kept.iter().map(|(_, ball)| ball.radius),
        )
        .with_colors([colors::SPHERES])
        .with_fill_mode(FillMode::MajorWireframe)
        .with_line_radii([colors::THIN]);
        let triangles: Vec<u32> = kept.iter().map(|&(triangle, _)| triangle).collect();
        let pose = transform(&body.surface.pose);
        let rows: [&dyn AsComponents; 3] = [&ellipsoids, &values::triangles(&triangles), &pose];
        writer.passing_row(path([Layer::Spheres.name(), &shown.names.of(body.surface.entity)]), &rows);
    }
}

/// The lateral surface of a cone with its apex at the origin, of height 1 along z and radius 1 at its end.
fn unit_cone() -> Mesh3D {
    let rim = (0..RIM_CORNERS).map(|corner| {
        let (y, x) = bevy_math::ops::sin_cos(TAU * corner as f32 / RIM_CORNERS as f32);
        [x, y, 1.0]
    });
    let corners: Vec<[f32; 3]> = std::iter::once([0.0; 3]).chain(rim).collect();
    let side = |corner: usize| [0, corner as u32 + 1, ((corner + 1) % RIM_CORNERS) as u32 + 1];
    let outward = corners.iter().map(|[x, y, z]| if *z > 0.0 { [*x, *y, -1.0] } else { [0.0, 0.0, -1.0] });
    Mesh3D::new(corners.iter().copied())
        .with_triangle_indices((0..RIM_CORNERS).map(side))
        .with_vertex_normals(outward)
        .with_albedo_factor(colors::CONES)
}

/// Draws cones from the center of their sphere to the circle that they cut out of it.
fn draw_cones(writer: &mut TickWriter, level: LevelOfDetail, shown: &Shown) {
    let cones: Vec<Vec<(u32, Cap)>> = shown.bodies.iter().map(|body| body.cones(level, shown.touches)).collect();
    let count = cones.iter().map(Vec::len).sum();
    let filled = cones.iter().filter(|cones| !cones.is_empty()).count();
    // The unit cone that the poses refer to is part of the row.
    let mut share = writer.share(Layer::Cones, count, 12 + 16 + 12 + 4 + 4, filled, row_bytes(12));
    for (body, cones) in shown.bodies.iter().zip(cones) {
        let kept: Vec<(u32, Cap)> = share.places(cones.len()).into_iter().map(|place| cones[place]).collect();
        if kept.is_empty() {
            continue;
        }
        let triangles: Vec<u32> = kept.iter().map(|&(triangle, _)| triangle).collect();
        let angles: Vec<f32> = kept.iter().map(|(_, cap)| bevy_math::ops::acos(cap.cosine).to_degrees()).collect();
        let sizes = kept.iter().map(|(_, cap)| {
            let sine = (1.0 - cap.cosine * cap.cosine).max(0.0).sqrt();
            [cap.radius * sine, cap.radius * sine, cap.radius * cap.cosine]
        });
        let poses = InstancePoses3D::new()
            .with_translations(kept.iter().map(|(_, cap)| cap.center.to_array()))
            .with_quaternions(kept.iter().map(|(_, cap)| Quat::from_rotation_arc(Vec3::Z, cap.axis).to_array()))
            .with_scales(sizes);
        let values = values::number(values::triangles(&triangles), "half_angle_degrees", &angles);
        let pose = transform(&body.surface.pose);
        let rows: [&dyn AsComponents; 4] = [&unit_cone(), &poses, &values, &pose];
        writer.passing_row(path([Layer::Cones.name(), &shown.names.of(body.surface.entity)]), &rows);
    }
}

/// Draws triangles without shared vertices, each in its own color. `faces` returns the colors and numbers of the given
/// triangles.
fn draw_faces(
    writer: &mut TickWriter,
    layer: Layer,
    level: LevelOfDetail,
    shown: &Shown,
    faces: impl Fn(Caps, &[u32]) -> (Vec<Color>, AnyValues),
) {
    let carrying = shown.bodies.iter().filter_map(|body| body.caps.map(|caps| (body, caps)));
    let wanted: Vec<_> = carrying.map(|(body, caps)| (body, caps, body.triangles(level, shown.touches))).collect();
    let count = wanted.iter().map(|(.., triangles)| triangles.len()).sum();
    let filled = wanted.iter().filter(|(.., triangles)| !triangles.is_empty()).count();
    let mut share = writer.share(layer, count, 3 * (12 + 4) + 4 + 4, filled, row_bytes(6));
    for (body, caps, triangles) in wanted {
        let kept: Vec<u32> = share.places(triangles.len()).into_iter().map(|place| triangles[place]).collect();
        if kept.is_empty() {
            continue;
        }
        let (face_colors, values) = faces(caps, &kept);
        let corners: Vec<[Vec3; 3]> = kept.iter().map(|&triangle| body.corners(triangle)).collect();
        // Without normals the viewer does not shade, which would change the colors.
        let mesh = Mesh3D::update_fields()
            .with_vertex_positions(corners.iter().flatten().map(Vec3::to_array))
            .with_vertex_colors(face_colors.into_iter().flat_map(|color| [color; 3]));
        let pose = transform(&body.surface.pose);
        let rows: [&dyn AsComponents; 3] = [&mesh, &values, &pose];
        writer.passing_row(path([layer.name(), &shown.names.of(body.surface.entity)]), &rows);
    }
}

/// Draws the upper levels of trees, and the regions that their traversals leave out.
fn draw_trees(writer: &mut TickWriter, levels: u32, shown: &Shown) {
    let center_and_half = |bounds: &Aabb| {
        let half_size = (bounds.max - bounds.min) * 0.5;
        [(bounds.min + half_size).to_array(), half_size.to_array()]
    };
    let has_flat_regions = |body: &Body| levels > 0 && !body.flat_regions.is_empty();
    let nodes: Vec<Vec<Vec<[[f32; 3]; 2]>>> = shown
        .bodies
        .iter()
        .map(|body| {
            let mut nodes: Vec<Vec<[[f32; 3]; 2]>> = Vec::new();
            if let Some(tree) = body.tree {
                tree.for_each_node(|level, bounds| {
                    if level < levels {
                        let level = level as usize;
                        nodes.resize_with(nodes.len().max(level + 1), Vec::new);
                        nodes[level].push(center_and_half(bounds));
                    }
                });
            }
            if has_flat_regions(body) {
                nodes.push(body.flat_regions.iter().map(center_and_half).collect());
            }
            nodes
        })
        .collect();
    let count = nodes.iter().flatten().map(Vec::len).sum();
    let mut share = writer.share(Layer::Tree, count, 12 + 12, nodes.iter().map(Vec::len).sum(), row_bytes(7));
    for (body, nodes) in shown.bodies.iter().zip(nodes) {
        let (name, pose) = (shown.names.of(body.surface.entity), transform(&body.surface.pose));
        let level_count = nodes.len() - usize::from(has_flat_regions(body));
        for (level, nodes) in nodes.iter().enumerate() {
            let kept: Vec<[[f32; 3]; 2]> = share.places(nodes.len()).into_iter().map(|place| nodes[place]).collect();
            if kept.is_empty() {
                continue;
            }
            let (group, color) = if level < level_count {
                (format!("level {level:02}"), colors::LEVELS[level % colors::LEVELS.len()])
            } else {
                ("flat regions".to_owned(), colors::GREEN)
            };
            let boxes =
                Boxes3D::from_centers_and_half_sizes(kept.iter().map(|node| node[0]), kept.iter().map(|node| node[1]))
                    .with_colors([color])
                    .with_fill_mode(FillMode::MajorWireframe)
                    .with_radii([colors::THIN]);
            let rows: [&dyn AsComponents; 2] = [&boxes, &pose];
            writer.passing_row(path([Layer::Tree.name(), &name, &group]), &rows);
        }
    }
}
