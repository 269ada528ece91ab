//! Panels that are bent, twisted, and pressed by a ball: as closed meshes of two layers, and as sheets.

use std::time::{Duration, Instant};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore,
    geometry::{FeatureKind, SurfaceTopology, thin_wall::ThinWalls},
    prelude::*,
    response::*,
};
use bevy_ecs::prelude::*;
use bevy_math::ops;
use bevy_time::Time;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, Panel, panel};
use circumsphere_truth::{exact_weld, touching_pairs_tree};
use glam::{DVec3, Quat, Vec3};

use super::{find, positions};

const TICKS: usize = 1000;
const TICK: f64 = 1.0 / 60.0;

/// How often brute force looks for crossings, in ticks.
const LOOKED_AT: usize = 50;

/// Half the length of the panel along x, at both ends of which it is held.
const HALF: f32 = 0.3;

/// A panel is stiffer than cloth.
const BEND: f32 = 1.0e2;

/// The body of the panel in an app of its own.
struct Held {
    app: App,
    body: Entity,
    ball: Entity,
    triangles: Vec<[u32; 3]>,
    /// The vertices at both ends, with their places at rest.
    ends: Vec<(usize, Vec3)>,
    /// Ticks in which some of its triangles cross.
    crossed: usize,
    most_crossings: usize,
    time: Duration,
}

impl Held {
    fn new(points: &[Vec3], triangles: &[[u32; 3]], density: f32, thickness: impl Bundle) -> Self {
        let mut app = App::new();
        app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update)));
        app.init_resource::<Time>();
        app.finish();
        app.cleanup();
        app.world_mut().resource_mut::<CircumsphereSettings>().threads = 1;
        let (surface, positions) = DeformableSurface::from_mesh(points, triangles).expect("the mesh is valid");
        let material = XpbdMaterial { area_density: density, bend_compliance: BEND, ..XpbdMaterial::CLOTH };
        let ends: Vec<(usize, Vec3)> =
            points.iter().copied().enumerate().filter(|(_, point)| point.x.abs() > HALF - 1.0e-4).collect();
        let pins = ends.iter().map(|&(vertex, _)| VertexId(vertex as u32));
        let body = XpbdBody::new(&surface, &positions, material).expect("the material is valid").pinned(pins);
        let body = app.world_mut().spawn((surface, positions, body, SelfCollision, thickness)).id();
        let ball = (RigidShape(SharedShape::ball(0.08)), Transform::from_xyz(0.02, -0.3, 0.01));
        let ball = app.world_mut().spawn(ball).id();
        Self {
            app,
            body,
            ball,
            triangles: triangles.to_vec(),
            ends,
            crossed: 0,
            most_crossings: 0,
            time: Duration::ZERO,
        }
    }

    fn positions(&self) -> &[Vec3] {
        &self.app.world().get::<SurfacePositions>(self.body).expect("it is a surface").0
    }

    /// Moves the ends and the ball, and ticks.
    fn tick(&mut self, tick: usize) {
        let phase = tick as f32 * TICK as f32;
        let closer = 0.5 - 0.5 * ops::cos(1.9 * phase);
        let [turn, press] = [ops::sin(1.3 * phase), ops::sin(2.3 * phase)];
        let world = self.app.world_mut();
        let mut positions = world.get_mut::<SurfacePositions>(self.body).expect("it is a surface");
        for &(vertex, rest) in &self.ends {
            let side = rest.x.signum();
            let turned = Quat::from_rotation_x(0.3 * turn * side) * rest;
            positions.0[vertex] = turned - Vec3::X * ((0.01 + 0.02 * closer) * side);
        }
        world.get_mut::<Transform>(self.ball).expect("it has a transform").translation.y = -0.08 + 0.05 * press;
        world.resource_mut::<Time>().advance_by(Duration::from_secs_f64(TICK));
        let start = Instant::now();
        self.app.update();
        self.time += start.elapsed();
        let pairs = self.app.world().resource::<ContactStore>().pairs();
        let own = pairs.iter().filter(|pair| pair.a == pair.b).flat_map(|pair| pair.contacts.iter());
        let crossings = own.filter(|contact| contact.features.kind() == FeatureKind::EdgeFace).count();
        self.crossed += usize::from(crossings > 0);
        self.most_crossings = self.most_crossings.max(crossings);
    }
}

fn exact(points: &[Vec3]) -> Vec<DVec3> {
    points.iter().map(|point| point.as_dvec3()).collect()
}

/// The number of pairs of triangles that cross or share a point, without neighbors at rest.
fn crossings(points: &[Vec3], triangles: &[[u32; 3]], rest: &[Vec3]) -> usize {
    touching_pairs_tree(&exact(points), triangles, &exact_weld(&exact(rest)), 0.0).len()
}

/// Runs a panel both ways, and checks the sheet. Returns how often brute force found that the two layers cross, and that the
/// original mesh does which follows the sheet.
fn compare(name: &str, mesh: &Mesh) -> [usize; 2] {
    let original = positions(mesh);
    let (walls, _) = find(mesh);
    assert!(walls.abstracted_area >= 0.95 * walls.area_before);
    let thickness = VertexThickness::new(walls.half_thickness.iter().copied());
    let mut sheet = Held::new(&walls.positions, &walls.triangles, 0.4, thickness);
    // Layers are 0.006 and 0.004 apart.
    let mut layers = Held::new(&original, &mesh.triangles, 0.2, SurfaceThickness::World(0.001));
    let mut follower = Follower::new(&walls, &original);
    let (mut of_layers, mut of_follower, mut farthest) = (0, 0, 0.0_f32);
    assert_eq!(crossings(&original, &mesh.triangles, &original), 0);
    for tick in 0..TICKS {
        let crossed_before = layers.crossed;
        sheet.tick(tick);
        layers.tick(tick);
        let start = Instant::now();
        follower.follow(&walls, sheet.positions());
        sheet.time += start.elapsed();
        if tick % LOOKED_AT == LOOKED_AT - 1 {
            assert_eq!(crossings(sheet.positions(), &sheet.triangles, &walls.positions), 0, "tick {tick}");
            of_follower += crossings(&follower.points, &mesh.triangles, &original);
        }
        // Between these ticks they may cross and part again. Detection says when to look.
        if tick % LOOKED_AT == LOOKED_AT - 1 || layers.crossed > crossed_before {
            of_layers += crossings(layers.positions(), &layers.triangles, &original);
        }
        let moved = sheet.positions().iter().zip(&walls.positions).map(|(now, rest)| now.distance(*rest));
        farthest = moved.fold(farthest, f32::max);
    }
    let milliseconds = |time: Duration| 1000.0 * time.as_secs_f64() / TICKS as f64;
    let share = sheet.time.as_secs_f64() / layers.time.as_secs_f64();
    println!(
        "{name}: {} triangles as a sheet {:.2} ms a tick, {} ticks with crossings, {of_follower} of what follows it; {} as \
         two layers {:.2} ms, {} ticks with up to {}; {share:.2} of its time",
        sheet.triangles.len(),
        milliseconds(sheet.time),
        sheet.crossed,
        layers.triangles.len(),
        milliseconds(layers.time),
        layers.crossed,
        layers.most_crossings,
    );
    assert!(farthest > 0.05, "it deforms: {farthest}");
    assert_eq!(sheet.crossed, 0, "ticks in which the sheet crosses itself");
    assert!(share <= 0.6, "{share}");
    [of_layers, of_follower]
}

/// The original mesh, moved along by the sheet as `DrivenMesh` does it.
struct Follower {
    points: Vec<Vec3>,
    topology: SurfaceTopology,
    #[cfg(feature = "mesh")]
    map: bevy_circumsphere::kernel::mesh::driven::DrivenMap,
}

impl Follower {
    fn new(walls: &ThinWalls, original: &[Vec3]) -> Self {
        let topology = SurfaceTopology::new(&walls.positions, &walls.triangles).expect("the sheet is a mesh");
        Self {
            points: original.to_vec(),
            #[cfg(feature = "mesh")]
            map: bevy_circumsphere::kernel::mesh::driven::DrivenMap::new(&topology, &walls.positions, original),
            topology,
        }
    }

    fn follow(&mut self, walls: &ThinWalls, sheet: &[Vec3]) {
        assert_eq!(self.topology.vertex_count(), walls.positions.len());
        #[cfg(feature = "mesh")]
        self.map.follow(&self.topology, sheet, &mut self.points);
        #[cfg(not(feature = "mesh"))]
        let _ = sheet;
    }
}

#[test]
fn a_ribbed_panel_as_a_sheet_does_not_cross_itself_where_its_two_layers_do() {
    let ribbed = Panel { longest_side: 0.02, ribs: [2, 0], rib_height: 0.03, ..Panel::default() };
    let [of_layers, _] = compare("ribbed panel", &panel(&ribbed));
    assert!(of_layers > 0, "the two layers cross");
}

#[test]
fn a_plate_that_follows_its_sheet_does_not_cross_itself() {
    let [_, of_follower] = compare("plate", &panel(&Panel { longest_side: 0.02, ..Panel::default() }));
    assert_eq!(of_follower, 0, "what follows the sheet crosses itself");
}
