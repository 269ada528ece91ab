//! Draws tetrahedra, and the vertices that lie in them with their ways out.

use bevy_ecs::{prelude::*, system::SystemParam};
use glam::Vec3;
use rerun::{AnyValues, Arrows3D, AsComponents, LineStrips3D, Radius};

use super::{
    colors,
    names::{ALL_PAIRS, MANY_PAIRS, Names, transform},
    recorder::{Layer, TickWriter, path, row_bytes},
    values,
};
use crate::{
    debug::LevelOfDetail,
    detection::{Containments, VertexContainment},
    kernel::mesh::ids::VertexId,
    response::XpbdBody,
    surface::{ActiveSurface, ActiveSurfaces, SurfacePositions, TetrahedralBody, first_non_finite},
};

/// Tetrahedral bodies, and what is in them.
#[derive(SystemParam)]
pub(super) struct Solids<'w, 's> {
    active: Res<'w, ActiveSurfaces>,
    /// If the plugin that finds them is there.
    containments: Option<Res<'w, Containments>>,
    bodies: Query<'w, 's, (&'static TetrahedralBody, &'static SurfacePositions, Option<&'static XpbdBody>)>,
}

impl Solids<'_, '_> {
    fn containments(&self) -> impl Iterator<Item = &VertexContainment> {
        self.containments.iter().flat_map(|containments| containments.iter())
    }

    /// A body with its positions, if they can be drawn.
    fn body(&self, entity: Entity) -> Option<(&TetrahedralBody, &[Vec3], Option<&XpbdBody>)> {
        let (inside, SurfacePositions(positions), body) = self.bodies.get(entity).ok()?;
        let is_whole = positions.len() == inside.topology().vertex_count() && first_non_finite(positions).is_none();
        is_whole.then_some((inside, positions.as_slice(), body))
    }

    /// A vertex of a body in the world.
    fn vertex(&self, entity: Entity, vertex: VertexId) -> Option<Vec3> {
        let surface = self.active.surfaces.iter().find(|surface| surface.entity == entity)?;
        let (_, positions, _) = self.body(entity)?;
        Some(surface.pose.transform_point(positions.get(vertex.index())?.as_dvec3()).as_vec3())
    }
}

/// A line along all edges of a tetrahedron. One of them twice: no line has each once.
const STRIP: [usize; 8] = [0, 1, 2, 0, 3, 1, 2, 3];

/// Bytes of a tetrahedron: the line, a color, and two numbers.
const BYTES: usize = 12 * STRIP.len() + 4 + 4 + 8;

/// Bytes of a containment: an arrow, three numbers, and a text.
const CONTAINMENT_BYTES: usize = 24 + 12 + 8;

/// A change of volume by this share has full color.
const FULL_COLOR: f32 = 0.3;

/// Visible over a mesh from afar, in points on the screen.
const LINE: Radius = Radius(rerun::datatypes::Float32(-1.5));

/// Draws tetrahedra, colored by how their volume has changed: all, or those that contain something or are inverted.
pub(super) fn draw(writer: &mut TickWriter, solids: &Solids, level: LevelOfDetail, names: &Names) {
    if level == LevelOfDetail::Off {
        return;
    }
    let bodies: Vec<Drawn> =
        solids.active.surfaces.iter().filter_map(|surface| Drawn::new(solids, surface, level)).collect();
    let count = bodies.iter().map(|body| body.wanted.len()).sum();
    let mut share = writer.share(Layer::Tetrahedra, count, BYTES, bodies.len(), row_bytes(10));
    for Drawn { surface, positions, tetrahedra, volumes, wanted } in &bodies {
        let kept: Vec<u32> = share.places(wanted.len()).into_iter().map(|place| wanted[place]).collect();
        if kept.is_empty() {
            continue;
        }
        let strip = |&tetrahedron: &u32| {
            let corners = tetrahedra[tetrahedron as usize];
            STRIP.map(|corner| positions[corners[corner] as usize].to_array())
        };
        let volume_of = |tetrahedron: u32| volumes.get(tetrahedron as usize).copied();
        let color = |&tetrahedron: &u32| match volume_of(tetrahedron) {
            Some(volume) if volume > 0.0 => colors::curvature((volume - 1.0) / FULL_COLOR),
            Some(_) => colors::PENETRATING,
            None => colors::OUTLINES,
        };
        let lines =
            LineStrips3D::new(kept.iter().map(strip)).with_colors(kept.iter().map(color)).with_radii([colors::THIN]);
        let numbers = values::whole(AnyValues::default(), "tetrahedron", &kept);
        let shares: Vec<f32> = kept.iter().filter_map(|&tetrahedron| volume_of(tetrahedron)).collect();
        let numbers = if shares.is_empty() { numbers } else { values::number(numbers, "volume", &shares) };
        let rows: [&dyn AsComponents; 3] = [&lines, &numbers, &transform(&surface.pose)];
        writer.passing_row(path([Layer::Tetrahedra.name(), &names.of(surface.entity)]), &rows);
    }
}

/// A body whose tetrahedra are drawn.
struct Drawn<'a> {
    surface: &'a ActiveSurface,
    positions: &'a [Vec3],
    tetrahedra: &'a [[u32; 4]],
    /// The volume of each relative to that at rest; empty if the rest shape is not known.
    volumes: Vec<f32>,
    wanted: Vec<u32>,
}

impl<'a> Drawn<'a> {
    /// `None` if nothing of the surface is drawn.
    fn new(solids: &'a Solids, surface: &'a ActiveSurface, level: LevelOfDetail) -> Option<Self> {
        let (inside, positions, body) = solids.body(surface.entity)?;
        let tetrahedra = inside.topology().tetrahedra();
        let volumes: Vec<f32> = body.map_or_else(Vec::new, |body| body.relative_volumes(positions).collect());
        let volumes = if volumes.len() == tetrahedra.len() { volumes } else { Vec::new() };
        let mut is_wanted = vec![level == LevelOfDetail::All; tetrahedra.len()];
        for (is_wanted, &volume) in is_wanted.iter_mut().zip(&volumes) {
            *is_wanted |= volume <= 0.0;
        }
        for found in solids.containments().filter(|found| found.container == surface.entity) {
            is_wanted[found.tetrahedron.index()] = true;
        }
        let wanted: Vec<u32> =
            (0..).zip(is_wanted).filter(|(_, is_wanted)| *is_wanted).map(|(place, _)| place).collect();
        (!wanted.is_empty()).then_some(Self { surface, positions, tetrahedra, volumes, wanted })
    }
}

/// Draws an arrow from every vertex in a tetrahedral body to the body's surface.
pub(super) fn draw_containments(writer: &mut TickWriter, solids: &Solids, names: &Names) {
    let all: Vec<&VertexContainment> = solids.containments().collect();
    let is_same = |one: &&VertexContainment, other: &&VertexContainment| {
        (one.body, one.container) == (other.body, other.container)
    };
    let lists: Vec<&[&VertexContainment]> = all.chunk_by(is_same).collect();
    let lists = if lists.len() > MANY_PAIRS { vec![all.as_slice()] } else { lists };
    let mut share = writer.share(Layer::Penetrations, all.len(), CONTAINMENT_BYTES, lists.len(), row_bytes(8));
    let name_of = |found: &VertexContainment| {
        let is_own = found.body == found.container;
        if is_own {
            names.of_pair([found.body; 2])
        } else {
            format!("{} in {}", names.of(found.body), names.of(found.container))
        }
    };
    let is_mixed = lists.len() == 1 && all.first().zip(all.last()).is_some_and(|(one, other)| !is_same(one, other));
    for list in lists {
        let kept = share.places(list.len()).into_iter().map(|place| list[place]);
        let arrows: Vec<(&VertexContainment, [f32; 3])> =
            kept.filter_map(|found| Some((found, solids.vertex(found.body, found.vertex)?.to_array()))).collect();
        let Some((first, _)) = arrows.first() else { continue };
        let ways = arrows.iter().map(|(found, _)| (found.direction * found.depth).as_vec3().to_array());
        let ways = Arrows3D::from_vectors(ways)
            .with_origins(arrows.iter().map(|&(_, origin)| origin))
            .with_colors([colors::PENETRATING])
            .with_radii([LINE]);
        let whole = |values, name, number: fn(&VertexContainment) -> u32| {
            values::whole(values, name, &arrows.iter().map(|(found, _)| number(found)).collect::<Vec<_>>())
        };
        let numbers = whole(AnyValues::default(), "vertex", |found| found.vertex.0);
        let numbers = whole(numbers, "tetrahedron", |found| found.tetrahedron.0);
        let depths: Vec<f32> = arrows.iter().map(|(found, _)| found.depth as f32).collect();
        let mut numbers = values::number(numbers, "depth", &depths);
        let name = if is_mixed {
            let pairs: Vec<String> = arrows.iter().map(|(found, _)| name_of(found)).collect();
            numbers = values::texts(numbers, "pair", pairs.iter().map(String::as_str));
            ALL_PAIRS.to_owned()
        } else {
            name_of(first)
        };
        writer.passing_row(path([Layer::Penetrations.name(), "contained", &name]), &[&ways, &numbers]);
    }
}
