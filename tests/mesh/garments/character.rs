//! A skinned character that walks, in worlds that move bodies.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_asset::Assets;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_mesh::{
    Mesh, Mesh3d, VertexAttributeValues,
    skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
};
use bevy_time::Time;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{self, Character, CharacterFineness, character_skirt};
use circumsphere_truth::{touching_pairs_between_tree, triangles_cross};
use glam::{DVec3, Mat4, Quat, Vec3};

use crate::world::{add, indexed, positions};

/// Half the contact distance, in meters.
pub const THICKNESS: SurfaceThickness = SurfaceThickness::World(0.004);

pub const RINGS: usize = 8;
pub const SEGMENTS: usize = 20;

pub fn app() -> App {
    let mut app = crate::world::app();
    app.add_plugins(XpbdResponsePlugin::new(PostUpdate)).init_resource::<Time>();
    app
}

pub fn skirt() -> scenes::Mesh {
    character_skirt(RINGS, SEGMENTS)
}

/// The joints of a character.
#[derive(Clone, Copy)]
pub struct Joints([Entity; 2]);

impl Joints {
    pub const fn all(&self) -> [Entity; 2] {
        self.0
    }
}

/// A character, and how far it has walked.
pub struct Walker {
    pub character: Character,
    pub joints: Joints,
    pub time: f64,
}

impl Walker {
    pub fn new(app: &mut App, speed: f64) -> Self {
        let character = Character::new(CharacterFineness::Coarse, speed);
        let joints = Joints([0, 1].map(|_| app.world_mut().spawn(Transform::default()).id()));
        let walker = Self { character, joints, time: 0.0 };
        walker.pose(app);
        walker
    }

    /// Moves the joints to where they are at the walker's time.
    pub fn pose(&self, app: &mut App) {
        let poses = [self.character.torso_pose(self.time), self.character.leg_pose(self.time)];
        for (joint, (place, turn)) in self.joints.0.into_iter().zip(poses) {
            let pose = Transform::from_translation(place.into()).with_rotation(Quat::from_array(turn));
            app.world_mut().entity_mut(joint).insert(pose);
        }
    }

    pub fn walk(&mut self, app: &mut App) {
        self.time += 1.0 / 60.0;
        self.pose(app);
        tick(app);
    }

    /// The skin of the character, without a surface.
    pub fn skin(&self, app: &mut App) -> (Mesh3d, SkinnedMesh) {
        let shares: Vec<f32> = self.character.leg_shares().iter().map(|&share| share as f32).collect();
        self.skinned(app, indexed(self.character.rest()), &shares)
    }

    /// A mesh that moves with the joints: each vertex by the leg with its share.
    pub fn skinned(&self, app: &mut App, mesh: Mesh, leg_shares: &[f32]) -> (Mesh3d, SkinnedMesh) {
        let joints = VertexAttributeValues::Uint16x4(vec![[0, 1, 0, 0]; leg_shares.len()]);
        let weights: Vec<[f32; 4]> = leg_shares.iter().map(|&share| [1.0 - share, share, 0.0, 0.0]).collect();
        let mesh = mesh
            .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, joints)
            .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, weights);
        let (hip, _) = self.character.leg_pose(0.0);
        let bind_poses = vec![Mat4::IDENTITY, Mat4::from_translation(-Vec3::from(hip))];
        let mut assets = app.world_mut().resource_mut::<Assets<SkinnedMeshInverseBindposes>>();
        let inverse_bindposes = assets.add(SkinnedMeshInverseBindposes::from(bind_poses));
        (add(app, mesh), SkinnedMesh { inverse_bindposes, joints: self.joints.0.to_vec() })
    }

    pub fn spawn_skin(&self, app: &mut App) -> Entity {
        let skin = self.skin(app);
        app.world_mut().spawn((skin, SurfaceFromMesh::default(), THICKNESS)).id()
    }
}

pub fn spawn_garment(app: &mut App, mesh: impl Bundle, garment: XpbdGarment) -> Entity {
    app.world_mut().spawn((mesh, garment, THICKNESS)).id()
}

pub fn tick(app: &mut App) {
    app.world_mut().resource_mut::<Time>().advance_by(Duration::from_secs_f64(1.0 / 60.0));
    app.update();
}

/// Where the vertices of a surface are in the world. The entities of these tests do not move.
pub fn world_points(app: &App, entity: Entity) -> Vec<Vec3> {
    positions(app, entity)
}

pub fn is_worn(app: &App, entity: Entity) -> bool {
    let entity = app.world().entity(entity);
    entity.contains::<XpbdBody>() && entity.contains::<XpbdTethers>()
}

pub fn tethers(app: &App, entity: Entity) -> Vec<Tether> {
    app.world().get::<XpbdTethers>(entity).expect("it is worn").tethers.clone()
}

pub fn triangles(app: &App, entity: Entity) -> Vec<[u32; 3]> {
    app.world().get::<DeformableSurface>(entity).expect("it is a surface").topology().triangles().to_vec()
}

/// The pairs of triangles of two surfaces that cross, by an f64 reference, and the pairs that are nearer than 0.05.
pub fn crossings(app: &App, skin: Entity, garment: Entity) -> [usize; 2] {
    let at = [skin, garment]
        .map(|entity| -> Vec<DVec3> { world_points(app, entity).iter().map(|point| point.as_dvec3()).collect() });
    let of = [skin, garment].map(|entity| triangles(app, entity));
    let near = touching_pairs_between_tree(&at[0], &of[0], &at[1], &of[1], 0.05);
    let corners = |side: usize, triangle: u32| of[side][triangle as usize].map(|corner| at[side][corner as usize]);
    let cross = near.iter().filter(|pair| triangles_cross(&corners(0, pair.triangle_a), &corners(1, pair.triangle_b)));
    [cross.count(), near.len()]
}
