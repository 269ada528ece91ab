//! The scenes on which broad phases differ.

use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, crumpled_sheet, grid, icosphere, merge},
};
use glam::{Quat, Vec3};

/// A surface of a scene.
pub struct Body {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    pub place: Transform,
    /// Where each vertex moves to and fro, in mean edges of its surroundings.
    directions: Vec<Vec3>,
}

pub struct Scene {
    pub name: &'static str,
    pub bodies: Vec<Body>,
    /// Whether the bodies meet themselves.
    pub meets_itself: bool,
}

impl Body {
    fn new(mesh: &Mesh, place: Transform, random: &mut Random) -> Self {
        let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from).collect();
        // The shortest edge at each vertex, so that small triangles keep their shape.
        let mut edges = vec![f32::INFINITY; positions.len()];
        for &[a, b, c] in &mesh.triangles {
            for [from, to] in [[a, b], [b, c], [c, a]].map(|edge| edge.map(|vertex| vertex as usize)) {
                let length = positions[from].distance(positions[to]);
                edges[from] = edges[from].min(length);
                edges[to] = edges[to].min(length);
            }
        }
        let directions = edges.iter().map(|edge| {
            Vec3::new(random.signed_unit(), random.signed_unit(), random.signed_unit()).normalize_or_zero() * *edge
        });
        Self { directions: directions.collect(), positions, triangles: mesh.triangles.clone(), place }
    }

    /// The positions in a tick: every second one, all vertices have moved by `motion` of an edge.
    pub fn moved(&self, motion: f32, tick: usize) -> impl Iterator<Item = Vec3> {
        let motion = if tick % 2 == 1 { motion } else { 0.0 };
        self.positions.iter().zip(&self.directions).map(move |(position, direction)| position + direction * motion)
    }
}

/// All scenes, of about so many triangles each.
pub fn scenes(triangles: usize) -> Vec<Scene> {
    let mut random = Random::new(30);
    let alone = |name, mesh: &Mesh, random: &mut Random| Scene {
        name,
        bodies: vec![Body::new(mesh, Transform::IDENTITY, random)],
        meets_itself: true,
    };
    let cloth = crumpled_sheet(triangles, 0.0);

    // A ground of 32 triangles, and on it patches of cloth with edges of about a thousandth of its edges.
    let ground = grid(4, 4, 4_000.0, 4_000.0, Diagonals::Uniform);
    let patches = (0..16_u8).map(|patch| {
        let place = [f32::from(patch % 4), 0.0, f32::from(patch / 4)].map(|cell| 900.0 * (cell - 1.5) + 3.0);
        crumpled_sheet(triangles / 16, 0.3 * f64::from(patch)).scale(0.4).translate(place)
    });
    let sizes = merge(&[ground].into_iter().chain(patches).collect::<Vec<_>>());

    // Pairs of small bodies, ten thousand times their size apart.
    let small: Vec<Mesh> = (0..triangles / 40)
        .flat_map(|_| {
            let place = [(); 3].map(|()| 1e5 * random.signed_unit());
            [icosphere(0, 1.0).translate(place), icosphere(0, 1.0).translate(place.map(|coordinate| coordinate + 0.9))]
        })
        .collect();
    let sparse = merge(&small);

    // Balls in a heap, each turned, that overlap a little.
    let ball = icosphere(3, 0.51);
    let count = (triangles / ball.triangles.len()).max(2);
    #[expect(clippy::cast_sign_loss, reason = "a count has no sign")]
    let side = (count as f64).cbrt().ceil() as usize;
    let pile = (0..count).map(|number| {
        let cell = [number % side, number / side % side, number / side / side].map(|cell| cell as f32);
        let turned = Quat::from_rotation_x(number as f32) * Quat::from_rotation_z(0.7 * number as f32);
        Body::new(&ball, Transform::from_translation(Vec3::from(cell)).with_rotation(turned), &mut Random::new(31))
    });
    let pile = Scene { name: "pile of balls", bodies: pile.collect(), meets_itself: false };
    vec![
        alone("crumpled cloth", &cloth, &mut random),
        alone("sizes of 1000 to 1", &sizes, &mut random),
        alone("sparse world", &sparse, &mut random),
        pile,
    ]
}
