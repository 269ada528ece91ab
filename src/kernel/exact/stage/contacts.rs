//! The contact between two features of a pair that is examined by itself.

use glam::DVec3;

use crate::kernel::{
    contact::{CompactContact, feature_number},
    exact::Proximity,
    mesh::{
        barycentric::point_at,
        feature::{Feature, FeaturePair},
        side::face_normal,
    },
    pair::{PairSettings, SurfaceSide, is_inside},
};

/// The [numbers](feature_number) of features.
pub(super) fn numbers(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    triangles: [u32; 2],
    features: FeaturePair,
) -> [u32; 2] {
    [
        feature_number(a.topology, a.positions, triangles[0], features.a),
        feature_number(b.topology, b.positions, triangles[1], features.b),
    ]
}

/// A contact between features with these `numbers`.
#[expect(clippy::too_many_arguments, reason = "a pair, what is known about it, and its features in contact")]
pub(super) fn contact(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    settings: &PairSettings,
    triangles: [u32; 2],
    numbers: [u32; 2],
    is_shared: bool,
    corners: &[[DVec3; 3]; 2],
    proximity: &Proximity,
) -> CompactContact {
    let from_b_to_a =
        direction_of(proximity.separation).unwrap_or_else(|| way_out(a, b, triangles, corners, proximity));
    let mut normal = -from_b_to_a;
    let mut distance = proximity.distance * settings.scale;
    if !settings.same_surface && is_inside([a, b], triangles, proximity.features, proximity.separation) {
        normal = -normal;
        distance = -distance;
    }
    let weights = proximity.barycentric_b;
    let point_b = point_at(&corners[1], &weights);
    CompactContact::between_features(
        triangles,
        settings.same_surface,
        proximity.features,
        numbers,
        is_shared,
        [proximity.barycentric_a, weights].map(|[first, second, _]| [first as f32, second as f32]),
        point_b.as_vec3(),
        normal.as_vec3(),
        distance as f32,
    )
}

/// Unit vector along a separation, or `None` if it has no direction.
fn direction_of(separation: DVec3) -> Option<DVec3> {
    // 2^512. Squares of lengths below its inverse have lost precision at the lower end of f64, or all of it.
    const LARGE: f64 = f64::from_bits((1023 + 512) << 52);
    let separation = if separation.length_squared() * LARGE < 1.0 { separation * LARGE } else { separation };
    separation.try_normalize()
}

/// A direction for points that coincide: the normal of the face that is met or pierced, otherwise that of two edges. It
/// points from the second side to the first: out of a one-sided surface, and for a two-sided one toward the side where
/// more of the first side lies.
fn way_out(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    triangles: [u32; 2],
    corners: &[[DVec3; 3]; 2],
    proximity: &Proximity,
) -> DVec3 {
    let from_b_to_a = (corners[0].iter().sum::<DVec3>() - corners[1].iter().sum::<DVec3>()) / 3.0;
    let towards_a = |direction: DVec3| if direction.dot(from_b_to_a) < 0.0 { -direction } else { direction };
    let features = proximity.features;
    let direction = match (features.a, features.b) {
        (Feature::Face, _) if a.one_sided => -a.outward(triangles[0], Feature::Face),
        (_, Feature::Face) if b.one_sided => b.outward(triangles[1], Feature::Face),
        (Feature::Face, _) => towards_a(face_normal(&corners[0])),
        (Feature::Edge(edge_a), Feature::Edge(edge_b)) => {
            let along = |side: usize, edge: u8| corners[side][(edge as usize + 1) % 3] - corners[side][edge as usize];
            towards_a(along(0, edge_a).cross(along(1, edge_b)))
        }
        _ => towards_a(face_normal(&corners[1])),
    };
    direction.try_normalize().or_else(|| from_b_to_a.try_normalize()).unwrap_or(DVec3::Y)
}
