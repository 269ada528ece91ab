//! Resolves which contacts of one-sided surfaces have really penetrated, once all contacts of a pair of surfaces are
//! known.
//!
//! Runs after the exact stage, on its contacts and the candidates that they came from. Only negative distances are
//! examined.

use glam::DVec3;

use super::stage::reports::triangles_around;
use crate::kernel::{
    contact::CompactContact,
    mesh::{
        barycentric::point_at,
        feature::{Feature, FeaturePair},
        side::closest_feature,
    },
    pair::{PairSettings, SurfaceSide},
};

/// A direction leads out of a solid at an edge or vertex if no neighboring face rises along it by more than this sine.
const OUTWARD_SLACK: f64 = 1.0e-3;

/// A depth counts as the smallest one if it exceeds that by no more than this share. Covers the rounding of stored
/// distances.
const DEPTH_SLACK: f64 = 1.0e-5;

/// A triangle is skipped only if its box is farther away than the nearest triangle by this share. Far above the f64
/// rounding of both distances.
const BOX_SLACK: f64 = 1.0e-6;

/// What the surroundings of a contact point imply for the contacts there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Finding {
    /// Nothing of the solid is near the point. Contacts stay as they are.
    #[default]
    Alone,
    /// The point is outside. Distances become positive.
    Outside,
    /// The point is inside, and contacts may claim at most this depth, in the pair's frame. Infinite if their direction
    /// leads out of the solid, negative if it does not.
    Inside(f64),
}

/// Resolves which contacts of one-sided surfaces have really penetrated, once all of them are known.
///
/// A feature pair alone cannot decide this. Seen from behind, a face may be the far side of a thin plate, and an edge
/// the near side of another face. Therefore the point of the other side is compared with its closest feature among the
/// candidates. If it is outside, the contact has a positive distance after all. If it is inside, contacts that do not
/// lead out are dropped, because they would claim too much depth: for a vertex, all but the nearest; for an edge or
/// face, those whose direction does not lead out of the solid at the feature.
///
/// Runs in three steps. The second one takes the time, and can be split among threads. Keeps its memory from pair to
/// pair.
#[derive(Clone, Debug, Default)]
pub struct PenetrationTest {
    /// The indices of the contacts to resolve, each with the index of its query.
    penetrated: Vec<[u32; 2]>,
    questions: Vec<u32>,
    /// For each side, the triangles of the other side that are near its triangles.
    partners: [Partners; 2],
}

impl PenetrationTest {
    /// Determines which contacts to resolve, and lists the triangles near them.
    pub fn prepare(
        &mut self,
        a: &SurfaceSide<'_>,
        b: &SurfaceSide<'_>,
        candidates: &[[u32; 2]],
        settings: &PairSettings,
        contacts: &[CompactContact],
    ) {
        self.penetrated.clear();
        self.questions.clear();
        if settings.same_surface {
            return;
        }
        let negative = (0..).zip(contacts).filter(|(_, contact)| contact.distance < 0.0);
        self.penetrated.extend(negative.map(|(place, _)| [place, 0]));
        if self.penetrated.is_empty() {
            return;
        }
        for (partners, side) in self.partners.iter_mut().zip([a, b]) {
            partners.clear(side.topology.triangles().len());
        }
        for [place, question] in &mut self.penetrated {
            let contact = &contacts[*place as usize];
            let (features, triangles) =
                ([contact.features.a, contact.features.b], [contact.triangle_a, contact.triangle_b]);
            let other = 1 - solid_side(a, b, contact.features);
            let requested = self.partners[other].want(triangles[other], features[other]);
            *question = *requested.get_or_insert_with(|| {
                self.questions.push(*place);
                self.questions.len() as u32 - 1
            });
        }
        for (side, partners) in self.partners.iter_mut().enumerate() {
            partners.fill(candidates, side);
        }
    }

    /// The queries: indices of the contacts whose surroundings must be examined. Contacts at the same corner of a
    /// triangle share one query.
    #[must_use]
    pub fn questions(&self) -> &[u32] {
        &self.questions
    }

    /// Answers some of the queries.
    pub fn look(
        &self,
        a: &SurfaceSide<'_>,
        b: &SurfaceSide<'_>,
        contacts: &[CompactContact],
        questions: &[u32],
        findings: &mut [Finding],
    ) {
        for (&place, finding) in questions.iter().zip(findings) {
            *finding = self.find(a, b, &contacts[place as usize]);
        }
    }

    fn find(&self, a: &SurfaceSide<'_>, b: &SurfaceSide<'_>, contact: &CompactContact) -> Finding {
        let features = contact.features;
        let sides = [(a, contact.triangle_a, features.a), (b, contact.triangle_b, features.b)];
        let solid = solid_side(a, b, features);
        let (other, other_triangle, other_feature) = sides[1 - solid];
        let weights = if solid == 1 { contact.barycentric_a } else { contact.barycentric_b };
        let corners = other.corners(other_triangle);
        let [u, v] = weights.map(f64::from);
        let point = point_at(&corners, &[u, v, 1.0 - u - v]);
        let (solid_surface, solid_triangle, _) = sides[solid];
        let near = self.partners[1 - solid].of(other_triangle);
        let Some((depth, inside)) = depth_in(solid_surface, solid_triangle, near, point) else {
            return Finding::Alone;
        };
        if !inside {
            return Finding::Outside;
        }
        if matches!(other_feature, Feature::Vertex(_)) {
            return Finding::Inside(depth);
        }
        // The contact's normal points out of the first side and into the second.
        let outward = [contact.normal.as_dvec3(), -contact.normal.as_dvec3()];
        let is_way_out =
            (0..2).all(|k| !sides[k].0.one_sided || leads_out(sides[k].0, sides[k].1, sides[k].2, outward[k]));
        Finding::Inside(if is_way_out { f64::INFINITY } else { f64::NEG_INFINITY })
    }

    /// Applies the findings about all [queries](Self::questions).
    pub fn apply(&self, findings: &[Finding], settings: &PairSettings, contacts: &mut Vec<CompactContact>) {
        let mut penetrated = self.penetrated.iter().copied().peekable();
        if penetrated.peek().is_none() {
            return;
        }
        let mut place = 0;
        contacts.retain_mut(|contact| {
            let next = penetrated.next_if(|&[penetrated, _]| penetrated == place);
            place += 1;
            let Some([_, question]) = next else { return true };
            match findings[question as usize] {
                Finding::Alone => true,
                Finding::Outside => {
                    contact.normal = -contact.normal;
                    contact.distance = -contact.distance;
                    true
                }
                Finding::Inside(depth) => f64::from(-contact.distance) <= depth * settings.scale * (1.0 + DEPTH_SLACK),
            }
        });
    }
}

/// For the requested triangles of one side, the nearby triangles of the other side.
#[derive(Clone, Debug, Default)]
struct Partners {
    /// One more than the index of a triangle among the requested ones, or 0 if it is not requested.
    numbers: Vec<u32>,
    wanted: Vec<u32>,
    /// The queries about the corners of requested triangles.
    requested: Vec<[Option<u32>; 3]>,
    /// Used for queries that are not shared.
    own: Option<u32>,
    /// The index of a requested triangle, and a triangle near it.
    pairs: Vec<[u32; 2]>,
    /// Where the list of each requested triangle ends.
    ends: Vec<u32>,
    near: Vec<u32>,
}

impl Partners {
    fn clear(&mut self, triangle_count: usize) {
        for &triangle in &self.wanted {
            self.numbers[triangle as usize] = 0;
        }
        self.wanted.clear();
        self.requested.clear();
        self.numbers.resize(triangle_count, 0);
    }

    /// Requests the triangles near a triangle. Returns the query about one of its features, if there is one already.
    fn want(&mut self, triangle: u32, feature: Feature) -> &mut Option<u32> {
        let number = &mut self.numbers[triangle as usize];
        if *number == 0 {
            self.wanted.push(triangle);
            self.requested.push([None; 3]);
            *number = self.wanted.len() as u32;
        }
        match feature {
            Feature::Vertex(corner) => &mut self.requested[*number as usize - 1][corner as usize],
            Feature::Edge(_) | Feature::Face => {
                self.own = None;
                &mut self.own
            }
        }
    }

    /// Lists the triangles near the requested ones.
    fn fill(&mut self, candidates: &[[u32; 2]], side: usize) {
        self.pairs.clear();
        self.ends.clear();
        self.ends.resize(self.wanted.len(), 0);
        self.near.clear();
        if self.wanted.is_empty() {
            return;
        }
        for pair in candidates {
            if let Some(number) = self.numbers[pair[side] as usize].checked_sub(1) {
                self.pairs.push([number, pair[1 - side]]);
                self.ends[number as usize] += 1;
            }
        }
        // Turns counts into list starts. Filling a list then moves its start to its end.
        let mut start = 0;
        for end in &mut self.ends {
            start += std::mem::replace(end, start);
        }
        self.near.resize(self.pairs.len(), 0);
        for &[number, triangle] in &self.pairs {
            let end = &mut self.ends[number as usize];
            self.near[*end as usize] = triangle;
            *end += 1;
        }
    }

    fn of(&self, triangle: u32) -> &[u32] {
        let number = self.numbers[triangle as usize] as usize;
        let Some(number) = number.checked_sub(1) else { return &[] };
        let start = if number == 0 { 0 } else { self.ends[number - 1] };
        &self.near[start as usize..self.ends[number] as usize]
    }
}

/// The distance from a point to the nearest of some triangles, and whether the point is behind it. Of equally near
/// triangles, the one with the lowest number decides. `likely` is a triangle among them that is probably near.
fn depth_in(side: &SurfaceSide<'_>, likely: u32, triangles: &[u32], point: DVec3) -> Option<(f64, bool)> {
    if triangles.is_empty() {
        return None;
    }
    let closest = |triangle: u32| {
        let (feature, place) = closest_feature(&side.corners(triangle), point);
        let between = point - place;
        (between.length(), triangle, feature, between)
    };
    let mut nearest = closest(likely);
    for &triangle in triangles {
        let reach = (nearest.0 + f64::from(side.rounding())) * (1.0 + BOX_SLACK);
        if triangle == likely || squared_distance_to_box(side, triangle, point) > reach * reach {
            continue;
        }
        let other = closest(triangle);
        if other.0.total_cmp(&nearest.0).then(other.1.cmp(&nearest.1)).is_lt() {
            nearest = other;
        }
    }
    let (depth, triangle, feature, between) = nearest;
    Some((depth, side.rise(triangle, feature, between) < 0.0))
}

/// Squared distance from a point to the box of a triangle, whose corners are rounded.
#[inline]
fn squared_distance_to_box(side: &SurfaceSide<'_>, triangle: u32, point: DVec3) -> f64 {
    let [a, b, c] = side.topology.triangles()[triangle as usize].map(|vertex| side.positions[vertex as usize]);
    let (low, high) = (a.min(b).min(c).as_dvec3(), a.max(b).max(c).as_dvec3());
    (low - point).max(point - high).max(DVec3::ZERO).length_squared()
}

/// Whether a direction leads out of a solid at a feature: no face around the feature rises along it.
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

/// The index of the side that decides whether the other one has passed it: the second, unless only the first has an
/// inside, or the face of the first is in contact.
fn solid_side(a: &SurfaceSide<'_>, b: &SurfaceSide<'_>, features: FeaturePair) -> usize {
    usize::from(b.one_sided && (features.a != Feature::Face || !a.one_sided))
}
