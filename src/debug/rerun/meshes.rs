//! Draws surfaces as meshes, colored where they touch, and rigid shapes as wireframes.
//!
//! Both stay in the viewer until they change. The triangles of a mesh are recorded once, and its positions, colors, and
//! pose in the ticks that change them. Positions are bitwise those of the surface's own frame.

use std::sync::Arc;

use bevy_ecs::entity::EntityHashMap;
use glam::Vec3;
use rerun::{AnyValues, AsComponents, EntityPath, LineStrips3D, Mesh3D};

use super::{
    colors::{self, Color},
    names::{Names, transform},
    recorder::{Layer, TickWriter, path},
    settings::RerunSettings,
    values,
};
use crate::{
    debug::{
        LevelOfDetail,
        tick::{Detected, Scene, Touch, Touches},
        wires::wires,
    },
    detection::is_same_list,
    kernel::{exact::rigid_shape::ShapeGeometry, mesh::topology::SurfaceTopology, pose::Pose},
    surface::{ActiveSurface, ThicknessList},
};

/// The meshes and shapes that the viewer currently shows.
#[derive(Default)]
pub(super) struct ShownBodies {
    meshes: EntityHashMap<ShownMesh>,
    shapes: EntityHashMap<ShownShape>,
    /// The place of the first surfaces, used to draw infinite shapes.
    scene: Option<Scene>,
}

/// A mesh as the viewer shows it.
struct ShownMesh {
    path: EntityPath,
    topology: Arc<SurfaceTopology>,
    /// The triangles that are shown, or `None` for all.
    triangles: Option<Vec<u32>>,
    pose: Pose,
    positions: Vec<Vec3>,
    colors: Vec<Color>,
    /// The thickness at each vertex, in the unit of the positions, if it varies.
    thickness: Option<Arc<ThicknessList>>,
}

struct ShownShape {
    path: EntityPath,
    geometry: Arc<ShapeGeometry>,
    pose: Pose,
    scene: Option<Scene>,
}

impl ShownBodies {
    pub(super) fn draw(
        &mut self,
        writer: &mut TickWriter,
        detected: &Detected,
        settings: &RerunSettings,
        names: &Names,
        touches: &Touches,
    ) {
        let mut before = std::mem::take(&mut self.meshes);
        for (place, surface) in detected.active.surfaces.iter().enumerate() {
            if settings.meshes == LevelOfDetail::Off {
                break;
            }
            let Some((positions, _)) = detected.surface(surface) else { continue };
            let path = path([Layer::Meshes.name(), &names.of(surface.entity)]);
            let next = ShownMesh::new(path, surface, place, positions, settings.meshes, touches);
            if next.is_empty() {
                // The viewer reports a mesh without triangles as an error.
                continue;
            }
            let shown = before.remove(&surface.entity);
            if let Some(shown) = next.draw(writer, shown) {
                self.meshes.insert(surface.entity, shown);
            }
        }
        self.scene = self.scene.or_else(|| Scene::of(&detected.active));
        let mut before_shapes = std::mem::take(&mut self.shapes);
        for shape in &detected.active.shapes {
            if !settings.shapes {
                break;
            }
            let path = path([Layer::Shapes.name(), &names.of(shape.entity)]);
            let next = ShownShape { path, geometry: Arc::clone(&shape.geometry), pose: shape.pose, scene: self.scene };
            let Ok(rigid) = detected.shapes.get(shape.entity) else { continue };
            let scene = Scene::of_shape(self.scene, &shape.pose);
            let wires = || wires(&rigid.0, scene.center, scene.reach);
            if let Some(shown) = next.draw(writer, before_shapes.remove(&shape.entity), wires) {
                self.shapes.insert(shape.entity, shown);
            }
        }
        let meshes = before.drain().map(|(_, shown)| shown.path);
        let mut gone: Vec<EntityPath> = meshes.chain(before_shapes.drain().map(|(_, shown)| shown.path)).collect();
        gone.sort_unstable();
        for path in gone {
            writer.remove(path);
        }
    }
}

impl ShownMesh {
    fn new(
        path: EntityPath,
        surface: &ActiveSurface,
        place: usize,
        positions: &[Vec3],
        level: LevelOfDetail,
        touches: &Touches,
    ) -> Self {
        let mut vertices = vec![Touch::None; positions.len()];
        for (corners, &touch) in surface.topology.triangles().iter().zip(&touches.triangles[place]) {
            for &vertex in corners {
                vertices[vertex as usize] = touch.max(vertices[vertex as usize]);
            }
        }
        Self {
            path,
            topology: Arc::clone(&surface.topology),
            triangles: (level == LevelOfDetail::NearContacts).then(|| touches.triangles(level, place)),
            pose: surface.pose,
            positions: positions.to_vec(),
            colors: vertices.into_iter().map(|touch| colors::touch(place, touch)).collect(),
            thickness: surface.vertex_thickness.clone(),
        }
    }

    fn is_empty(&self) -> bool {
        self.triangles.as_ref().is_some_and(Vec::is_empty)
    }

    /// Records what differs from `shown`. Returns the state that is shown afterwards.
    fn draw(self, writer: &mut TickWriter, shown: Option<Self>) -> Option<Self> {
        let shown = match shown {
            Some(shown) if shown.path != self.path => {
                writer.remove(shown.path);
                None
            }
            shown => shown,
        };
        let new = |same: &dyn Fn(&Self) -> bool| !shown.as_ref().is_some_and(same);
        let new_triangles =
            new(&|shown| Arc::ptr_eq(&shown.topology, &self.topology) && shown.triangles == self.triangles);
        let new_positions = new(&|shown| shown.positions == self.positions);
        let new_colors = new(&|shown| shown.colors == self.colors);
        let new_pose = new(&|shown| shown.pose == self.pose);
        let is_same = |shown: &Self| is_same_list(shown.thickness.as_ref(), self.thickness.as_ref());
        // Where there is none any more, an empty list replaces the last one.
        let new_thickness = shown.as_ref().map_or(self.thickness.is_some(), |shown| !is_same(shown));
        let thickness = self.thickness.as_ref().map_or(&[][..], |list| list.values());
        let (vertices, triangles) = (self.positions.len(), self.topology.triangles());
        let drawn = self.triangles.as_ref().map_or(triangles.len(), Vec::len);
        let bytes = 12 * drawn * usize::from(new_triangles)
            + (12 + 12) * vertices * usize::from(new_positions)
            + 4 * vertices * usize::from(new_colors)
            + 4 * thickness.len() * usize::from(new_thickness);
        let components = 2 * usize::from(new_triangles)
            + 2 * usize::from(new_positions)
            + usize::from(new_colors)
            + usize::from(new_thickness)
            + 2 * usize::from(new_pose);
        if !(new_triangles || new_positions || new_colors || new_pose || new_thickness) {
            return Some(self);
        }
        if !writer.fits(Layer::Meshes, bytes, components) {
            // A missing mesh is better than one at an old position.
            if let Some(shown) = shown {
                writer.remove(shown.path);
            }
            return None;
        }
        let mut mesh = Mesh3D::update_fields();
        if new_triangles {
            mesh = mesh.with_albedo_factor(colors::MESH_FACTOR);
            mesh = match &self.triangles {
                Some(kept) => mesh.with_triangle_indices(kept.iter().map(|&kept| triangles[kept as usize])),
                None => mesh.with_triangle_indices(triangles.iter().copied()),
            };
        }
        if new_positions {
            let normals = vertex_normals(&self.positions, triangles);
            mesh = mesh
                .with_vertex_positions(self.positions.iter().map(Vec3::to_array))
                .with_vertex_normals(normals.iter().map(Vec3::to_array));
        }
        if new_colors {
            mesh = mesh.with_vertex_colors(self.colors.iter().copied());
        }
        let pose = transform(&self.pose);
        let thickness = values::number(AnyValues::default(), "thickness", thickness);
        let mut rows: Vec<&dyn AsComponents> = vec![&mesh];
        if new_pose {
            rows.push(&pose);
        }
        if new_thickness {
            rows.push(&thickness);
        }
        writer.row(self.path.clone(), &rows);
        Some(self)
    }
}

/// Normals for shading only: area-weighted means of the face normals.
fn vertex_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|vertex| positions[vertex as usize]);
        let normal = (b - a).cross(c - a);
        for &vertex in corners {
            normals[vertex as usize] += normal;
        }
    }
    for normal in &mut normals {
        *normal = normal.normalize_or_zero();
    }
    normals
}

impl ShownShape {
    fn draw(
        self,
        writer: &mut TickWriter,
        shown: Option<Self>,
        wires: impl FnOnce() -> Vec<Vec<[f32; 3]>>,
    ) -> Option<Self> {
        let same = |shown: &Self| {
            Arc::ptr_eq(&shown.geometry, &self.geometry) && shown.path == self.path && shown.scene == self.scene
        };
        let is_new = !shown.as_ref().is_some_and(same);
        if !is_new && shown.as_ref().is_some_and(|shown| shown.pose == self.pose) {
            return Some(self);
        }
        let wires = if is_new { wires() } else { Vec::new() };
        if !writer.fits(Layer::Shapes, wires.iter().map(|wire| 4 + 12 * wire.len()).sum(), 5) {
            if let Some(shown) = shown {
                writer.remove(shown.path);
            }
            return None;
        }
        if let Some(shown) = shown.filter(|shown| shown.path != self.path) {
            writer.remove(shown.path);
        }
        let lines = LineStrips3D::new(wires).with_colors([colors::SHAPES]).with_radii([colors::THIN]);
        let pose = transform(&self.pose);
        if is_new {
            writer.row(self.path.clone(), &[&lines, &pose]);
        } else {
            writer.row(self.path.clone(), &[&pose]);
        }
        Some(self)
    }
}
