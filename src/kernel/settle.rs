//! Settles which contacts of one-sided surfaces have really penetrated, once all of a pair of surfaces are found.
//!
//! Runs after the exact stage, on its contacts and the candidates they came from; only negative distances are looked at.

use glam::DVec3;

use super::{
    contact::CompactContact,
    exact::{Feature, FeaturePair, barycentric::point_at, side::closest_feature},
    pair::{PairSettings, SurfaceSide},
    refine::triangles_around,
};

/// A direction counts as out of a solid at an edge or vertex where no neighboring face rises along it by more than this
/// sine.
const OUTWARD_SLACK: f64 = 1.0e-3;

/// A depth counts as the least one where it exceeds that by no more than this share: the rounding of stored distances.
const DEPTH_SLACK: f64 = 1.0e-5;

/// Settles which contacts of one-sided surfaces have really penetrated, once all of them are found.
///
/// A feature pair alone cannot tell: seen from behind a face may be the far side of a thin plate, and from behind an
/// edge the near side of another face. So the point of the other side is looked up on its closest feature among the
/// candidates. Where that is outside, the contact is a positive distance after all. Where it is inside, contacts that
/// are no way out are dropped, because they would claim more depth than there is: of a vertex all but the nearest, of
/// an edge or face those whose direction is not out of the solid at the feature.
pub fn settle_penetrations(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    contacts: &mut Vec<CompactContact>,
) {
    if settings.same_surface || !contacts.iter().any(|contact| contact.distance < 0.0) {
        return;
    }
    let partners = [
        Partners::new(candidates, contacts, 0, a.topology.triangles().len()),
        Partners::new(candidates, contacts, 1, b.topology.triangles().len()),
    ];
    contacts.retain_mut(|contact| {
        if contact.distance >= 0.0 {
            return true;
        }
        let features = contact.features;
        let sides = [(a, contact.triangle_a, features.a), (b, contact.triangle_b, features.b)];
        let solid = usize::from(asks_second(a, b, features));
        let (other, other_triangle, other_feature) = sides[1 - solid];
        let weights = if solid == 1 { contact.barycentric_a } else { contact.barycentric_b };
        let corners = other.corners(other_triangle);
        let [u, v] = weights.map(f64::from);
        let point = point_at(&corners, &[u, v, 1.0 - u - v]);
        let Some((depth, inside)) = depth_in(sides[solid].0, partners[1 - solid].of(other_triangle), point) else {
            return true;
        };
        if !inside {
            contact.normal = -contact.normal;
            contact.distance = -contact.distance;
            return true;
        }
        if matches!(other_feature, Feature::Vertex(_)) {
            return f64::from(-contact.distance) <= depth * settings.scale * (1.0 + DEPTH_SLACK);
        }
        // The contact's normal points out of the second side and into the first.
        let outward = [-contact.normal.as_dvec3(), contact.normal.as_dvec3()];
        (0..2).all(|k| !sides[k].0.one_sided || leads_out(sides[k].0, sides[k].1, sides[k].2, outward[k]))
    });
}

/// For those triangles of one side that have a penetrating contact, the triangles of the other side that are near.
struct Partners(Vec<[u32; 2]>);

impl Partners {
    fn new(candidates: &[[u32; 2]], contacts: &[CompactContact], side: usize, triangle_count: usize) -> Self {
        let mut wanted = vec![false; triangle_count];
        for contact in contacts.iter().filter(|contact| contact.distance < 0.0) {
            wanted[[contact.triangle_a, contact.triangle_b][side] as usize] = true;
        }
        let mut pairs: Vec<[u32; 2]> = candidates
            .iter()
            .filter(|pair| wanted[pair[side] as usize])
            .map(|pair| [pair[side], pair[1 - side]])
            .collect();
        pairs.sort_unstable();
        Self(pairs)
    }

    fn of(&self, triangle: u32) -> impl Iterator<Item = u32> {
        let start = self.0.partition_point(|pair| pair[0] < triangle);
        self.0[start..].iter().take_while(move |pair| pair[0] == triangle).map(|pair| pair[1])
    }
}

/// How far a point is from the nearest of some triangles, and whether it is behind it.
fn depth_in(side: &SurfaceSide<'_>, triangles: impl Iterator<Item = u32>, point: DVec3) -> Option<(f64, bool)> {
    let closest = triangles.map(|triangle| {
        let (feature, place) = closest_feature(&side.corners(triangle), point);
        (triangle, feature, point - place)
    });
    let (triangle, feature, between) = closest.min_by(|one, other| one.2.length().total_cmp(&other.2.length()))?;
    Some((between.length(), side.outward(triangle, feature).dot(between) < 0.0))
}

/// Whether a direction leads out of a solid at a feature: no face around it rises along the direction.
fn leads_out(side: &SurfaceSide<'_>, triangle: u32, feature: Feature, direction: DVec3) -> bool {
    let corners = side.corners(triangle);
    let rises = |along: DVec3| direction.dot(along) > OUTWARD_SLACK * along.length();
    let around = triangles_around(side, triangle, feature).unwrap_or_default();
    match feature {
        Feature::Face => true,
        Feature::Edge(edge) => {
            let (start, end) = (corners[edge as usize], corners[(edge as usize + 1) % 3]);
            let axis = (end - start).normalize_or_zero();
            !around.iter().any(|&around| {
                side.corners(around).iter().any(|&corner| {
                    let along = corner - start;
                    corner != start && corner != end && rises(along - axis * axis.dot(along))
                })
            })
        }
        Feature::Vertex(corner) => !around.iter().any(|&around| {
            side.corners(around)
                .iter()
                .any(|&other| other != corners[corner as usize] && rises(other - corners[corner as usize]))
        }),
    }
}

/// Whether the second side, rather than the first, tells which side of it the other is on.
fn asks_second(a: &SurfaceSide<'_>, b: &SurfaceSide<'_>, features: FeaturePair) -> bool {
    b.one_sided && (features.a != Feature::Face || !a.one_sided)
}
