//! Draws per-triangle data of surfaces: spheres, cones, curvature, recipe ages, and trees.
//!
//! Everything is drawn in the surface's own frame, as the stages store it, together with the pose.

use std::f32::consts::TAU;

use glam::{Quat, Vec3};
use rerun::{AnyValues, AsComponents, Boxes3D, Color, Ellipsoids3D, FillMode, InstancePoses3D, Mesh3D, Transform3D};

use super::{
    colors,
    recorder::{Layer, TickWriter, path, row_bytes},
    settings::{LevelOfDetail, RerunSettings},
    tick::{Detected, Names, Touches, transform},
    values,
};
use crate::{
    detection::SurfaceState,
    kernel::{
        bvh::tree::BoxTree,
        spheres::{
            circumsphere::{Ball, OffsetSpheres},
            cone::{Cap, SafetyCones},
            curvature::Curvatures,
        },
    },
    surface::{ActiveSurface, ContactMethod},
};

/// Number of corners of the circle that a cone cuts out of its sphere.
const RIM_CORNERS: usize = 16;

/// A surface with the results of the stages in this tick.
struct Drawn<'a> {
    place: usize,
    surface: &'a ActiveSurface,
    name: String,
    pose: Transform3D,
    positions: &'a [Vec3],
    /// Empty if no pair was tested with balls.
    balls: &'a [Ball],
    /// `None` if no pair was tested with offset spheres.
    caps: Option<Caps<'a>>,
    /// `None` if the tree is not up to date in this tick.
    tree: Option<&'a BoxTree>,
}

#[derive(Clone, Copy)]
struct Caps<'a> {
    curvature: &'a Curvatures,
    spheres: &'a OffsetSpheres,
    cones: &'a SafetyCones,
}

impl Drawn<'_> {
    /// The cap of a triangle, and for a sheet the cap on its other side.
    fn caps(&self, triangle: u32) -> impl Iterator<Item = Cap> {
        let both = self.caps.map(|Caps { spheres, cones, .. }| {
            let cap = Cap::of(spheres, cones, triangle as usize);
            let behind = cap.in_plane_center() - cap.axis;
            [Some(cap), (!self.surface.one_sided && cap.height > 0.0).then(|| cap.facing(behind))]
        });
        both.into_iter().flatten().flatten()
    }

    fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.surface.topology.triangles()[triangle as usize].map(|vertex| self.positions[vertex as usize])
    }
}

/// Draws all layers of this module.
pub(super) fn draw(
    writer: &mut TickWriter,
    detected: &Detected,
    settings: &RerunSettings,
    names: &Names,
    touches: &Touches,
) {
    let by_balls = detected.used_by(ContactMethod::BoundingSphere);
    let by_caps = detected.used_by(ContactMethod::Circumsphere);
    let mut surfaces = Vec::new();
    for (place, surface) in detected.active.surfaces.iter().enumerate() {
        let Some((positions, carried)) = detected.surface(surface) else { continue };
        surfaces.push(Drawn {
            place,
            surface,
            name: names.of(surface.entity),
            pose: transform(&surface.pose),
            positions,
            balls: if by_balls[place] { carried.balls } else { &[] },
            caps: by_caps[place].then_some(Caps {
                curvature: carried.curvature,
                spheres: carried.spheres,
                cones: carried.cones,
            }),
            tree: detected.states.get(surface.entity).filter(|state| state.is_tree_current()).map(SurfaceState::tree),
        });
    }
    draw_spheres(writer, settings.spheres, touches, &surfaces);
    draw_cones(writer, settings.cones, touches, &surfaces);
    let threshold = detected.settings.recipe().curvature_threshold;
    draw_faces(writer, Layer::Curvature, settings.curvature, touches, &surfaces, |caps, kept| {
        let of = |numbers: &[f32]| kept.iter().map(|&triangle| numbers[triangle as usize]).collect::<Vec<_>>();
        let curvatures = of(&caps.curvature.curvatures);
        // Normalized like the curvature factor: at 1 and −1 the sphere is no longer offset.
        let relative = |((curvature, radius), height): ((&f32, f32), f32)| {
            curvature * (radius * radius - height * height).max(0.0).sqrt() / threshold
        };
        let shapes = curvatures.iter().zip(of(&caps.spheres.radii)).zip(of(&caps.spheres.heights));
        let face_colors = shapes.map(relative).map(colors::curvature).collect();
        (face_colors, values::number(values::triangles(kept), "curvature", &curvatures))
    });
    draw_faces(writer, Layer::RecipeAge, settings.recipe_age, touches, &surfaces, |caps, kept| {
        let all: Vec<u32> = caps.spheres.recipe_ages().collect();
        // Osculating spheres have no recipes, and are made in every tick.
        let age = |triangle: u32| all.get(triangle as usize).copied().unwrap_or(0);
        let ages: Vec<u32> = kept.iter().map(|&triangle| age(triangle)).collect();
        let face_colors = ages.iter().copied().map(colors::age).collect();
        (face_colors, values::whole(values::triangles(kept), "recipe_age", &ages))
    });
    draw_trees(writer, settings.tree_levels, &surfaces);
}

fn draw_spheres(writer: &mut TickWriter, level: LevelOfDetail, touches: &Touches, surfaces: &[Drawn]) {
    let spheres: Vec<(Vec<Ball>, Vec<u32>)> = surfaces
        .iter()
        .map(|drawn| {
            let wanted = touches.triangles(level, drawn.place);
            let mut spheres = (Vec::new(), Vec::new());
            for triangle in wanted {
                let balls = drawn.balls.get(triangle as usize).copied();
                let offset = drawn.caps(triangle).map(|cap| Ball { center: cap.center, radius: cap.radius });
                for ball in offset.chain(balls) {
                    spheres.0.push(ball);
                    spheres.1.push(triangle);
                }
            }
            spheres
        })
        .collect();
    let count = spheres.iter().map(|(balls, _)| balls.len()).sum();
    let filled = spheres.iter().filter(|(balls, _)| !balls.is_empty()).count();
    let mut share = writer.share(Layer::Spheres, count, 12 + 12 + 4, filled, row_bytes(8));
    for (drawn, (balls, triangles)) in surfaces.iter().zip(spheres) {
        let kept: Vec<usize> = share.places(balls.len());
        if kept.is_empty() {
            continue;
        }
        let ellipsoids = Ellipsoids3D::from_centers_and_radii(
            kept.iter().map(|&place| balls[place].center.to_array()),
            kept.iter().map(|&place| balls[place].radius),
        )
        .with_colors([colors::SPHERES])
        .with_fill_mode(FillMode::MajorWireframe)
        .with_line_radii([colors::THIN]);
        let triangles: Vec<u32> = kept.iter().map(|&place| triangles[place]).collect();
        let rows: [&dyn AsComponents; 3] = [&ellipsoids, &values::triangles(&triangles), &drawn.pose];
        writer.passing_row(path([Layer::Spheres.name(), &drawn.name]), &rows);
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
        .with_albedo_factor(colors::CONES.0)
}

/// Draws cones from the center of their sphere to the circle that they cut out of it.
fn draw_cones(writer: &mut TickWriter, level: LevelOfDetail, touches: &Touches, surfaces: &[Drawn]) {
    let cones: Vec<Vec<(u32, Cap)>> = surfaces
        .iter()
        .map(|drawn| {
            let wanted = touches.triangles(level, drawn.place).into_iter();
            // A cone that contains every direction has no shape.
            wanted
                .flat_map(|triangle| drawn.caps(triangle).map(move |cap| (triangle, cap)))
                .filter(|(_, cap)| cap.cosine > SafetyCones::EVERYWHERE)
                .collect()
        })
        .collect();
    let count = cones.iter().map(Vec::len).sum();
    let filled = cones.iter().filter(|cones| !cones.is_empty()).count();
    // The unit cone that the poses refer to is part of the row.
    let mut share = writer.share(Layer::Cones, count, 12 + 16 + 12 + 4 + 4, filled, row_bytes(12));
    for (drawn, cones) in surfaces.iter().zip(cones) {
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
        let rows: [&dyn AsComponents; 4] = [&unit_cone(), &poses, &values, &drawn.pose];
        writer.passing_row(path([Layer::Cones.name(), &drawn.name]), &rows);
    }
}

/// Draws triangles without shared vertices, each in its own color. `faces` returns the colors and numbers of the given
/// triangles.
fn draw_faces(
    writer: &mut TickWriter,
    layer: Layer,
    level: LevelOfDetail,
    touches: &Touches,
    surfaces: &[Drawn],
    faces: impl Fn(Caps, &[u32]) -> (Vec<Color>, AnyValues),
) {
    let carrying = surfaces.iter().filter_map(|drawn| drawn.caps.map(|caps| (drawn, caps)));
    let wanted: Vec<_> = carrying.map(|(drawn, caps)| (drawn, caps, touches.triangles(level, drawn.place))).collect();
    let count = wanted.iter().map(|(.., triangles)| triangles.len()).sum();
    let filled = wanted.iter().filter(|(.., triangles)| !triangles.is_empty()).count();
    let mut share = writer.share(layer, count, 3 * (12 + 4) + 4 + 4, filled, row_bytes(6));
    for (drawn, caps, triangles) in wanted {
        let kept: Vec<u32> = share.places(triangles.len()).into_iter().map(|place| triangles[place]).collect();
        if kept.is_empty() {
            continue;
        }
        let (face_colors, values) = faces(caps, &kept);
        let corners: Vec<[Vec3; 3]> = kept.iter().map(|&triangle| drawn.corners(triangle)).collect();
        // Without normals the viewer does not shade, which would change the colors.
        let mesh = Mesh3D::update_fields()
            .with_vertex_positions(corners.iter().flatten().map(Vec3::to_array))
            .with_vertex_colors(face_colors.into_iter().flat_map(|color| [color; 3]));
        let rows: [&dyn AsComponents; 3] = [&mesh, &values, &drawn.pose];
        writer.passing_row(path([layer.name(), &drawn.name]), &rows);
    }
}

fn draw_trees(writer: &mut TickWriter, levels: u32, surfaces: &[Drawn]) {
    let nodes: Vec<Vec<Vec<[[f32; 3]; 2]>>> = surfaces
        .iter()
        .map(|drawn| {
            let mut nodes: Vec<Vec<[[f32; 3]; 2]>> = Vec::new();
            if let Some(tree) = drawn.tree {
                tree.for_each_node(|level, bounds| {
                    if level < levels {
                        let level = level as usize;
                        nodes.resize_with(nodes.len().max(level + 1), Vec::new);
                        let half_size = (bounds.max - bounds.min) * 0.5;
                        nodes[level].push([(bounds.min + half_size).to_array(), half_size.to_array()]);
                    }
                });
            }
            nodes
        })
        .collect();
    let count = nodes.iter().flatten().map(Vec::len).sum();
    let mut share = writer.share(Layer::Tree, count, 12 + 12, nodes.iter().map(Vec::len).sum(), row_bytes(7));
    for (drawn, nodes) in surfaces.iter().zip(nodes) {
        for (level, nodes) in nodes.iter().enumerate() {
            let kept: Vec<[[f32; 3]; 2]> = share.places(nodes.len()).into_iter().map(|place| nodes[place]).collect();
            if kept.is_empty() {
                continue;
            }
            let boxes =
                Boxes3D::from_centers_and_half_sizes(kept.iter().map(|node| node[0]), kept.iter().map(|node| node[1]))
                    .with_colors([colors::LEVELS[level % colors::LEVELS.len()]])
                    .with_fill_mode(FillMode::MajorWireframe)
                    .with_radii([colors::THIN]);
            let rows: [&dyn AsComponents; 2] = [&boxes, &drawn.pose];
            writer.passing_row(path([Layer::Tree.name(), &drawn.name, &format!("level {level:02}")]), &rows);
        }
    }
}
