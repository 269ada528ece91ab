//! Bodies whose layers touch at rest.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{Diagonals, grid};
use glam::Vec3;

use crate::world::World;

/// The gap between the layers at rest.
const GAP: f32 = 0.05;

/// One surface of two square layers over each other, each with an edge of 1 and this number of cells along it.
fn layers(cells: usize) -> (DeformableSurface, SurfacePositions) {
    let layer = grid(cells, cells, 1.0, 1.0, Diagonals::Alternating);
    let at = |height: f32| layer.positions.iter().map(move |&point| Vec3::from(point) + Vec3::Y * height);
    let positions: Vec<Vec3> = at(0.0).chain(at(GAP)).collect();
    let count = layer.positions.len() as u32;
    let upper = layer.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + count));
    let triangles: Vec<[u32; 3]> = layer.triangles.iter().copied().chain(upper).collect();
    DeformableSurface::from_mesh(&positions, &triangles).expect("the mesh is sound")
}

struct Layers {
    world: World,
    body: Entity,
}

impl Layers {
    /// Layers within the contact distance of 0.08, without gravity. `falling` is the velocity of the upper layer.
    fn new(cells: usize, is_sewn: bool, falling: f32, extra: impl Bundle) -> Self {
        let mut world = World::responding();
        world.app.world_mut().resource_mut::<XpbdSettings>().gravity = Vec3::ZERO;
        let (surface, positions) = layers(cells);
        let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::CLOTH };
        let mut made = XpbdBody::new(&surface, &positions, material).expect("the mesh can be a body");
        let count = positions.0.len() / 2;
        made.velocities[count..].fill(Vec3::NEG_Y * falling);
        let sewn = RestContactsIgnored::new(&surface, &positions.0, 2.0 * GAP).expect("the rest shape is sound");
        assert!(sewn.pairs().count() >= 2 * cells * cells, "each triangle is near those on the other side");
        let thickness = SurfaceThickness::World(0.04);
        let body = world.app.world_mut().spawn((surface, positions, made, thickness, SelfCollision, extra)).id();
        if is_sewn {
            world.insert(body, sewn);
        }
        Self { world, body }
    }

    /// The mean height of the upper layer over the lower one.
    fn gap(&self) -> f32 {
        let positions = &self.world.app.world().get::<SurfacePositions>(self.body).expect("it is a surface").0;
        let (lower, upper) = positions.split_at(positions.len() / 2);
        let height = |layer: &[Vec3]| layer.iter().map(|point| point.y).sum::<f32>() / layer.len() as f32;
        height(upper) - height(lower)
    }
}

#[test]
fn sewn_layers_stay_as_near_as_they_are() {
    for is_sewn in [false, true] {
        let mut layers = Layers::new(4, is_sewn, 0.0, ());
        (0..60).for_each(|_| layers.world.tick());
        // Without gravity, a layer that nothing pushes does not move, but for the rounding of a mean of 25 heights. Others
        // part to the contact distance.
        if is_sewn {
            assert!((layers.gap() - GAP).abs() < 25.0 * f32::EPSILON * GAP, "{}", layers.gap());
        } else {
            assert!(layers.gap() > 0.075, "{}", layers.gap());
        }
    }
}

#[test]
fn the_guard_lets_sewn_layers_pass() {
    for is_sewn in [false, true] {
        // 10 gaps in a tick. A body that meets itself in more places than it has vertices would not be guarded.
        let mut layers = Layers::new(1, is_sewn, 10.0 * GAP * 60.0, SweptCollision);
        layers.world.tick();
        let impacts = layers.world.app.world().resource::<XpbdDiagnostics>().impacts;
        if is_sewn {
            // At a constant velocity.
            assert!((layers.gap() + 9.0 * GAP).abs() < 1.0e-3, "{}", layers.gap());
            assert_eq!(impacts, 0);
        } else {
            assert!(layers.gap() > 0.0, "{}", layers.gap());
        }
    }
}
