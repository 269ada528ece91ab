//! At which step a pair of triangles with overlapping boxes was dropped.
//!
//! No stage records it. These functions run the stages' own functions once more, one step at a time, so the answer
//! agrees with the tick and costs nothing unless it is requested. Used by `detection::PairFates`, which adds the pairs
//! that slabs dropped before they became candidates.

use std::borrow::Cow;

use super::{
    exact::rigid_shape::ShapeGeometry,
    mesh::ids::TriangleId,
    pair::{FoundPairs, PairSettings, SurfaceSide},
    smooth::on_shape::patch_shape_pairs,
    spheres::{
        contacts::{FoundSpheres, ball_contacts, meeting_caps, overlapping_ball_contacts},
        osculating_contacts::{OsculatingSide, osculating_contacts},
        pairs::{BallSide, CapSide, CapTests, caps_passing},
    },
};

/// What became of a pair whose boxes overlap: the step that dropped it, in the order of the steps, or that it touches.
/// Each method takes some of the steps. A rigid shape is only measured ([`Distance`](Self::Distance)).
///
/// The *range* is the contact distance, or more if a margin or the end of contacts requires it
/// ([`SurfacePair::range`](crate::detection::SurfacePair::range)).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PairFate {
    /// The triangles share a vertex, in a self-collision. The broad phases of this crate leave such pairs out already.
    Neighbors,
    /// The remembered distance of the triangles, less the motion of their surfaces since, exceeds the range, or else a
    /// slab still separates them by more than the range. The pair was skipped. `Exact` and `Closest`, if the surfaces
    /// have [moved a little](field@crate::CircumsphereSettings::memory). Nothing is known about the other pairs of such
    /// surfaces whose boxes may overlap.
    Remembered,
    /// A slab separates the triangles by more than the range: along the normal of one of them or, with `Exact` and
    /// `Closest`, along one of several directions from one to the other, starting with the line between their
    /// centroids. The broad phase by trees drops such pairs before they become candidates. After a broad phase that
    /// does not, `Circumsphere` drops those that the normals separate, whereas `Exact` and `Closest` measure them
    /// ([`Distance`](Self::Distance)). `Circumsphere` only with
    /// [`plane_cull`](crate::CircumsphereSettings::plane_cull). Not `BoundingSphere` and `Polygon`.
    ///
    /// Also pairs in a flat region that [normal cones](crate::detection::NormalConeCullingPlugin) leave out.
    Planes,
    /// The spheres of the triangles are farther apart than the range: their enclosing balls (`BoundingSphere`), or the
    /// offset spheres (`Circumsphere`).
    Spheres,
    /// The triangles are separated by more than the range along the line between the centers of their offset spheres.
    /// `Circumsphere` with [`plane_cull`](crate::CircumsphereSettings::plane_cull).
    CenterLine,
    /// The line between the centers of the offset spheres leaves one of them outside its safety cone, so the method
    /// assumes that the surface is not met there. `Circumsphere`. This is the step at which that method misses touching
    /// pairs.
    Cone,
    /// Farther apart than the contact distance, as the method measures it. Any method. Within the
    /// [margin](field@crate::CircumsphereSettings::margin) such a pair still has contacts.
    Distance,
    /// Within the contact distance.
    Touching,
}

impl PairFate {
    /// All fates, in order.
    pub const ALL: [Self; 8] = [
        Self::Neighbors,
        Self::Remembered,
        Self::Planes,
        Self::Spheres,
        Self::CenterLine,
        Self::Cone,
        Self::Distance,
        Self::Touching,
    ];

    /// A short lowercase name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Neighbors => "neighbors",
            Self::Remembered => "remembered",
            Self::Planes => "planes",
            Self::Spheres => "spheres",
            Self::CenterLine => "center line",
            Self::Cone => "cone",
            Self::Distance => "distance",
            Self::Touching => "touching",
        }
    }
}

/// The fates of a list of candidates, after the steps taken so far.
struct Fates<'a> {
    candidates: &'a [[u32; 2]],
    fates: &'a mut [PairFate],
}

impl<'a> Fates<'a> {
    /// Appends a fate for each candidate, which the steps then decide.
    fn append(candidates: &'a [[u32; 2]], fates: &'a mut Vec<PairFate>) -> Self {
        let before = fates.len();
        fates.resize(before + candidates.len(), PairFate::Touching);
        Self { candidates, fates: &mut fates[before..] }
    }

    /// Records that `step` has been taken. `left` are the pairs that it did not drop, in the order of the candidates.
    fn passed(&mut self, step: PairFate, left: impl Iterator<Item = [u32; 2]>) {
        let mut left = left.peekable();
        for (candidate, fate) in self.candidates.iter().zip(&mut *self.fates) {
            // A pair that is listed twice passes twice or not at all: the next one left is the candidate's own, or a
            // later one.
            if *fate == PairFate::Touching && left.next_if_eq(candidate).is_none() {
                *fate = step;
            }
        }
        debug_assert!(left.next().is_none(), "{step:?} passed on what it was not given");
    }
}

fn touching(found: &FoundPairs) -> impl Iterator<Item = [u32; 2]> {
    found.touching.iter().map(|pair| [pair.triangle_a, pair.triangle_b])
}

/// The candidates without those that share a vertex, which are neighbors in a self-collision. The
/// broad phase leaves them out; debugging asks about them too.
fn without_neighbors<'a>(
    surface: &SurfaceSide<'_>,
    candidates: &'a [[u32; 2]],
    settings: &PairSettings,
) -> Cow<'a, [[u32; 2]]> {
    let neighbors = |pair: &[u32; 2]| surface.topology.share_vertex(TriangleId(pair[0]), TriangleId(pair[1]));
    if settings.same_surface && candidates.iter().any(neighbors) {
        Cow::Owned(candidates.iter().copied().filter(|pair| !neighbors(pair)).collect())
    } else {
        Cow::Borrowed(candidates)
    }
}

/// Appends the fate of each candidate with the method `BoundingSphere`.
pub fn ball_fates(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let (mut overlapping, mut found) = (Vec::new(), FoundPairs::default());
    let candidates = without_neighbors(&a.surface, candidates, settings);
    fates.passed(PairFate::Neighbors, candidates.iter().copied());
    overlapping_ball_contacts(a, b, &candidates, settings, &mut overlapping, &mut FoundSpheres::default());
    fates.passed(PairFate::Spheres, overlapping.iter().copied());
    ball_contacts(a, b, &overlapping, settings, &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}

/// Appends the fate of each candidate with the method `Circumsphere`.
pub fn cap_fates(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let mut left = without_neighbors(&a.surface, candidates, settings).into_owned();
    fates.passed(PairFate::Neighbors, left.iter().copied());
    let spheres = (PairFate::Spheres, CapTests::SPHERES);
    let steps = if settings.cull {
        &[(PairFate::Planes, CapTests::PLANES), spheres, (PairFate::CenterLine, CapTests::CENTER_LINE)][..]
    } else {
        &[spheres]
    };
    for &(step, tests) in steps {
        let mut passing = Vec::new();
        caps_passing(a, b, &left, tests, settings, &mut passing);
        fates.passed(step, passing.iter().copied());
        left = passing;
    }
    let (mut meeting, mut found) = (Vec::new(), FoundPairs::default());
    meeting_caps(a, b, &left, settings, &mut meeting, &mut found);
    fates.passed(PairFate::Cone, meeting.iter().copied());
    fates.passed(PairFate::Distance, touching(&found));
}

/// Appends the fate of each candidate with the method `Circumsphere`, if one of the surfaces is smooth.
pub fn osculating_fates(
    a: &OsculatingSide<'_>,
    b: &OsculatingSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let left = without_neighbors(&a.surface, candidates, settings);
    fates.passed(PairFate::Neighbors, left.iter().copied());
    let mut found = FoundPairs::default();
    osculating_contacts(a, b, &left, settings, &mut Vec::new(), &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}

/// Appends the fate of each candidate with an exact method, `examine`:
/// [`exact_pairs`](super::exact::stage::exact_pairs) or [`closest_pairs`](super::exact::stage::closest_pairs). The
/// broad phase has dropped the pairs that slabs separate.
pub fn exact_fates(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    examine: impl Fn(&SurfaceSide<'_>, &SurfaceSide<'_>, &[[u32; 2]], &mut FoundPairs),
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let mut found = FoundPairs::default();
    let candidates = without_neighbors(a, candidates, settings);
    fates.passed(PairFate::Neighbors, candidates.iter().copied());
    examine(a, b, &candidates, &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}

/// Appends the fate of each candidate triangle near a rigid shape.
pub fn shape_fates(
    side: &SurfaceSide<'_>,
    shape: &ShapeGeometry,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let mut found = FoundPairs::default();
    patch_shape_pairs(side, shape, candidates, settings, &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}
