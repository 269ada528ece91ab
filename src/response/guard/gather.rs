//! Which meshes and which pairs of them the guard looks at in a tick.

use std::sync::Arc;

use bevy_ecs::prelude::*;

use super::{
    Guard,
    mesh::{Kept, LEAST_SHARE, Mesh, MeshName, MeshPair, SURFACE, plane_under},
    ways::turn_between,
};
use crate::{
    kernel::{
        exact::rigid_shape::{ShapeGeometry, boundary_topology},
        mesh::topology::SurfaceTopology,
        simd::parallel::{Parallel, Sequential, Team},
    },
    response::{particles::Particles, scene::Scene},
    surface::{ActiveShape, FilterSide},
};

/// Whether more than one thread pays off for the meshes of a tick.
pub(in crate::response) fn is_large(scene: &Scene<'_, '_>) -> bool {
    let moving = scene.active.surfaces.iter().filter(|surface| scene.motions.course(surface.entity).is_some());
    scene.is_any_swept() && moving.map(|surface| surface.topology.triangles().len()).sum::<usize>() >= LEAST_SHARE
}

impl Guard {
    /// Collects the meshes of this tick, and the pairs that are close enough to collide.
    pub(super) fn gather(
        &mut self,
        team: &dyn Team,
        particles: &Particles,
        scene: &Scene<'_, '_>,
        first: impl Fn(Entity) -> Option<usize>,
    ) {
        self.by_entity.clear();
        for surface in &scene.active.surfaces {
            let Ok((positions, ..)) = scene.positions.get(surface.entity) else { continue };
            let first = first(surface.entity);
            let name = MeshName { entity: surface.entity, part: SURFACE };
            let mut kept = self.kept.remove(&name).unwrap_or_default();
            let stale = match scene.motions.course(surface.entity) {
                _ if first.is_some() => true,
                Some(course) => {
                    let stands = [&course.now, &course.ahead];
                    let poses = [&course.now.pose, course.end()];
                    kept.obstacle.move_on(stands.map(|stand| &*stand.positions), poses);
                    true
                }
                None => kept.obstacle.rest(&positions.0, positions.last_changed(), &surface.pose),
            };
            self.by_entity.insert(surface.entity, self.meshes.len());
            self.meshes.push(Mesh {
                name,
                topology: Arc::clone(&surface.topology),
                layers: surface.layers,
                filter: FilterSide::of_surface(surface),
                thickness: f64::from(surface.thickness),
                vertex_thickness: surface.vertex_thickness.clone().map(|list| (list, surface.pose.scale())),
                radius: 0.0,
                meets_itself: surface.self_collision,
                // Methods that are not exact do not list all touching pairs.
                is_exact: surface.method.is_exact(),
                shape: None,
                first,
                obstacle: kept.obstacle,
                is_guarded: first.is_some() && scene.is_swept(surface.entity),
                reaches: kept.reaches,
                tree: kept.tree,
                stale,
            });
        }
        for shape in &scene.active.shapes {
            self.gather_shape(particles, scene, shape);
        }
        self.reach(scene);
        self.follow_all(team, particles);
        self.pair_meshes(scene);
    }

    /// Brings the trees of all meshes up to date.
    fn follow_all(&mut self, team: &dyn Team, particles: &Particles) {
        let is_shared = |mesh: &&mut Mesh| mesh.stale && mesh.is_large();
        let others = self.meshes.iter_mut().filter(|mesh| !is_shared(mesh));
        team.run_tasks(others, usize::MAX, |mesh| {
            if mesh.stale {
                mesh.follow_ways(&Sequential, particles);
            } else {
                mesh.tree.update_reaches(&mesh.reaches);
            }
        });
        for mesh in self.meshes.iter_mut().filter(is_shared) {
            mesh.follow_ways(team, particles);
        }
    }

    fn gather_shape(&mut self, particles: &Particles, scene: &Scene<'_, '_>, shape: &ActiveShape) {
        let poses = scene.poses(shape);
        let poses = poses.each_ref();
        let mesh = |name, topology: &Arc<SurfaceTopology>, radius, kept: Kept| Mesh {
            name,
            topology: Arc::clone(topology),
            layers: shape.layers,
            filter: FilterSide::of_shape(shape),
            thickness: radius,
            vertex_thickness: None,
            radius,
            meets_itself: false,
            is_exact: true,
            shape: Some((Arc::clone(&shape.geometry), poses[0].inverse())),
            first: None,
            obstacle: kept.obstacle,
            is_guarded: false,
            reaches: kept.reaches,
            tree: kept.tree,
            stale: true,
        };
        if let ShapeGeometry::HalfSpace { normal } = &*shape.geometry {
            let name = MeshName { entity: shape.entity, part: 0 };
            let mut kept = self.kept.remove(&name).unwrap_or_default();
            let Some(ends) = plane_under(particles, *normal, poses) else { return };
            [kept.obstacle.start, kept.obstacle.end] = ends;
            kept.obstacle.turn = turn_between(poses);
            self.meshes.push(mesh(name, boundary_topology(), 0.0, kept));
        }
        for (part, solid) in (0..).zip(&*shape.parts) {
            let name = MeshName { entity: shape.entity, part };
            let mut kept = self.kept.remove(&name).unwrap_or_default();
            kept.obstacle.move_on([&solid.positions; 2], poses);
            kept.obstacle.turn = turn_between(poses);
            let radius = solid.radius * shape.pose.scale();
            self.meshes.push(mesh(name, &solid.topology, radius, kept));
        }
    }

    /// Sets how far each triangle can move without a collision, from the distances that detection found. Surfaces that
    /// do not touch are farther apart than the contact distance, which is the sum of both thicknesses there. A shape has no
    /// reach of its own: its distance from a surface is the surface's reach alone.
    fn reach(&mut self, scene: &Scene<'_, '_>) {
        let Self { meshes, by_entity, .. } = self;
        for mesh in &mut *meshes {
            let clear = match mesh.name.part {
                SURFACE => 2.0 * mesh.thickness,
                _ => 0.0,
            };
            let nearest = || scene.nearest(mesh.name.entity).unwrap_or(clear).min(clear);
            mesh.reach_all(if mesh.is_exact { clear } else { nearest() });
        }
        for (sides, touching) in scene.touching() {
            let places = sides.map(|side| by_entity.get(&side).copied());
            // Only lists that involve a guarded body matter. Some lists are computed on first read.
            if !places.iter().flatten().any(|&place| meshes[place].is_guarded) {
                continue;
            }
            for pair in touching.iter() {
                for (place, triangle) in places.into_iter().zip([pair.triangle_a, pair.triangle_b]) {
                    if let Some(place) = place {
                        meshes[place].reach_less(triangle, pair.distance);
                    }
                }
            }
        }
    }

    pub(super) fn pair_meshes(&mut self, scene: &Scene<'_, '_>) {
        let Self { meshes, pairs, bounds, tree, places, .. } = self;
        bounds.clear();
        bounds.extend(meshes.iter().map(|mesh| mesh.tree.bounds_at_rest().grown(mesh.thickness as f32)));
        tree.rebuild(bounds);
        places.clear();
        tree.self_pairs(places);
        places.extend((0..).zip(&*meshes).filter(|(_, mesh)| mesh.meets_itself).map(|(place, _)| [place, place]));
        places.sort_unstable();
        pairs.clear();
        for &pair in &*places {
            let places = pair.map(|place| place as usize);
            let [mesh, other] = places.map(|place| &meshes[place]);
            let may_meet = pair[0] == pair[1] || mesh.layers.interacts_with(other.layers);
            let is_any_fast = mesh.tree.is_any_fast(&other.tree);
            let is_any_asked = mesh.tree.asked_count() + other.tree.asked_count() > 0;
            if may_meet && is_any_fast && is_any_asked && (mesh.is_guarded || other.is_guarded) {
                pairs.push(MeshPair::new(scene, places, mesh, other));
            }
        }
    }
}
