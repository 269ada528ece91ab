//! At which step a pair of triangles whose boxes overlap was dropped.
//!
//! No stage records it. These functions run the stages' own functions once more, one step at a time, so the answer agrees with
//! what the tick did and costs nothing where nobody asks. Used by `detection::PairFates`, which adds the pairs that slabs
//! dropped before they were candidates.

use glam::Vec3;

use super::{
    exact::{rigid_shape::ShapeGeometry, stage::refine_shape},
    mesh::topology::SurfaceTopology,
    pair::{FoundPairs, PairSettings, SurfaceSide, without_neighbors},
    pose::Pose,
    spheres::{
        contacts::{FoundSpheres, ball_contacts, meeting_caps, overlapping_ball_contacts},
        pairs::{BallSide, CapSide, CapTests, caps_passing},
    },
};

/// What became of a pair whose boxes overlap: the step that dropped it, in the order in which the methods take them, or that
/// it touches. Each method takes some of the steps; a rigid shape is only measured ([`Distance`](Self::Distance)).
///
/// What *matters* is the contact distance, or more where a margin or the end of contacts asks for it
/// ([`SurfacePair::range`](crate::detection::SurfacePair::range)).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PairFate {
    /// The two share a vertex in a self-collision. The broad phases of this crate leave such pairs out already.
    Neighbors,
    /// What is remembered of the distance of the two, less what their surfaces have moved since, exceeds what matters, or
    /// else a slab still keeps them farther apart: they were passed over. `Refined` and `Closest`, where surfaces have [moved a
    /// little](field@crate::CircumsphereSettings::memory); of such surfaces' other pairs whose boxes may overlap nothing is
    /// known.
    Remembered,
    /// A slab keeps the two farther apart than matters: along the normal of one of them or, with `Refined` and `Closest`,
    /// along one of some directions from one to the other, of which the first is the line between their centroids. The
    /// broad phase by trees drops such pairs before they are candidates. After one that does not, `Circumsphere` drops
    /// those of the normals; `Refined` and `Closest` measure them ([`Distance`](Self::Distance)). `Circumsphere` only
    /// with [`plane_cull`](crate::CircumsphereSettings::plane_cull); not `BoundingSphere` and `Polygon`.
    Planes,
    /// The spheres of the two are farther apart than matters: their enclosing balls (`BoundingSphere`), or the offset
    /// spheres (`Circumsphere`).
    Spheres,
    /// Along the line between the centers of their offset spheres the two are farther apart than matters.
    /// `Circumsphere` with [`plane_cull`](crate::CircumsphereSettings::plane_cull).
    CenterLine,
    /// The line between the centers of their offset spheres leaves one of them outside its safety cone: as far as
    /// the method knows, it is not the surface that is met there. `Circumsphere`, and the step at which that method misses
    /// pairs that touch.
    Cone,
    /// Farther apart than the contact distance, as far as the method measures it. Any method. Within the
    /// [margin](field@crate::CircumsphereSettings::margin) such a pair still has contacts.
    Distance,
    /// Within the contact distance.
    Touching,
}

impl PairFate {
    /// All of them, in order.
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

    /// A short name in lower case.
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

/// The fates of a list of candidates, as far as the steps have been taken.
struct Fates<'a> {
    candidates: &'a [[u32; 2]],
    fates: &'a mut [PairFate],
}

impl<'a> Fates<'a> {
    /// Appends a fate for each candidate, to be settled by the steps.
    fn append(candidates: &'a [[u32; 2]], fates: &'a mut Vec<PairFate>) -> Self {
        let before = fates.len();
        fates.resize(before + candidates.len(), PairFate::Touching);
        Self { candidates, fates: &mut fates[before..] }
    }

    /// `step` has been taken, and `left` are the pairs that it did not drop, in the order of the candidates.
    fn passed(&mut self, step: PairFate, left: impl Iterator<Item = [u32; 2]>) {
        let mut left = left.peekable();
        for (candidate, fate) in self.candidates.iter().zip(&mut *self.fates) {
            // A pair that is listed twice passes twice, or not at all: the next one left is a candidate's own, or later.
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

/// Appends the fate of each candidate by the method `BoundingSphere`.
pub fn ball_fates(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let (mut overlapping, mut found) = (Vec::new(), FoundPairs::default());
    fates.passed(PairFate::Neighbors, without_neighbors(&a.surface, candidates, settings).iter().copied());
    overlapping_ball_contacts(a, b, candidates, settings, &mut overlapping, &mut FoundSpheres::default());
    fates.passed(PairFate::Spheres, overlapping.iter().copied());
    ball_contacts(a, b, &overlapping, settings, &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}

/// Appends the fate of each candidate by the method `Circumsphere`.
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

/// Appends the fate of each candidate by a method that is exact, `examine`: [`refine_pairs`](super::exact::stage::refine_pairs) or
/// [`refine_closest`](super::exact::stage::refine_closest). The broad phase has dropped the pairs that slabs part.
pub fn exact_fates(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    examine: impl Fn(&SurfaceSide<'_>, &SurfaceSide<'_>, &[[u32; 2]], &PairSettings, &mut FoundPairs),
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let mut found = FoundPairs::default();
    fates.passed(PairFate::Neighbors, without_neighbors(a, candidates, settings).iter().copied());
    examine(a, b, candidates, settings, &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}

/// Appends the fate of each candidate triangle near a rigid shape; see [`refine_shape`] for what they are of.
pub fn shape_fates(
    topology: &SurfaceTopology,
    positions: &[Vec3],
    pose: &Pose,
    shape: &ShapeGeometry,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let mut found = FoundPairs::default();
    refine_shape(topology, positions, pose, shape, candidates, settings, &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}
